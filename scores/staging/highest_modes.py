"""The highest mode of each string and plate, and how many masses a higher one would need."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, pi, sqrt
from pathlib import Path

from ergon.instruments.model import Module
from ergon.instruments.module_kinds import member_count
from ergon.notation.text.errors import Diagnostic, quote
from ergon.notation.text.files import is_shipped
from ergon.notation.text.values import Place
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.built_network import BuiltNetwork
from ergon.scores.staging.parameter_values import ModuleKey, Points

FULL_BANDWIDTH_HZ = 5_000.0  # [Hz] a body without modes above sounds dull
_RADIUS_MAX = 400
_BODIES_MAX = 256  # bodies of a score that are checked


@dataclass(frozen=True, slots=True)
class HighestMode:
    """The highest mode [Hz] of a STRING or PLATE, by itself."""

    name: str
    module: Module
    frequency: float


def highest_modes(piece: Piece, built_network: BuiltNetwork) -> list[HighestMode]:
    """The highest modes of the first 256 bodies of instruments in SI units, in the order of the
    score.
    """
    return list(_bodies_and_modes(piece, built_network))


def _bodies_and_modes(piece: Piece, built_network: BuiltNetwork) -> Iterator[HighestMode]:
    assembly = built_network.assembly
    n_bodies_left = _BODIES_MAX
    for instrument in piece.instruments.values():
        for part_module in instrument.modules:
            first_mat = assembly.mats.get((instrument.name, part_module.name))
            if (
                part_module.kind not in ("STRING", "PLATE")
                or first_mat is None
                or instrument.ca_rate
            ):
                continue
            if n_bodies_left == 0:
                return
            n_bodies_left -= 1
            name = ".".join(filter(None, (instrument.name, part_module.name)))
            yield HighestMode(name, part_module, assembly.network.highest_mode(first_mat))


def warn_low_modes(modes: list[HighestMode]) -> list[Diagnostic]:
    """Report W331 for each body whose highest mode is below 5 kHz, with the number of masses that
    would suffice.

    Each place in a file is reported once, because notes and copies share it; the library is not
    reported.
    """
    lowest_by_place: dict[Place, HighestMode] = {}
    for highest_mode in modes:
        lowest_mode = lowest_by_place.setdefault(highest_mode.module.place, highest_mode)
        if highest_mode.frequency < lowest_mode.frequency:
            lowest_by_place[highest_mode.module.place] = highest_mode
    warnings = []
    for highest_mode in lowest_by_place.values():
        if highest_mode.frequency >= FULL_BANDWIDTH_HZ or is_shipped(
            Path(highest_mode.module.place.file)
        ):
            continue
        message = (
            f"{quote(highest_mode.name)} has no mode above {highest_mode.frequency / 1e3:.3g} kHz"
        )
        help_text = (
            f"{_count_advice(highest_mode)} would reach about {FULL_BANDWIDTH_HZ / 1e3:g} kHz"
        )
        place = highest_mode.module.place
        warnings.append(Diagnostic("W331", message, place, None, help_text))
    return warnings


def warn_over_limit(
    piece: Piece, built_network: BuiltNetwork, paths: Mapping[ModuleKey, Points]
) -> list[Diagnostic]:
    """Report W332 for each body that automation leads beyond what one step a frame can follow.

    The scheme is stable up to a mode at the rate over pi.
    """
    warnings, frequency_limit = [], piece.rate / pi
    for highest_mode in highest_modes(piece, built_network):
        module_key = (
            highest_mode.name.removesuffix(f".{highest_mode.module.name}"),
            highest_mode.module.name,
        )
        path_points = paths.get(module_key, ())
        factor_max = max((factor for _, factor, _ in path_points), default=1.0)
        if (
            highest_mode.frequency >= frequency_limit
            or highest_mode.frequency * sqrt(factor_max) < frequency_limit
        ):
            continue
        automation_lines = [line for line in piece.automation if module_key in line.modules]
        body_place = next(
            (line.place for line in automation_lines if line.parameter == "f"),
            highest_mode.module.place,
        )
        limit_instant = _instant_of_factor(
            path_points, (frequency_limit / highest_mode.frequency) ** 2
        )
        tempo = piece.tempo_map
        n_steps = ceil(highest_mode.frequency * sqrt(factor_max) / frequency_limit)
        message = (
            f"from {tempo.written(tempo.beats(limit_instant))} ({limit_instant:.2f} s) on the "
            f"highest mode of {quote(highest_mode.name)} is above {frequency_limit / 1e3:.3g} kHz, "
            "the limit at one step a frame; it reaches "
            f"{highest_mode.frequency * sqrt(factor_max) / 1e3:.3g} kHz"
        )
        help_text = (
            f"a plan takes {n_steps} steps a frame or another method there, unless the score "
            f"has `method: ca`; a rate of {n_steps * piece.rate:,.0f} Hz or fewer masses cost "
            "less"
        )
        warnings.append(Diagnostic("W332", message, body_place, None, help_text))
    return warnings


def _instant_of_factor(path_points: Points, factor: float) -> float:
    """The instant at which the first number of the points first reaches a factor [s]."""
    for (begin_instant, low, _), (end_instant, high, _) in pairwise(path_points):
        if low < factor <= high:
            return begin_instant + (end_instant - begin_instant) * (factor - low) / (high - low)
    return path_points[0][0]


def _count_advice(mode: HighestMode) -> str:
    """What to write so that the highest mode is at about 5 kHz."""
    part_module, module_fields = mode.module, mode.module.fields
    n_masses, needed_factor = (
        member_count(part_module.kind, module_fields),
        FULL_BANDWIDTH_HZ / mode.frequency,
    )
    if part_module.kind == "STRING":
        return f"`masses: {ceil(n_masses * needed_factor)}`"
    # The highest mode of a lattice is inversely proportional to its spacing; if the plate bends, to
    # the square of it.
    masses_factor = sqrt(needed_factor) if module_fields["bending"] is not None else needed_factor
    if module_fields["shape"] == "rectangle":
        n_across, n_up = (ceil(count * masses_factor) for count in module_fields["sides"])
        return f"{n_across * n_up:,} masses ({n_across} by {n_up})"
    radius = ceil(module_fields["radius"] * masses_factor)
    if radius > _RADIUS_MAX:
        return f"more than the {_RADIUS_MAX} rings that a plate may have"
    wider_fields = {**module_fields, "radius": radius}
    return f"{member_count(part_module.kind, wider_fields):,} masses ({radius} rings)"
