"""The time that it takes to make a change for the engine; a change is not placed sooner than
that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine


@dataclass(slots=True)
class MakingTime:
    """The time of making that is to be expected: that of the slower of the last two [s].

    It falls as fast as it rises, so that one slow line makes no later line wait. It is time of
    the engine, which may compute faster than it sounds, or stand still.
    """

    engine: Engine
    rate: float  # frames a second
    seconds: float = 0.0
    _last: float = 0.0

    def began(self) -> int:
        """The frame at which a making begins."""
        return self.engine.frame

    def add(self, began: int) -> None:
        """Count making that began at frame `began` and ends now."""
        took = (self.engine.frame - began) / self.rate
        self.seconds, self._last = max(took, self._last), took
