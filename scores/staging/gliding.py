"""Parameters on their way from one version of a piece to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.instruments.kinds import LINKS

if TYPE_CHECKING:
    from ergon.instruments.assemble import Assembly
    from ergon.instruments.model import Module
    from ergon.scores.reading.piece import Piece

# Of a CEL k, z, m; of a link K, by which its force goes; of a STRING or PLATE K and Z of its links,
# but for a factor that stays.
_Values = tuple[float, ...]
TWO_PI = 6.283185307179586
LN_1000 = 6.907755278982137  # a decay by 60 dB
_BODIES = ("STRING", "PLATE")
_TUNING = ("f", "t60", "M", "X0", "V0")


@dataclass(frozen=True, slots=True)
class Glide:
    """A module's parameters go evenly from `before` to `after` between two instants [s]."""

    part: str
    module: str
    before: _Values
    after: _Values
    start: float
    stop: float

    def at(self, instant: float) -> _Values:
        """Where they are."""
        share = min(1.0, max(0.0, (instant - self.start) / (self.stop - self.start)))
        pairs = zip(self.before, self.after, strict=True)
        return tuple(before + (after - before) * share for before, after in pairs)

    def factors(self) -> tuple[float, float]:
        """K and Z of a body's links before, as factors of what they are after."""
        pairs = zip(self.before, self.after, strict=True)
        k, z = (before / after if after else 1.0 for before, after in pairs)
        return k, z

    def put(self, timeline: _core.Timeline, assembly: Assembly) -> None:
        """Let it happen on a timeline. Raises EngineError."""
        where = self.part, self.module
        if len(self.before) == 3:
            k, z, m = self.before
            timeline.glide(assembly.mats[where], k, z, m, self.start, self.stop)
        elif len(self.before) == 2:
            first, count = assembly.bodies[where]
            points = [(self.start, *self.factors()), (self.stop, 1.0, 1.0)]
            timeline.lead(first, points, n=count)
        else:
            ratio = self.before[0] / self.after[0]
            timeline.fade(assembly.links[where], ratio, 1.0, self.start, self.stop)


def glides(
    before: Piece, after: Piece, running: Iterable[Glide], start: float, seconds: float
) -> tuple[Glide, ...]:
    """What glides from `start` [s] on, when a piece takes over from another: for so many seconds
    what differs, and what is `running` already to its end. A link that is new comes from no force,
    where it joins what was there before."""
    old, new = dict(_values(before)), dict(_values(after))
    forms = dict(_forms(before)), dict(_forms(after))
    under_way = {(g.part, g.module): g for g in running if g.stop > start}
    found = {}
    for where, values in new.items():
        current = under_way.get(where)
        if where not in old and len(values) == 1 and _joins(after, where, before):
            found[where] = current or Glide(*where, (0.0,), values, start, start + seconds)
            continue
        if where not in old or len(old[where]) != len(values):
            continue
        if len(values) == 2 and forms[0].get(where) != forms[1][where]:
            continue  # another body takes its place
        if current is not None and current.after == values:
            found[where] = current
        elif old[where] != values:
            now = old[where] if current is None else current.at(start)
            found[where] = Glide(*where, now, values, start, start + seconds)
    return tuple(found.values())


def _joins(piece: Piece, where: tuple[str, str], before: Piece) -> bool:
    """Whether a link has an end in a part that another piece has too."""
    part, name = where
    owner = piece.keys.get(part) or piece.instruments[part]
    module = next(module for module in owner.modules if module.name == name)
    ends = {end.part for end in module.fields["between"]}
    return any(end in before.keys or end in before.instruments for end in ends)


def _values(piece: Piece) -> Iterator[tuple[tuple[str, str], _Values]]:
    """The parameters that can glide, by (part, module), as the scene sees them."""
    for key in piece.keys.values():
        for module in key.modules:
            if (values := _of(module)) is not None:
                scale = 1.0 / (key.reach * key.reach)
                yield (key.name, module.name), tuple(value * scale for value in values)
    for instrument in piece.instruments.values():
        for module in instrument.modules:
            # Algorithmic parameters are what they are at their rate: they are set at once.
            if instrument.ca_rate is None and (values := _of(module)) is not None:
                yield (instrument.name, module.name), values


def _forms(piece: Piece) -> Iterator[tuple[tuple[str, str], Mapping[str, Any]]]:
    """What is not pitch, decay or mass of the STRINGs and PLATEs of a piece."""
    for instrument in piece.instruments.values():
        for module in instrument.modules:
            if module.kind in _BODIES:
                form = {name: own for name, own in module.fields.items() if name not in _TUNING}
                yield (instrument.name, module.name), {**form, "kind": module.kind}


def ties(fields: Mapping[str, Any]) -> tuple[float, float, float]:
    """K [N/m], Z [N·s/m] and M [kg] of a CEL's fields."""
    mass = float(fields["M"])
    if fields.get("f") is None:
        return float(fields.get("K") or 0.0), float(fields.get("Z") or 0.0), mass
    omega, t60 = TWO_PI * float(fields["f"]), fields.get("t60")
    sigma = LN_1000 / float(t60) if t60 else 0.0
    return mass * (omega * omega + sigma * sigma), 2.0 * mass * sigma, mass


def _of(module: Module) -> _Values | None:
    if module.kind == "CEL":
        return ties(module.fields)
    if module.kind in _BODIES:
        return _of_body(module.fields)
    fields: Mapping[str, Any] = module.fields
    if module.kind in LINKS and fields.get("K"):
        return (float(fields["K"]),)
    return None


def _of_body(fields: Mapping[str, Any]) -> _Values | None:
    """K and Z of the links of a STRING or PLATE, but for a factor that its form says."""
    t60, mass = fields.get("t60"), float(fields["M"])
    if t60 is not None and not isinstance(t60, float):
        return None  # its dampers follow from all of its modes
    omega, sigma = TWO_PI * float(fields["f"]), LN_1000 / t60 if t60 else 0.0
    return mass * (omega * omega + sigma * sigma), mass * sigma
