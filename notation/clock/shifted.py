"""A tempo map whose piece does not begin with the engine's first frame."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.values import Time

# Nobody listens any more [s]: thirty years on, where frames are still counted exactly.
NEVER = 1e9


class Elsewhere(TempoMap):
    """The beats of a piece at other instants: some may be past when the engine begins."""


class Shifted(Elsewhere):
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


class Standing(Elsewhere):
    """A piece that stands at a beat: what lies before it is over, what lies after never comes."""

    def __init__(self, of: TempoMap, at: float, now: float) -> None:
        """Of a map that is whole, at an instant of the engine [s]."""
        self.__dict__.update(of.__dict__)
        self.at, self.now = at, now

    def seconds(self, beats: float) -> float:
        """Now, or never."""
        return self.now if beats <= self.at + SAME else NEVER

    def beats(self, seconds: float) -> float:
        """The beat where it stands."""
        return self.at

    def instant(self, start_beats: float, time: Time) -> float:
        """Now, or never."""
        return self.seconds(start_beats)
