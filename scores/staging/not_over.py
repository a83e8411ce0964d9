"""Which lines of a piece are not over on a beat.

Of thousands of lines nearly all are over, and looking at each of them for every new line of a
session takes long.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from ergon.common.changed import changed_part

_Line = TypeVar("_Line", bound=tuple[Any, ...])
_Columns = tuple[Sequence[Any], ...]
_LOOKS_REMEMBERED = 4  # looks; some are at earlier versions that still play
Plays = tuple[Hashable, int]  # an item that a line plays, with its count


class _RememberedLook(NamedTuple):
    """The indices of the lines that are not over on beat `since`, in order.

    `counts` says how often those that are over have played what they play, `counted` the index of
    the last of them.
    """

    columns: _Columns
    since: float
    left: list[int]
    counts: dict[Hashable, int]
    counted: dict[Hashable, int]


class NotOver(Generic[_Line]):
    """Remembers the last looks: only lines that were not over then, or that have changed, are
    looked at.
    """

    def __init__(self) -> None:
        """Start without a look."""
        self._looks: list[_RememberedLook] = []

    def forget(self) -> None:
        """Forget all looks."""
        self._looks.clear()

    def look(
        self,
        columns: _Columns,
        since: float,
        is_over: Callable[[_Line], bool],
        plays: Callable[[_Line], Plays | None],
    ) -> tuple[list[_Line], dict[Hashable, int]]:
        """The lines that are not over on beat `since`, and how often the others have played what
        they play. A line behind another one that plays the same and is not over stays too:
        occurrences are counted in the order of the lines.

        A line is an item of each of the `columns`, which keep the items that do not change. A line
        that is over must be over on all later beats.
        """
        look = self._last(columns, since, plays)
        play_counts, counted = dict(look.counts), dict(look.counted)
        numbers_left: list[int] = []
        waiting: set[Hashable] = set()
        for line_number in look.left if look.since < since else ():
            line = _line(columns, line_number)
            played_name, n_played = plays(line) or (None, 0)
            if played_name in waiting or not is_over(line):
                numbers_left.append(line_number)
                if played_name is not None:
                    waiting.add(played_name)
            elif played_name is not None:
                play_counts[played_name] = play_counts.get(played_name, 0) + n_played
                counted[played_name] = line_number
        if look.since < since:
            look = _RememberedLook(columns, since, numbers_left, play_counts, counted)
            self._looks = [*self._looks[1 - _LOOKS_REMEMBERED :], look]
        return [_line(columns, number) for number in look.left], look.counts

    def _last(
        self,
        columns: _Columns,
        since: float,
        plays: Callable[[_Line], Plays | None],
    ) -> _RememberedLook:
        """The last look at these lines at `since` or before, of which changed lines are left."""
        for look in sorted(self._looks, key=lambda look: look.since, reverse=True):
            if (
                look.since <= since
                and (carried_look := _carried_over(look, columns, plays)) is not None
            ):
                return carried_look
        return _RememberedLook(columns, -math.inf, [*range(len(columns[0]))], {}, {})


def _line(columns: _Columns, number: int) -> Any:
    return tuple([column[number] for column in columns])


def _carried_over(
    look: _RememberedLook, table_columns: _Columns, plays: Callable[..., Plays | None]
) -> _RememberedLook | None:
    """A look for nearly the same lines: changed lines are left. None if one of them was over, or
    changes the count of one that was.
    """
    pairs = zip(look.columns, table_columns, strict=True)
    changes = [change for pair in pairs if (change := changed_part(*pair))]
    if not changes:
        return look
    n_old, n_new = len(look.columns[0]), len(table_columns[0])
    change_start = min(change.start for change in changes)
    n_after = min(n_old - change.start - len(change.before) for change in changes)
    first_changed, stop_changed = (
        bisect_left(look.left, index) for index in (change_start, n_old - n_after)
    )
    if stop_changed - first_changed < n_old - n_after - change_start:
        return None
    new_numbers = range(change_start, n_new - n_after)
    for number in new_numbers:
        played_name, _ = plays(_line(table_columns, number)) or (None, 0)
        if look.counted.get(played_name, -1) >= change_start:
            return None
    line_shift = n_new - n_old
    numbers_left = [
        *look.left[:first_changed],
        *new_numbers,
        *(number + line_shift for number in look.left[stop_changed:]),
    ]
    counted = {
        old_line: number_counted if number_counted < change_start else number_counted + line_shift
        for old_line, number_counted in look.counted.items()
    }
    # The changed lines are looked at again, on the same beat too.
    return _RememberedLook(
        table_columns, math.nextafter(look.since, -math.inf), numbers_left, look.counts, counted
    )
