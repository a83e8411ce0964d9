"""The beat of the piece at a time of the engine, and the next boundary of a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.shifted import ShiftedTempoMap, StoppedTempoMap

if TYPE_CHECKING:
    from ergon.notation.clock.positions import Length
    from ergon.notation.clock.tempo import TempoMap

# The joining curve before a gesture [s]; a version takes over before it begins.
JOIN_DURATION = 0.02


@dataclass(frozen=True, slots=True)
class Clock:
    """How beats map to time: a running piece began at second `begin_instant` of the engine, a
    stopped one is at beat `stopped_beat`.
    """

    begin_instant: float | None = None
    stopped_beat: float = 0.0

    @property
    def is_running(self) -> bool:
        """Whether the piece is running."""
        return self.begin_instant is not None

    def engine_tempo_map(self, tempo_map: TempoMap, seconds_now: float) -> TempoMap:
        """The tempo map in seconds of the engine, which is at second `seconds_now`."""
        if self.begin_instant is not None:
            return ShiftedTempoMap(tempo_map, self.begin_instant)
        return StoppedTempoMap(tempo_map, self.stopped_beat, seconds_now)

    def beat(self, tempo_map: TempoMap, seconds: float) -> float:
        """The beat of the piece at a second of the engine."""
        return (
            self.stopped_beat
            if self.begin_instant is None
            else max(0.0, tempo_map.beats(seconds - self.begin_instant))
        )

    def seconds(self, tempo_map: TempoMap, beat: float) -> float:
        """The second of the engine at a beat; the piece must be running."""
        assert self.begin_instant is not None
        return tempo_map.seconds(beat) + self.begin_instant


class Timing(NamedTuple):
    """The frames of an engine: `rate` a second [Hz], and `tick_frames` a tick."""

    rate: float
    tick_frames: int

    @property
    def tick_seconds(self) -> float:
        """A tick [s]."""
        return self.tick_frames / self.rate

    @property
    def takeover_lead(self) -> float:
        """How long a version takes over before its beat [s]."""
        return JOIN_DURATION + self.tick_seconds

    def change_lead(self, is_cut: bool) -> float:
        """How long before its beat a change takes over [s]; a cut needs no time before it."""
        return 0.0 if is_cut else self.takeover_lead

    def takeover_frame(
        self, clock: Clock, tempo_map: TempoMap, takeover_beat: float, lead: float | None = None
    ) -> int:
        """The frame at which a version takes over, for a beat on which it acts: `lead` [s]
        before it.
        """
        lead = self.takeover_lead if lead is None else lead
        frames = (clock.seconds(tempo_map, takeover_beat) - lead) * self.rate
        return math.floor(frames / self.tick_frames + SAME) * self.tick_frames


class TakeoverBeats(NamedTuple):
    """A takeover: the clock from there on, the beat on which the version before ends, and that on
    which the new one goes on.
    """

    clock: Clock
    leave_beat: float
    enter_beat: float


def takeover_beats(
    clock: Clock,
    old_tempo_map: TempoMap,
    new_tempo_map: TempoMap,
    line_beat: float,
    start_frame: int,
    sets_running: bool | None,
    enter_beat: float | None,
    timing: Timing,
) -> TakeoverBeats:
    """The takeover of a line that acts on `line_beat`, at frame `start_frame`.

    It may start the piece at that beat, stop it (`sets_running`), or let it go on from
    `enter_beat`.
    """
    start_instant = start_frame / timing.rate
    if sets_running is not None:
        leave_beat = clock.beat(old_tempo_map, start_instant)
        new_clock = running_clock(new_tempo_map, line_beat, start_instant + timing.takeover_lead)
        return TakeoverBeats(
            new_clock if sets_running else Clock(None, leave_beat), leave_beat, line_beat
        )
    if enter_beat is not None:
        new_clock = clock_at_beat(
            clock, new_tempo_map, enter_beat, start_instant + timing.takeover_lead
        )
        return TakeoverBeats(new_clock, line_beat, enter_beat)
    new_clock, takeover_beat = clock_after_takeover(
        clock,
        old_tempo_map,
        new_tempo_map,
        line_beat,
        start_instant + timing.takeover_lead,
        timing.tick_seconds,
    )
    return TakeoverBeats(new_clock, takeover_beat, takeover_beat)


def running_clock(tempo_map: TempoMap, beat: float, seconds: float) -> Clock:
    """The clock of a piece that is at `beat` at a second of the engine, and runs."""
    return Clock(seconds - tempo_map.seconds(beat), beat)


def clock_at_beat(clock: Clock, tempo_map: TempoMap, beat: float, seconds: float) -> Clock:
    """The clock of another piece, which continues at a beat if this one runs, else stops there."""
    return running_clock(tempo_map, beat, seconds) if clock.is_running else Clock(None, beat)


def clock_after_takeover(
    clock: Clock,
    old_tempo_map: TempoMap,
    new_tempo_map: TempoMap,
    takeover_beat: float,
    takeover_instant: float,
    tick_seconds: float,
) -> tuple[Clock, float]:
    """The clock and the beat with which a version takes over that may have another tempo map.

    If the piece has already jumped past that beat, one tick [s] before, it continues from where
    it is.
    """
    if (
        not clock.is_running
        or clock.beat(old_tempo_map, takeover_instant - tick_seconds) <= takeover_beat + SAME
    ):
        return clock, takeover_beat
    current_beat = clock.beat(old_tempo_map, takeover_instant)
    is_same = new_tempo_map.seconds(current_beat) == old_tempo_map.seconds(current_beat)
    return (
        clock if is_same else running_clock(new_tempo_map, current_beat, takeover_instant)
    ), current_beat


def next_boundary(tempo_map: TempoMap, from_beat: float, grid: Length) -> float:
    """The first beat, not before `from_beat`, that is a multiple of `grid`. Bars count from the
    first one, beats from the beginning of their bar, seconds from the beginning of the piece.
    """
    bars = tempo_map.bars
    bar, beat_in_bar = bars.bar_beat(from_beat)
    if grid.bars:
        bar_step = max(1, round(grid.bars))
        bar += beat_in_bar > 1.0 + SAME
        return bars.start(bar + (1 - bar) % bar_step)
    if grid.beats:
        beat_steps = math.ceil((beat_in_bar - 1.0 - SAME) / grid.beats)
        return min(bars.start(bar) + beat_steps * grid.beats, bars.start(bar + 1))
    seconds = tempo_map.seconds(from_beat)
    return tempo_map.beats(math.ceil(seconds / grid.seconds - SAME) * grid.seconds)
