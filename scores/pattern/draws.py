"""Random draws of a pattern, by number: no draw depends on another, or on what was played.

Every draw is keyed by the score's seed, by who plays what, by the group in the pattern and by
the number of the round or place, so that a piece that starts in the middle makes the same draws
as one that plays from the beginning.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from functools import lru_cache
from threading import Lock

from ergon import _core

_WALKS_CACHED = 256  # walks that are kept: each must be drawn from its beginning
_WALK_LOCK = Lock()


@dataclass(frozen=True, slots=True)
class Draws:
    """Draws of one line of a score: `owner` plays it, and the text of its pattern."""

    seed: int
    owner: str

    def choose(self, site: int, turn: int, count: int) -> int:
        """One of `count` items."""
        return _drawn_index(self._chance("choose", site, turn), count)

    def shuffle(self, site: int, turn: int, n_items: int) -> list[int]:
        """All of `n_items` items in some order."""
        chance = self._chance("shuffle", site, turn)
        shuffled_order = list(range(n_items))
        for last_index in range(n_items - 1, 0, -1):  # Fisher and Yates
            drawn_index = _drawn_index(chance, last_index + 1)
            shuffled_order[last_index], shuffled_order[drawn_index] = (
                shuffled_order[drawn_index],
                shuffled_order[last_index],
            )
        return shuffled_order

    def walk_position(self, site: int, turn_index: int, n_items: int) -> int:
        """The position of a random walk among `n_items` items: it starts at the first, and each
        turn moves it by -1, 0 or +1; a step beyond an end is reflected.
        """
        if n_items == 1:
            return 0
        positions = _drawn_walk(self.seed, self.owner, site, n_items)
        with _WALK_LOCK:
            while len(positions) <= turn_index:
                step = _drawn_index(self._chance("walk", site, len(positions)), 3) - 1
                position = positions[-1] + step
                positions.append(position if 0 <= position < n_items else positions[-1] - step)
        return positions[turn_index]

    def happens(self, probability: float, place: int, member: int = 0) -> bool:
        """Whether an event with a given probability happens."""
        return self._chance("chance", member, place).uniform(0.0, 1.0) < probability

    def changes(self, probability: float, place: int, rule: int) -> bool:
        """Whether the rule of a number changes what is played in a place."""
        return self._chance("change", rule, place).uniform(0.0, 1.0) < probability

    def transforms(self, place: int) -> _core.Chance:
        """The source of chance for the transformations of what is played in a place."""
        return self._chance("do", 0, place)

    def _chance(self, kind: str, member: int, occurrence: int) -> _core.Chance:
        return _core.Chance(self.seed, f"pattern {kind}", self.owner, member, occurrence)


def _drawn_index(chance: _core.Chance, count: int) -> int:
    return min(int(chance.uniform(0.0, float(count))), count - 1)


@lru_cache(maxsize=_WALKS_CACHED)
def _drawn_walk(seed: int, owner: str, site: int, count: int) -> array[int]:
    """The part of a walk that has been drawn so far."""
    return array("H", [0])
