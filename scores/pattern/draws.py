"""What a pattern leaves to chance, by number: no draw depends on another, or on what was played.

Every draw is keyed by the score's seed, by who plays what, by the group in the pattern and by the
number of the round or place, so that a piece that is entered in the middle draws what it would have
drawn on the way there.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock

from ergon import _core

_WALKS = 256  # paths that are kept: to know where a walk is, all of it is drawn
_WALKING = Lock()


@dataclass(frozen=True, slots=True)
class Draws:
    """Draws of one line of a score: `who` plays it, and the text of its pattern."""

    seed: int
    who: str

    def chooses(self, site: int, turn: int, count: int) -> int:
        """One of `count` items."""
        return _one_of(self._chance("choose", site, turn), count)

    def shuffles(self, site: int, turn: int, count: int) -> list[int]:
        """All of `count` items in some order."""
        chance = self._chance("shuffle", site, turn)
        order = list(range(count))
        for last in range(count - 1, 0, -1):  # Fisher and Yates
            other = _one_of(chance, last + 1)
            order[last], order[other] = order[other], order[last]
        return order

    def walks(self, site: int, turn: int, count: int) -> int:
        """Where a walk among `count` items is: from the first on, each time one back, none or one
        ahead; at an end it turns."""
        if count == 1:
            return 0
        path = _walk(self.seed, self.who, site, count)
        with _WALKING:
            while len(path) <= turn:
                step = _one_of(self._chance("walk", site, len(path)), 3) - 1
                at = path[-1] + step
                path.append(at if 0 <= at < count else path[-1] - step)
        return path[turn]

    def happens(self, probability: float, place: int, member: int = 0) -> bool:
        """Whether what has a probability happens."""
        return self._chance("chance", member, place).uniform(0.0, 1.0) < probability

    def transforms(self, place: int) -> _core.Chance:
        """Where the transformations of what is played in a place draw from."""
        return self._chance("do", 0, place)

    def _chance(self, kind: str, member: int, occurrence: int) -> _core.Chance:
        return _core.Chance(self.seed, f"pattern {kind}", self.who, member, occurrence)


def _one_of(chance: _core.Chance, count: int) -> int:
    return min(int(chance.uniform(0.0, float(count))), count - 1)


@lru_cache(maxsize=_WALKS)
def _walk(seed: int, who: str, site: int, count: int) -> array[int]:
    """The beginning of a walk, as far as it was asked for."""
    return array("H", [0])
