"""The time that it takes to make a change for the engine; a change is not placed sooner than
that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine

# A change is given twice the time that the last makings took.
_SAFETY_FACTOR = 2.0
# Shortest and longest time by which a line is put off because it was late [s].
_SLIP_MIN, _SLIP_MAX = 0.005, 30.0


@dataclass(slots=True)
class MakingTime:
    """The time of making that is to be expected: that of the slower of the last two [s].

    It falls as fast as it rises, so that one slow line makes no later line wait. It is time of
    the engine, which may compute faster than it sounds, or stop.
    """

    engine: Engine
    rate: float  # frames a second
    slowest_seconds: float = 0.0
    _last_seconds: float = 0.0

    @property
    def expected_seconds(self) -> float:
        """The time that a change is given [s]."""
        return _SAFETY_FACTOR * self.slowest_seconds

    def after_slips(self, n_slips: int) -> float:
        """The time that a line is given which was late `n_slips` times before [s].

        It is longer each time, whatever was measured.
        """
        return _SAFETY_FACTOR * min(
            _SLIP_MAX, max(self.slowest_seconds, _SLIP_MIN) * 2.0 ** min(n_slips, 20)
        )

    def begin_frame(self) -> int:
        """The frame at which a making begins."""
        return self.engine.frame

    def add(self, start_frame: int) -> None:
        """Count making that began at frame `start_frame` and ends now."""
        seconds_taken = (self.engine.frame - start_frame) / self.rate
        self.slowest_seconds, self._last_seconds = (
            max(seconds_taken, self._last_seconds),
            seconds_taken,
        )
