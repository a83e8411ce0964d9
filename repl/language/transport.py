"""Verbs of time: where the piece is, its tempo and its meter."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.notation.clock.meter import Meter
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.errors import TextError
from ergon.repl.language import amounts
from ergon.repl.language.commands import BlockCommand, Command, Now, When
from ergon.repl.language.forms import OVER_SLOT, Slot, Words, form


@dataclass(frozen=True, slots=True)
class Play(Command):
    """Run the piece, from a position or from where it stopped."""

    start: Position | None


@dataclass(frozen=True, slots=True)
class Stop(Command):
    """Stop the piece."""


@dataclass(frozen=True, slots=True)
class Tempo(BlockCommand):
    """`tempo 72`, or `tempo 60 -> 84 over 4bar`: then `end` and `over` are given."""

    bpm: float
    end: float | None = None
    over: Length | None = None


@dataclass(frozen=True, slots=True)
class SetMeter(BlockCommand):
    """`meter 3/4`: from a bar line on."""

    meter: Meter


@dataclass(frozen=True, slots=True)
class Tap(Command):
    """Mark a beat; two or more taps set the tempo."""


@dataclass(frozen=True, slots=True)
class Nudge(BlockCommand):
    """Delay the following beats by a length; a negative length brings them forward."""

    by: Length


@dataclass(frozen=True, slots=True)
class Quant(Command):
    """Set the boundaries on which lines act that do not say when."""

    grid: Now | Length


def set_tempo(
    bpm: tuple[float, float | None], over: Length | None, *, when: When, words: Words
) -> Tempo:
    """Set a tempo, or a ramp, which needs both tempos and a length. Raises TextError."""
    if (bpm[1] is None) != (over is None):
        faulty_word = words["over" if bpm[1] is None else "bpm"]
        message = "a ramp needs two tempos and a length: tempo 60 -> 84 over 4bar"
        raise TextError(message, offset=faulty_word.start, length=len(faulty_word.text))
    return Tempo(*bpm, over, when=when, words=words)


# fmt: off
PLAY_FORM = form("play", "pl", "starts the piece at a position, or where it was stopped",
    "play from B", Play,
    Slot("start", "WHERE", amounts.POSITION_VALUE, "from", optional=True), takes_time=False)
STOP_FORM = form("stop", "st", "stops the piece where it is", "stop", Stop)
TEMPO_FORM = form("tempo", "te", "sets the tempo, or a ramp from one tempo to another",
    "tempo 60 -> 84 over 4bar", set_tempo,
    Slot("bpm", "BPM|BPM -> BPM", amounts.BPM_VALUE, takes_many=True), OVER_SLOT)
METER_FORM = form("meter", "meter", "sets the meter from the next bar on", "meter 3+2+2/8",
    SetMeter, Slot("meter", "BEATS/UNIT", amounts.METER_VALUE))
TAP_FORM = form("tap", "ta", "marks a beat; two or more taps set the tempo",
    "tap", Tap, takes_time=False)
NUDGE_FORM = form("nudge", "n", "delays the beat, or with a minus brings it forward",
    "nudge -10ms", Nudge, Slot("by", "TIME", amounts.SHIFT_VALUE), takes_time=False)
QUANT_FORM = form("quant", "qua", "sets where lines take effect that do not say when",
    "quant 2bar", Quant, Slot("grid", "now|beat|bar|LENGTH", amounts.GRID_VALUE), takes_time=False)
# fmt: on
