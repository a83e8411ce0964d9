"""Glides from one version of a piece to the next: parameters, and links that fade in or out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.common.decay import LN_1000
from ergon.instruments.model import Instrument
from ergon.instruments.module_kinds import LINK_KINDS
from ergon.instruments.spread import single_links

if TYPE_CHECKING:
    from ergon.instruments.assemble import Assembly
    from ergon.instruments.model import Module, Target
    from ergon.scores.reading.piece import Piece
    from ergon.scores.reading.playing import Key

# CEL: K, Z, M. Link: K, or a factor if it has no K. STRING or PLATE: K and Z of its links, up to a
# constant factor.
_Values = tuple[float, ...]
_FADE_OUT_DURATION = 0.02  # [s] in which a removed link fades out
_POINT_KINDS = ("MAS", "CEL", "SOL")
BODY_KINDS = ("STRING", "PLATE")
TWO_PI = 6.283185307179586
_TUNING_FIELDS = ("f", "t60", "M", "X0", "V0")


@dataclass(frozen=True, slots=True)
class Glide:
    """A linear change of a module's parameters between two instants [s], from `initial_values` to
    `final_values`.

    `network_value` is the K that a link has in the network, if it is not the one in `final_values`.
    """

    part: str
    module: str
    initial_values: _Values
    final_values: _Values
    start: float
    stop: float
    network_value: float | None = None

    @property
    def module_key(self) -> tuple[str, str]:
        """The part and the module as the score names them: a link over a range is one module."""
        return self.part, self.module.partition(".")[0]

    @property
    def factors(self) -> tuple[float, float]:
        """The factors of a link's force at the beginning and the end."""
        network_value = self.final_values[0] if self.network_value is None else self.network_value
        return self.initial_values[0] / network_value, self.final_values[0] / network_value

    def evaluate(self, instant: float) -> _Values:
        """The values at an instant."""
        fraction = min(1.0, max(0.0, (instant - self.start) / (self.stop - self.start)))
        number_pairs = zip(self.initial_values, self.final_values, strict=True)
        return tuple(start + (end - start) * fraction for start, end in number_pairs)

    @property
    def body_factors(self) -> tuple[float, float]:
        """The initial K and Z of a body's links, as factors of the final ones."""
        number_pairs = zip(self.initial_values, self.final_values, strict=True)
        k, z = (
            value_before / value_after if value_after else 1.0
            for value_before, value_after in number_pairs
        )
        return k, z

    def put(self, timeline: _core.Timeline, assembly: Assembly) -> None:
        """Put the glide on a timeline. Raises EngineError."""
        module_key = self.part, self.module
        if len(self.initial_values) == 3:
            k, z, m = self.initial_values
            timeline.glide(assembly.mats[module_key], k, z, m, self.start, self.stop)
        elif len(self.initial_values) == 2:
            links = assembly.generator_links[module_key]
            points = [(self.start, *self.body_factors), (self.stop, 1.0, 1.0)]
            timeline.lead(links.start, points, n=len(links))
        else:
            for link in assembly.links[module_key]:
                timeline.fade(link, *self.factors, self.start, self.stop)


def version_glides(
    old_piece: Piece,
    new_piece: Piece,
    running_glides: Iterable[Glide],
    start_s: float,
    duration: float,
) -> tuple[Glide, ...]:
    """Glides from `start_s` [s] on, when a piece takes over from another: values that differ
    glide for `duration`, `running_glides` glides to the same values go on to their end. A new link
    fades in from no force if it joins parts that were there before.
    """
    running_by_module = {
        (glide_running.part, glide_running.module): glide_running
        for glide_running in running_glides
        if glide_running.stop > start_s
    }
    old_values, new_values = (
        dict(_gliding_values(*piece_pair, running_by_module))
        for piece_pair in ((old_piece, new_piece), (new_piece, old_piece))
    )
    forms_by_piece = (
        dict(_body_forms(old_piece, new_piece)),
        dict(_body_forms(new_piece, old_piece)),
    )
    glides_by_module = {}
    for module_key, values in new_values.items():
        running_glide = running_by_module.get(module_key)
        if module_key not in old_values or len(old_values[module_key]) != len(values):
            continue
        if len(values) == 2 and forms_by_piece[0].get(module_key) != forms_by_piece[1].get(
            module_key
        ):
            continue  # another body takes its place
        if running_glide is not None and running_glide.final_values == values:
            glides_by_module[module_key] = running_glide
        elif old_values[module_key] != values:
            current_values = (
                old_values[module_key] if running_glide is None else running_glide.evaluate(start_s)
            )
            glides_by_module[module_key] = Glide(
                *module_key, current_values, values, start_s, start_s + duration
            )
    old_links = _changed_links(old_piece, new_piece)
    for module_key, new_link in _changed_links(new_piece, old_piece).items():
        running_glide = running_by_module.get(module_key)
        if module_key not in old_links and _has_old_end(new_link, old_piece):
            values = _module_values(new_link) or (1.0,)
            current_values = (0.0,) if running_glide is None else running_glide.evaluate(start_s)
            glide = Glide(*module_key, current_values, values, start_s, start_s + duration)
            if glide.module_key not in glides_by_module:  # a link over a range glides as one
                glides_by_module[module_key] = (
                    running_glide
                    if running_glide is not None and running_glide.final_values == values
                    else glide
                )
    return tuple(glides_by_module.values())


