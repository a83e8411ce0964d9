"""A tempo map whose piece does not begin with the engine's first frame."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.values import Time

# The instant of what never happens [s]: about 30 years on, where frames are still counted exactly.
NEVER = 1e9


class OffsetTempoMap(TempoMap):
    """A tempo map that does not begin at the engine's first frame: some beats may be past when the
    engine begins.
    """


class ShiftedTempoMap(OffsetTempoMap):
    """The beats of a piece at instants `offset_seconds` seconds later."""

    def __init__(self, base: TempoMap, offset_seconds: float) -> None:
        """Share the state of `base`, a complete tempo map."""
        self.__dict__.update(base.__dict__)
        self.offset_seconds = offset_seconds

    def _state(self) -> tuple[object, ...]:
        return (*super()._state(), self.offset_seconds)

    def seconds(self, beats: float) -> float:
        """Seconds of the engine at a beat of the piece."""
        return super().seconds(beats) + self.offset_seconds

    def beats(self, seconds: float) -> float:
        """The beat of the piece at an instant of the engine."""
        return super().beats(seconds - self.offset_seconds)

    def instant(self, start_beats: float, time: Time) -> float:
        """Seconds of the engine of a time counted from beat `start_beats`."""
        return self.seconds(start_beats + time.beats) + time.seconds


class StoppedTempoMap(OffsetTempoMap):
    """A piece that is stopped at a beat: earlier beats are over, later ones never come."""

    def __init__(self, base: TempoMap, stop_beat: float, stop_instant: float) -> None:
        """Share the state of `base`, a complete tempo map; `stop_instant` is an instant of the
        engine [s].
        """
        self.__dict__.update(base.__dict__)
        self.stop_beat, self.stop_instant = stop_beat, stop_instant

    def _state(self) -> tuple[object, ...]:
        return (*super()._state(), self.stop_beat, self.stop_instant)

    def seconds(self, beats: float) -> float:
        """`stop_instant` up to the beat where the piece is stopped, NEVER after it."""
        return self.stop_instant if beats <= self.stop_beat + SAME else NEVER

    def beats(self, seconds: float) -> float:
        """The beat where the piece is stopped."""
        return self.stop_beat

    def instant(self, start_beats: float, time: Time) -> float:
        """The instant of beat `start_beats`: `stop_instant` or NEVER."""
        return self.seconds(start_beats)
