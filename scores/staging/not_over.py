"""Which lines of a piece are not over on a beat.

Of thousands of lines nearly all are over, and looking at each of them for every new line of a
session takes long.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import Generic, NamedTuple, TypeVar

_Line = TypeVar("_Line")
_REMEMBERED = 4  # looks; some are at earlier versions that still play
Plays = tuple[Hashable, int]  # what a line plays, and how often


class _Look(NamedTuple, Generic[_Line]):
    """The lines that are not over on beat `since`, in order, and how often those that are over have
    played what they play.
    """

    key: object
    since: float
    left: list[_Line]
    counts: dict[Hashable, int]


class NotOver(Generic[_Line]):
    """Remembers the last looks: only lines that were not over then are looked at."""

    def __init__(self) -> None:
        """Start without a look."""
        self._looks: list[_Look[_Line]] = []

    def forget(self) -> None:
        """Forget all looks."""
        self._looks.clear()

    def look(
        self,
        key: object,
        lines: Iterable[_Line],
        since: float,
        is_over: Callable[[_Line], bool],
        plays: Callable[[_Line], Plays | None],
    ) -> tuple[list[_Line], dict[Hashable, int]]:
        """The lines that are not over on beat `since`, and how often the others have played what
        they play. A line behind another one that plays the same and is not over stays too:
        occurrences are counted in the order of the lines.

        Equal keys mean the same `lines`. A line that is over must be over on all later beats.
        """
        before = [look for look in self._looks if look.since <= since and look.key == key]
        last = max(before, key=lambda look: look.since, default=None)
        if last is not None and last.since == since:
            return last.left, last.counts
        left: list[_Line] = []
        counts: dict[Hashable, int] = {} if last is None else dict(last.counts)
        waiting: set[Hashable] = set()
        for line in lines if last is None else last.left:
            what, number = plays(line) or (None, 0)
            if what in waiting or not is_over(line):
                left.append(line)
                if what is not None:
                    waiting.add(what)
            elif what is not None:
                counts[what] = counts.get(what, 0) + number
        self._looks = [*self._looks[1 - _REMEMBERED :], _Look(key, since, left, counts)]
        return left, counts