@dataclass(frozen=True, slots=True)
class FadingLink:
    """A link that was removed, and fades out."""

    module: Module
    glide: Glide


def fading_links(
    old_piece: Piece,
    new_piece: Piece,
    running_glides: Iterable[Glide],
    earlier_links: Iterable[FadingLink],
    start_s: float,
) -> tuple[FadingLink, ...]:
    """Links that fade out from `start_s` [s] on if both their ends stay, and `earlier_links`
    ones that still do.
    """
    staying_links = _changed_links(new_piece, old_piece)
    running_by_module = {
        (glide.part, glide.module): glide for glide in running_glides if glide.stop > start_s
    }
    links_fading = [link for link in earlier_links if link.glide.stop > start_s]
    removed_links = {
        module_key: link
        for module_key, link in _changed_links(old_piece, new_piece).items()
        if module_key not in staying_links
    }
    for module_key, removed_link in removed_links.items():
        full_values = _module_values(removed_link) or (1.0,)
        current_values = (
            running_by_module[module_key].evaluate(start_s)
            if module_key in running_by_module
            else full_values
        )
        links_fading.append(
            FadingLink(
                removed_link,
                Glide(
                    *module_key,
                    current_values,
                    (0.0,),
                    start_s,
                    start_s + _FADE_OUT_DURATION,
                    full_values[0],
                ),
            )
        )
    return tuple(
        link
        for link in links_fading
        if (link.glide.part, link.glide.module) not in staying_links
        and all(_end_stays(end, old_piece, new_piece) for end in link.module.ends)
    )


def with_fading_links(piece: Piece, links: Iterable[FadingLink]) -> Piece:
    """A piece with the links that fade out."""
    instruments = dict(piece.instruments)
    for link in links:
        name, module = link.glide.part, link.module
        instrument = instruments.get(name) or Instrument(name, (), (), None, module.place)
        instruments[name] = replace(instrument, modules=(*instrument.modules, module))
    return replace(piece, instruments=instruments) if instruments != piece.instruments else piece


def _changed_modules(piece: Piece, other_piece: Piece) -> Iterator[tuple[Key | Instrument, Module]]:
    """The modules of a piece, with their parts, that are not the same objects in another piece."""
    for part in _parts(piece):
        other_part = other_piece.keys.get(part.name) or other_piece.instruments.get(part.name)
        if other_part is part:
            continue
        unchanged_ids: set[int] = set()
        if other_part is not None and _part_settings(other_part) == _part_settings(part):
            unchanged_ids = {id(module) for module in other_part.modules}
        for module in part.modules:
            if id(module) not in unchanged_ids:
                yield part, module


def _parts(piece: Piece) -> tuple[Key | Instrument, ...]:
    return *piece.keys.values(), *piece.instruments.values()


def _part_settings(part: Key | Instrument) -> tuple[float | None, float | None]:
    """What the values of a part's modules depend on besides the modules."""
    if isinstance(part, Instrument):
        return None, part.ca_rate
    return part.reach, None


def _changed_links(piece: Piece, other_piece: Piece) -> dict[tuple[str, str], Module]:
    """The links of instruments by (part, module) that have changed from another piece, except those
    of discrete networks (`units: ca`).

    A link over a range has an entry for each member.
    """
    return {
        (part.name, link.name): link
        for part, module in _changed_modules(piece, other_piece)
        if isinstance(part, Instrument) and part.ca_rate is None and module.kind in LINK_KINDS
        for link in single_links(module)
    }


