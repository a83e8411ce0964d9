"""How long it takes to make a change for the engine: the change is placed no sooner."""

from __future__ import annotations

import time
from dataclasses import dataclass

_FORGET = 0.8  # by so much the slowest making counts less at each later one

# The clock of all makings [s]. Tests that count the time of a performance let it stand still.
clock = time.perf_counter


@dataclass(slots=True)
class MakingTime:
    """The time of the slowest of the last makings [s]."""

    seconds: float = 0.0

    @staticmethod
    def began() -> float:
        """The instant at which a making begins."""
        return clock()

    def add(self, began: float) -> None:
        """Count a making that ends now."""
        self.seconds = max(clock() - began, _FORGET * self.seconds)
