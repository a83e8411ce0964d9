"""What stages of nearly the same piece know from the ones before, so that the past costs little."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ergon.notation.clock.meter import Meter
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.reading.piece import Strikes
from ergon.scores.staging.known_automation import KnownAutomation

_MOST = 100_000  # strikes, with those that were edited since
_APART = 1e-6  # beats by which strikes end before a beat, for they are over


@dataclass(slots=True)
class KnownStrikes:
    """The beats before which strikes fall, by the id of the strikes, which are kept with them."""

    _meters: list[tuple[float, int, Meter]] = field(default_factory=list)
    _ends: dict[int, tuple[Strikes, float]] = field(default_factory=dict)

    def begin(self, tempo: TempoMap) -> None:
        """Begin with the strikes of a piece: in other meters they end on other beats."""
        meters = tempo.bars.changes()
        if meters != self._meters or len(self._ends) > _MOST:
            self._meters, self._ends = meters, {}

    def are_over(self, strikes: Strikes, tempo: TempoMap, beat: float) -> bool:
        """Whether strikes surely fall before a beat."""
        known = self._ends.get(id(strikes))
        if known is None:
            known = self._ends[id(strikes)] = strikes, _end(strikes, tempo)
        return known[1] < beat - _APART


def _end(strikes: Strikes, tempo: TempoMap) -> float:
    """The beat before which strikes fall; infinite where it is not written in bars and beats."""
    until = strikes.until
    if until is None or until.mark is not None or until.plus.seconds or strikes.has_rounds:
        return math.inf  # a round that begins before it may end after it
    try:
        return tempo.resolve(until)
    except TextError:
        return math.inf


@dataclass(slots=True)
class StageMemory:
    """The memory of a chain of stages, each of which takes over from the one before."""

    automation: KnownAutomation = field(default_factory=KnownAutomation)
    strikes: KnownStrikes = field(default_factory=KnownStrikes)
