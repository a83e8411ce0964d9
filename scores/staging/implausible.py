"""Warnings about values that are valid but hardly intended: extreme pitches, gaps and
stiffnesses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, pi, sqrt

from ergon.instruments.model import Module, Target
from ergon.instruments.module_kinds import KINDS, LINK_KINDS, member_count
from ergon.instruments.spread import link_count, single_links
from ergon.notation.text.errors import Diagnostic, quote
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Key


def warn_implausible(piece: Piece) -> list[Diagnostic]:
    """Report W326 to W329 and W333, each where it is written.

    Instruments under `units: ca` have no SI values to check.
    """
    modules_by_name = _ModulesByName.from_piece(piece)
    warnings: list[Diagnostic] = []
    for instrument in piece.instruments.values():
        if instrument.form != "si":
            continue
        for part_module in instrument.modules:
            module_name = ".".join(filter(None, (instrument.name, part_module.name)))
            warnings += _warn_pitches(piece, module_name, part_module)
            if part_module.kind == "BUT":
                warnings += modules_by_name.contact_warnings(module_name, part_module)
            if part_module.kind in LINK_KINDS:
                warnings += modules_by_name.stiffness_warnings(piece, module_name, part_module)
            if part_module.kind == "BRISTLE":
                warnings += _warn_friction_gains(module_name, part_module)
    return warnings


def _warn_pitches(piece: Piece, module_name: str, part_module: Module) -> Iterator[Diagnostic]:
    """Report W326 for strings and plates; a CEL above half of the rate is refused elsewhere
    (E309).
    """
    module_frequency, frequency_max = part_module.fields.get("f"), 0.5 * piece.rate
    if (
        part_module.kind in ("STRING", "PLATE")
        and isinstance(module_frequency, float)
        and module_frequency > frequency_max
    ):
        message = (
            f"the pitch of {quote(module_name)} is {_hertz_text(module_frequency)}, above half of "
            f"the rate ({_hertz_text(frequency_max)}): no file can hold it"
        )
        place = part_module.places.get("f", part_module.place)
        yield Diagnostic("W326", message, place, None, "choose a lower pitch or a higher rate")


def _warn_friction_gains(module_name: str, bristle: Module) -> Iterator[Diagnostic]:
    """Report W333 if friction with memory may generate energy (Barabanov and Ortega, 2000)."""
    bristle_fields = bristle.fields
    friction_level, static_friction = bristle_fields["Fc"], bristle_fields["Fs"]
    if (
        not isinstance(friction_level, float)
        or not isinstance(static_friction, float)
        or friction_level <= 0.0
    ):
        return
    viscosity_min = bristle_fields["sigma1"] * (static_friction - friction_level) / friction_level
    if bristle_fields["sigma2"] < viscosity_min:
        message = f"friction {quote(module_name)} can give energy: its sigma2 is below "
        message += f"sigma1*(Fs - Fc)/Fc, {viscosity_min:.3g} Ns/m"
        sigma1_max = bristle_fields["sigma2"] * friction_level / (static_friction - friction_level)
        help_text = f"make sigma2 {viscosity_min:.3g} Ns/m or more"
        if sigma1_max > 0.0:
            help_text += f", or sigma1 {sigma1_max:.3g} Ns/m or less"
        place = bristle.places.get("sigma1", bristle.place)
        yield Diagnostic("W333", message, place, None, help_text)


@dataclass
class _ModulesByName:
    """Modules and keys by name, to look up the ends of links."""

    keys: dict[str, Key]
    modules: dict[tuple[str, str], Module] = field(default_factory=dict)
    imposed_points: set[tuple[str, str, object]] = field(default_factory=set)

    @classmethod
    def from_piece(cls, piece: Piece) -> _ModulesByName:
        modules_by_name = cls(dict(piece.keys))
        for part, part_module in piece.modules():
            modules_by_name.modules[part, part_module.name] = part_module
            target = part_module.fields.get("to")
            if part_module.kind == "ENX" and isinstance(target, Target):
                modules_by_name.imposed_points.add((target.part, target.module, target.first))
        return modules_by_name

    def contact_warnings(self, name: str, contact: Module) -> Iterator[Diagnostic]:
        """Report W327 for a contact that is pressed at the beginning, W329 for one that the travel
        cannot close.
        """
        end_modules = (self.modules[end.part, end.module] for end in contact.ends)
        if any("axes" in end.fields for end in end_modules):
            return  # points in space start where they are
        side_sign = 1.0 if contact.fields["side"] == "below" else -1.0
        gap_place = contact.places.get("gap", contact.place)
        deepest_overlap, nearest_gap = -inf, -inf  # the deepest of the points of a range
        for link in single_links(contact):
            (first_end, second_end), gap = link.ends, link.fields["gap"]
            overlap = (
                side_sign * (self._initial_position(first_end) - self._initial_position(second_end))
                - gap
            )
            deepest_overlap = max(deepest_overlap, overlap) if gap < 0.0 else deepest_overlap
            (low_a, high_a), (low_b, high_b) = (
                self._travel_range(first_end),
                self._travel_range(second_end),
            )
            # The deepest overlap that the travels allow; an end without a travel stays where it
            # begins.
            nearest_gap = max(
                nearest_gap, (high_a - low_b if side_sign > 0 else high_b - low_a) - gap
            )
        if deepest_overlap > 0.0:
            message = (
                f"the gap of contact {quote(name)} is negative: its ends are pressed together "
            )
            message += f"by {_millimetres_text(deepest_overlap)} from the beginning"
            help_text = "write a gap of 0 or more, or a RES or REF where the two are tied for good"
            yield Diagnostic("W327", message, gap_place, None, help_text)
        has_travel = any(self._travelling_key(end) is not None for end in contact.ends)
        if has_travel and nearest_gap <= 0.0:
            message = (
                f"contact {quote(name)} is beyond the travel of its key: at the end of the travel "
            )
            message += f"its ends are still {_millimetres_text(-nearest_gap)} apart"
            help_text = "make the gap smaller than the travel, or the travel longer"
            yield Diagnostic("W329", message, gap_place, None, help_text)

    def stiffness_warnings(self, piece: Piece, name: str, link: Module) -> Iterator[Diagnostic]:
        """Report W328 if half a period of the two ends, or a touch, is shorter than a frame."""
        scaled_field = KINDS[link.kind].scaled_fields[0]
        stiffness = link.fields.get(scaled_field)
        if not isinstance(stiffness, float) or stiffness <= 0.0:
            return
        is_contact = link.kind == "BUT"
        if is_contact and (link.fields["exponent"] != 1.0 or link.fields["contact"] == "magic"):
            return
        end_targets = link.ends
        # If one mass is linked to a range, all its links pull on it together.
        inverse_mass = sum(
            link_count(end_targets) / end.count / self._mat_mass(end) for end in end_targets
        )
        if inverse_mass == 0.0:
            return
        half_period = pi / sqrt(
            stiffness * inverse_mass
        )  # of a period; as long as a touch lasts [s]
        if half_period >= 1.0 / piece.rate:
            return
        duration_text = "a touch lasts" if is_contact else "half a period lasts"
        message = (
            f"{quote(name)} is stiffer than the rate can follow: {duration_text} "
            f"{1e6 * half_period:.3g} "
            "us, "
        )
        message += f"a frame {1e6 / piece.rate:.3g} us"
        stiffness_max = pi * pi * piece.rate * piece.rate / inverse_mass
        help_text = f"stay below {stiffness_max:.3g} N/m, or make the masses heavier"
        yield Diagnostic(
            "W328", message, link.places.get(scaled_field, link.place), None, help_text
        )

    def _travelling_key(self, end: Target) -> Key | None:
        key = self.keys.get(end.part)
        return key if key is not None and key.travel and key.struck == end.module else None

    def _travel_range(self, end: Target) -> tuple[float, float]:
        travel_key = self._travelling_key(end)
        if travel_key is None or travel_key.travel is None:
            start = self._initial_position(end)
            return start, start
        low, high = travel_key.travel
        return travel_key.reach * low, travel_key.reach * high

    def _initial_position(self, end: Target) -> float:
        """The initial position of a single mass [m]; members of generators begin at 0."""
        module = self.modules[end.part, end.module]
        start = module.fields.get("X0")
        lever_ratio = self.keys[end.part].reach if end.part in self.keys else 1.0
        return lever_ratio * start if isinstance(start, float) else 0.0

    def _mat_mass(self, end: Target) -> float:
        """The mass of one MAT [kg], as the piece sees it; infinite if it is fixed or its position
        imposed.
        """
        end_module = self.modules[end.part, end.module]
        if end_module.kind == "SOL" or (end.part, end.module, end.first) in self.imposed_points:
            return inf
        if end_module.kind == "PROXY":  # bound by its lightest mass
            shares = end_module.fields["shares"] or (1.0,)
            inverse_mass = max(
                1.0 / self._mat_mass(component) for component in end_module.fields["of"]
            )
            inverse_mass *= sum(share * share for share in shares)
            return 1.0 / inverse_mass if inverse_mass else inf
        end_mass = end_module.fields["M"]
        if end_module.kind in ("STRING", "PLATE", "CHAIN", "CLOTH", "GRAINS"):
            end_mass /= member_count(end_module.kind, end_module.fields)
        key = self.keys.get(end.part)
        end_mass = end_mass if key is None else end_mass / (key.reach * key.reach)
        return float(end_mass)


def _hertz_text(frequency: float) -> str:
    return f"{frequency / 1e3:.3g} kHz"


def _millimetres_text(length: float) -> str:
    return f"{1e3 * length:.3g} mm"
