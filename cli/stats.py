"""`ergon stats`: what the parts of a score are made of, or what hands did in a take, in figures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from ergon.api.errors import OptionError
from ergon.api.stats import PartStats, PointStats, StatsOptions
from ergon.api.stats import stats as find_stats

from . import options
from .bundled import ScorePath
from .console import Console, plural
from .outcome import Refused
from .recording import SUFFIX
from .tables import table
from .units import metres_text, seconds_text

_SHARES_SHOWN_MAX = 3  # shares of modes that are printed for a point


@click.command()
@click.argument("score_path", metavar="SCORE|TAKE", type=ScorePath())
@click.argument("parts", metavar="[PART]...", nargs=-1)
@options.from_dataclass(StatsOptions, "upto")
@click.option(
    "--cutoff",
    metavar="FREQUENCY",
    default="20Hz",
    show_default=True,
    help="Of a take: speed and acceleration below this frequency.",
)
@options.trust
@options.with_console
def stats(
    console: Console, score_path: str, parts: tuple[str, ...], cutoff: str, **arguments: Any
) -> None:
    """Say what instruments and keys are made of, or what hands did in a take, in figures.

    Each part is taken by itself, without its links to others, its contacts open and its laws at
    their slope at rest. The answer of a point is how far it goes for a force of 1 N that stays;
    its modes are those that take most of the energy of a blow there.

    Of a TAKE (.take) a PART is a hand: how far and how fast it went, what was lost, where it turned
    and struck, how smooth its strokes were, what it felt and what energy it gave.
    """
    from ergon.scores.gesture.take_file import SUFFIXES

    suffix = Path(score_path).suffix.lower()
    if suffix == SUFFIX:
        from .stats_take import print_hand_stats

        print_hand_stats(console, score_path, parts, cutoff)
        return
    if suffix in SUFFIXES:
        raise Refused(
            f"{score_path}: make a recording of this movement first: "
            f"ergon take import {score_path} -o {Path(score_path).stem}{SUFFIX}"
        )
    try:
        part_stats = find_stats(score_path, StatsOptions(parts=parts, **arguments), report=console)
    except OptionError as error:
        if error.option != "parts":
            raise
        raise Refused(f"PART: {error.reason}") from None
    if console.json:
        for part in part_stats:
            _record(console, part)
    else:
        console.data("\n".join(_stats_text(part) for part in part_stats))


def _stats_text(part_stats: PartStats) -> str:
    fixed_points = plural(part_stats.n_held, "fixed point")
    if not part_stats.n_masses:
        return f"{part_stats.part}: {fixed_points}; nothing in it moves\n"
    masses = "1 mass" if part_stats.n_masses == 1 else f"{part_stats.n_masses:,} masses"
    mass_range = _range_text(part_stats.masses, _kilograms)
    stats_text = (
        f"{part_stats.part}: {masses} of {mass_range}, {_kilograms(part_stats.mass)} in all; "
        f"{fixed_points}\n"
    )
    for name, mass in part_stats.mode_masses.items():
        stats_text += (
            f"{name}: M = {_kilograms(mass)} for each mode at level 1; the masses listed are those "
            "of the equivalent network\n"
        )
    if part_stats.links:
        table_rows = [("links", "count", "stiffness", "damping")]
        for stiff_link in part_stats.links:
            stiffness = _range_text(stiff_link.stiffness, lambda k: f"{k:.4g} N/m")
            damping = _range_text(stiff_link.damping, lambda z: f"{z:.4g} N·s/m")
            table_rows.append((stiff_link.kind, f"{stiff_link.count:,}", stiffness, damping))
        stats_text += f"\n{table(table_rows)}"
    return f"{stats_text}\n{_modes_text(part_stats)}{_points_text(part_stats)}"


def _modes_text(part_stats: PartStats) -> str:
    frequencies = part_stats.modes.frequencies[part_stats.n_free :]
    t60 = part_stats.modes.t60[part_stats.n_free :]
    modes_sentence = f"{plural(len(frequencies), 'mode')} in this range"
    if len(frequencies):
        low, high = (float(t60.min()), float(t60.max()))
        decay_text = "no loss" if math.isinf(low) else _range_text((low, high), _seconds)
        modes_sentence += f", {frequencies[0]:.2f} to {frequencies[-1]:.2f} Hz, T60 {decay_text}"
    if part_stats.n_free:
        modes_sentence += f", and {plural(part_stats.n_free, 'motion')} that no spring resists"
    stability_text = "not known to be stable by up to 16 steps a frame"
    if part_stats.guarantee is not None:
        steps = part_stats.oversampling
        steps_text = "one step a frame" if steps == 1 else f"{steps} steps a frame"
        stability_text = f"stable by {steps_text} ({part_stats.guarantee})"
    modes_text = f"{modes_sentence}; highest of all {part_stats.highest:.2f} Hz; {stability_text}\n"
    bands = zip(part_stats.third_octaves, part_stats.counts, strict=True)
    band_texts = [f"{middle:.0f} Hz: {count}" for middle, count in bands if count]
    return modes_text + (f"modes by third octave: {', '.join(band_texts)}\n" if band_texts else "")


def _points_text(part_stats: PartStats) -> str:
    if not part_stats.points:
        return ""
    table_rows = [
        ("point", "mass", "static deflection at 1 N", "mean frequency", "modes with most energy")
    ]
    for struck_point in part_stats.points:
        bound_text = (
            "no bound"
            if math.isinf(struck_point.compliance)
            else metres_text(struck_point.compliance)
        )
        mean = f"{struck_point.centroid:.1f} Hz"
        table_rows.append(
            (
                struck_point.name,
                _kilograms(struck_point.mass),
                bound_text,
                mean,
                _largest_text(part_stats, struck_point),
            )
        )
    return f"\n{table(table_rows)}"


def _largest_text(part_stats: PartStats, point_stats: PointStats) -> str:
    share_order = sorted(
        range(len(point_stats.shares)), key=lambda mode_index: -point_stats.shares[mode_index]
    )[:_SHARES_SHOWN_MAX]
    return ", ".join(
        f"{part_stats.modes.frequencies[mode_index]:.1f} Hz "
        f"{100 * point_stats.shares[mode_index]:.3g}%"
        for mode_index in share_order
        if point_stats.shares[mode_index] >= 5e-4
    )


def _range_text(low_and_high: tuple[float, float], with_unit: Any) -> str:
    low, high = with_unit(low_and_high[0]), with_unit(low_and_high[1])
    return str(low) if low == high else f"{low} to {high}"


def _kilograms(mass_kg: float) -> str:
    for factor, unit in ((1.0, "kg"), (1e-3, "g"), (1e-6, "mg")):
        if abs(mass_kg) >= factor:
            return f"{mass_kg / factor:.4g} {unit}"
    return f"{mass_kg:.4g} kg"


def _seconds(value: float) -> str:
    return "no loss" if math.isinf(value) else seconds_text(value)


def _record(console: Console, part_stats: PartStats) -> None:
    def finite(x: float) -> float | None:
        return None if math.isinf(x) else x

    frequencies = part_stats.modes.frequencies[part_stats.n_free :]
    t60 = part_stats.modes.t60[part_stats.n_free :]
    console.record(
        "stats",
        part=part_stats.part,
        masses=part_stats.n_masses,
        held=part_stats.n_held,
        mass_kg=part_stats.mass,
        mass_range_kg=list(part_stats.masses),
        mode_masses_kg=dict(part_stats.mode_masses),
        links=[
            {
                "kind": link.kind,
                "count": link.count,
                "stiffness_n_per_m": list(link.stiffness),
                "damping_ns_per_m": list(link.damping),
            }
            for link in part_stats.links
        ],
        modes=len(frequencies),
        certified=part_stats.modes.is_certified,
        free_motions=part_stats.n_free,
        frequency_range_hz=[float(frequencies[0]), float(frequencies[-1])]
        if len(frequencies)
        else [],
        t60_range_s=[finite(float(t60.min())), finite(float(t60.max()))] if len(t60) else [],
        third_octaves_hz=part_stats.third_octaves.tolist(),
        modes_by_third_octave=part_stats.counts.tolist(),
        highest_hz=part_stats.highest,
        certificate=part_stats.guarantee,
        times=part_stats.oversampling,
        points=[
            {
                "name": point.name,
                "mass_kg": point.mass,
                "compliance_m_per_n": finite(point.compliance),
                "centroid_hz": point.centroid,
                "energy_shares": point.shares.tolist(),
            }
            for point in part_stats.points
        ],
    )
