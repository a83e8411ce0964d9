"""A tempo map whose piece does not begin with the engine's first frame."""

from __future__ import annotations

from ergon.scores.clock.tempo import TempoMap
from ergon.scores.text.values import Time


class Shifted(TempoMap):
    """The beats of a piece at instants `by` seconds later."""

    def __init__(self, of: TempoMap, by: float) -> None:
        """Of a map that is whole."""
        self.__dict__.update(of.__dict__)
        self.by = by

    def seconds(self, beats: float) -> float:
        """Seconds of the engine at a beat of the piece."""
        return super().seconds(beats) + self.by

    def beats(self, seconds: float) -> float:
        """The beat of the piece at an instant of the engine."""
        return super().beats(seconds - self.by)

    def instant(self, start_beats: float, time: Time) -> float:
        """Seconds of the engine of a time counted from beat `start_beats`."""
        return self.seconds(start_beats + time.beats) + time.seconds
