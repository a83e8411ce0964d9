"""What hands did in a take, in figures: `ergon stats FILE.take`."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from ergon.api.errors import OptionError
from ergon.api.take_stats import TakeStatsOptions, take_stats
from ergon.common.terminal import printable

from .console import Console, plural
from .outcome import Refused
from .recording import NAMES_MAX
from .units import metres, seconds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ergon.api.take_stats import ForceStats, HandStats
    from ergon.scores.gesture.movement import MovementStats

_LISTED = 12  # instants of strikes that are listed


def print_hand_stats(console: Console, path: str, hands: tuple[str, ...], cutoff: str) -> None:
    """Print the statistics of hands. Raises OptionError, and Refused where there is no take."""
    from ergon.scores.gesture.take_file import TakeError

    try:
        found = take_stats(path, TakeStatsOptions(hands=hands, cutoff=cutoff))
    except TakeError as error:
        raise Refused(error.message) from None
    except OptionError as error:
        if error.option != "hands":
            raise
        raise Refused(f"PART: {error.reason}") from None
    for hand in found:
        if console.json:
            _record(console, hand)
        else:
            console.data("".join(f"{printable(line)}\n" for line in _lines(hand)))


def _lines(hand: HandStats) -> Iterator[str]:
    lost = f"{hand.n_lost:,} lost" if hand.n_lost else "none lost"
    held = f", {hand.n_held:,} without a new position" if hand.n_held else ""
    last = "" if hand.movement is None else f"{seconds(hand.movement.duration)}, "
    yield f"{hand.hand[:NAMES_MAX]}: {last}{plural(hand.n_ticks, 'tick')}, {lost}{held}"
    if hand.movement is not None:
        yield from _of_movement(hand.movement)
    if hand.force is not None:
        yield from _of_force(hand.force)


def _of_movement(own: MovementStats) -> Iterator[str]:
    yield (
        f"  position      {metres(own.low)} to {metres(own.high)}, rms {metres(own.rms)} about "
        f"its mean; {metres(own.path)} in all"
    )
    yield (
        f"  speed         peak {metres(own.speed_peak)}/s, rms {metres(own.speed_rms)}/s "
        f"below {own.cutoff:g} Hz"
    )
    yield (
        f"  acceleration  peak {own.acceleration_peak:.3g} m/s², rms "
        f"{own.acceleration_rms:.3g} m/s²"
    )
    yield f"  spectrum      of the velocity: {own.centre:.3g} Hz, ±{own.bandwidth:.3g} Hz"
    turned = f"  reversals     {len(own.reversals):,}"
    if len(own.strikes):
        told = ", ".join(f"{t:.3f}" for t in own.strikes[:_LISTED])
        more = ", …" if len(own.strikes) > _LISTED else ""
        turned += f"; {plural(len(own.strikes), 'strike')}, at {told}{more} s"
    yield turned
    if own.smoothness is not None:
        yield f"  smoothness    {own.smoothness:.3f} (spectral arc length, median of its strokes)"


def _of_force(own: ForceStats) -> Iterator[str]:
    if not own.peak:
        yield f"  force         none felt; sent up to {own.sent:.3g} N"
        return
    yield f"  force felt    peak {own.peak:.3g} N, rms {own.rms:.3g} N; sent up to {own.sent:.3g} N"
    yield f"  energy        given {_joules(own.given)}, got back {_joules(own.taken)}"


def _joules(value: float) -> str:
    for factor, unit in ((1.0, "J"), (1e-3, "mJ"), (1e-6, "µJ")):
        if value >= factor:
            return f"{value / factor:.3g} {unit}"
    return f"{value * 1e9:.3g} nJ"


def _record(console: Console, hand: HandStats) -> None:
    own, force = hand.movement, hand.force
    movement = None
    if own is not None:
        movement = {f.name: getattr(own, f.name) for f in fields(own)}
        movement |= {"reversals": own.reversals.tolist(), "strikes": own.strikes.tolist()}
    console.record(
        "hand",
        hand=hand.hand,
        ticks=hand.n_ticks,
        lost=hand.n_lost,
        held=hand.n_held,
        movement=movement,
        force=None if force is None else {f.name: getattr(force, f.name) for f in fields(force)},
    )