def _end_stays(end: Target, old_piece: Piece, new_piece: Piece) -> bool:
    """Whether the module at an end exists in both pieces, with the same number of members."""
    old_module, new_module = _module_at(end, old_piece), _module_at(end, new_piece)
    if old_module is None or new_module is None or old_module.kind != new_module.kind:
        return False
    return old_module.kind in _POINT_KINDS or old_module.fields == new_module.fields


def _module_at(end: Target, piece: Piece) -> Module | None:
    part = piece.keys.get(end.part) or piece.instruments.get(end.part)
    modules = () if part is None else part.modules
    return next((module for module in modules if module.name == end.module), None)


def _has_old_end(module: Module, old_piece: Piece) -> bool:
    """Whether a link has an end in a part that the earlier piece has too."""
    end_parts = {end.part for end in module.ends}
    return any(end in old_piece.keys or end in old_piece.instruments for end in end_parts)


def _gliding_values(
    piece: Piece, other_piece: Piece, running_keys: Iterable[tuple[str, str]]
) -> Iterator[tuple[tuple[str, str], _Values]]:
    """The parameters that can glide, by (part, module), as the piece sees them: of modules that
    have changed from another piece, and of those that are `running_keys`.
    """
    gliding_keys = {
        (part.name, module.name) for part, module in _changed_modules(piece, other_piece)
    }.union(running_keys)
    names = {name for name, _ in gliding_keys}
    for piece_part in _parts(piece):
        for part_module in piece_part.modules if piece_part.name in names else ():
            module_key = piece_part.name, part_module.name
            if module_key not in gliding_keys:
                continue
            # Parameters under `units: ca` belong to their rate: they are set at once.
            lever_ratio, ca_rate = _part_settings(piece_part)
            if ca_rate is None and (values := _module_values(part_module)) is not None:
                scale = 1.0 if lever_ratio is None else 1.0 / (lever_ratio * lever_ratio)
                yield module_key, tuple(value * scale for value in values)


def _body_forms(
    piece: Piece, other_piece: Piece
) -> Iterator[tuple[tuple[str, str], Mapping[str, Any]]]:
    """The fields of changed STRINGs and PLATEs except pitch, decay, mass and initial state."""
    for module_part, part_module in _changed_modules(piece, other_piece):
        if isinstance(module_part, Instrument) and part_module.kind in BODY_KINDS:
            form_fields = {
                name: field_value
                for name, field_value in part_module.fields.items()
                if name not in _TUNING_FIELDS
            }
            yield (module_part.name, part_module.name), {**form_fields, "kind": part_module.kind}


def cel_constants(fields: Mapping[str, Any]) -> tuple[float, float, float]:
    """K [N/m], Z [N·s/m] and M [kg] of a CEL's fields."""
    m = float(fields["M"])
    if fields.get("f") is None:
        return float(fields.get("K") or 0.0), float(fields.get("Z") or 0.0), m
    angular_frequency, t60 = TWO_PI * float(fields["f"]), fields.get("t60")
    decay_rate = LN_1000 / float(t60) if t60 else 0.0
    return (
        m * (angular_frequency * angular_frequency + decay_rate * decay_rate),
        2.0 * m * decay_rate,
        m,
    )


def _module_values(part_module: Module) -> _Values | None:
    if part_module.kind == "CEL":
        return cel_constants(part_module.fields)
    if part_module.kind in BODY_KINDS:
        return _body_values(part_module.fields)
    fields: Mapping[str, Any] = part_module.fields
    if part_module.kind in LINK_KINDS and fields.get("K"):
        return (float(fields["K"]),)
    return None


def _body_values(fields: Mapping[str, Any]) -> _Values | None:
    """K and Z of the links of a STRING or PLATE, up to a factor that depends on its form."""
    t60, m = fields.get("t60"), float(fields["M"])
    if t60 is not None and not isinstance(t60, float):
        return None  # its dampers depend on all its modes
    angular_frequency, decay_rate = TWO_PI * float(fields["f"]), LN_1000 / t60 if t60 else 0.0
    return m * (angular_frequency * angular_frequency + decay_rate * decay_rate), m * decay_rate
