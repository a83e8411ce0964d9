"""The time that it takes to make a change for the engine; a change is not placed sooner than
that.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

_FORGET = 0.8  # factor on the earlier time at each later making

# The clock that measures this time [s]. Tests replace it by one that stands still.
clock = time.perf_counter


@dataclass(slots=True)
class MakingTime:
    """The time of making that is to be expected: that of the slowest recent one [s]."""

    seconds: float = 0.0

    @staticmethod
    def began() -> float:
        """The instant at which a making begins."""
        return clock()

    def add(self, began: float) -> None:
        """Count making that began at `began` and ends now."""
        self.seconds = max(clock() - began, _FORGET * self.seconds)
