"""`ergon stats FILE.take`: figures of the movement of each hand in a take."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from ergon.api.errors import OptionError
from ergon.api.take_stats import TakeStatsOptions, take_stats
from ergon.common.terminal import printable

from .console import Console, plural
from .outcome import Refused
from .recording import NAMES_MAX
from .units import metres_text, seconds_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ergon.api.take_stats import ForceStats, HandStats
    from ergon.scores.gesture.movement import MovementStats

_STRIKES_LISTED_MAX = 12  # instants of strikes that are listed


def print_hand_stats(console: Console, path: str, hands: tuple[str, ...], cutoff: str) -> None:
    """Print the statistics of hands. Raises OptionError, and Refused where there is no take."""
    from ergon.scores.gesture.take_file import TakeError

    try:
        hands_stats = take_stats(path, TakeStatsOptions(hands=hands, cutoff=cutoff))
    except TakeError as error:
        raise Refused(error.message) from None
    except OptionError as error:
        if error.option != "hands":
            raise
        raise Refused(f"PART: {error.reason}") from None
    for hand in hands_stats:
        if console.json:
            _record(console, hand)
        else:
            console.data("".join(f"{printable(line)}\n" for line in _lines(hand)))


def _lines(hand: HandStats) -> Iterator[str]:
    lost = f"{hand.n_lost:,} lost" if hand.n_lost else "none lost"
    missed_text = f", {hand.n_held:,} without a new position" if hand.n_held else ""
    duration_text = "" if hand.movement is None else f"{seconds_text(hand.movement.duration)}, "
    yield (
        f"{hand.hand[:NAMES_MAX]}: {duration_text}{plural(hand.n_ticks, 'tick')}, "
        f"{lost}{missed_text}"
    )
    if hand.movement is not None:
        yield from _movement_lines(hand.movement)
    if hand.force is not None:
        yield from _force_lines(hand.force)


def _movement_lines(movement: MovementStats) -> Iterator[str]:
    yield (
        f"  position      {metres_text(movement.low)} to {metres_text(movement.high)}, rms "
        f"{metres_text(movement.rms)} about "
        f"its mean; {metres_text(movement.path)} in all"
    )
    yield (
        f"  speed         peak {metres_text(movement.speed_peak)}/s, rms "
        f"{metres_text(movement.speed_rms)}/s below {movement.cutoff:g} Hz"
    )
    yield (
        f"  acceleration  peak {movement.acceleration_peak:.3g} m/s², rms "
        f"{movement.acceleration_rms:.3g} m/s²"
    )
    yield f"  spectrum      of the velocity: {movement.centre:.3g} Hz, ±{movement.bandwidth:.3g} Hz"
    reversals_text = f"  reversals     {len(movement.reversals):,}"
    if len(movement.strikes):
        instants = ", ".join(f"{instant:.3f}" for instant in movement.strikes[:_STRIKES_LISTED_MAX])
        ellipsis = ", …" if len(movement.strikes) > _STRIKES_LISTED_MAX else ""
        reversals_text += f"; {plural(len(movement.strikes), 'strike')}, at {instants}{ellipsis} s"
    yield reversals_text
    if movement.smoothness is not None:
        yield (
            f"  smoothness    {movement.smoothness:.3f} (spectral arc length, median of its "
            "strokes)"
        )


def _force_lines(force_stats: ForceStats) -> Iterator[str]:
    if not force_stats.peak:
        yield f"  force         none felt; sent up to {force_stats.sent:.3g} N"
        return
    yield (
        f"  force felt    peak {force_stats.peak:.3g} N, rms {force_stats.rms:.3g} N; sent up to "
        f"{force_stats.sent:.3g} N"
    )
    yield (
        f"  energy        given {_joules(force_stats.given)}, got back {_joules(force_stats.taken)}"
    )


def _joules(energy_joules: float) -> str:
    for factor, unit in ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ")):
        if energy_joules >= factor:
            return f"{energy_joules / factor:.3g} {unit}"
    return f"{energy_joules * 1e9:.3g} nJ"


def _record(console: Console, hand: HandStats) -> None:
    movement_stats, force_stats = hand.movement, hand.force
    movement_fields = None
    if movement_stats is not None:
        movement_fields = {
            field.name: getattr(movement_stats, field.name) for field in fields(movement_stats)
        }
        movement_fields |= {
            "reversals": movement_stats.reversals.tolist(),
            "strikes": movement_stats.strikes.tolist(),
        }
    console.record(
        "hand",
        hand=hand.hand,
        ticks=hand.n_ticks,
        lost=hand.n_lost,
        held=hand.n_held,
        movement=movement_fields,
        force=None
        if force_stats is None
        else {field.name: getattr(force_stats, field.name) for field in fields(force_stats)},
    )
