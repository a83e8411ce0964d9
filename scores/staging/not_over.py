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
_SELECTIONS_KEPT = 4  # looks; some are at earlier versions that still play
NameAndCount = tuple[Hashable, int]  # an item that a line plays, with its count


class _KnownSelection(NamedTuple):
    """The indices of the lines that are not over on beat `since_beat`, in order.

    `counts` says how often those that are over have played what they play, `counted_lines` the
    index of the last of them.
    """

    columns: _Columns
    since_beat: float
    line_indices: list[int]
    counts: dict[Hashable, int]
    counted_lines: dict[Hashable, int]


class UnfinishedLines(Generic[_Line]):
    """Remembers the last looks: only lines that were not over then, or that have changed, are
    looked at.
    """

    def __init__(self) -> None:
        """Start without a look."""
        self._selections: list[_KnownSelection] = []

    def forget(self) -> None:
        """Forget all looks."""
        self._selections.clear()

    def select(
        self,
        columns: _Columns,
        since_beat: float,
        is_over: Callable[[_Line], bool],
        name_and_count: Callable[[_Line], NameAndCount | None],
    ) -> tuple[list[_Line], dict[Hashable, int]]:
        """The lines that are not over on beat `since_beat`, and how often the others have played
        what they play. A line behind another one that plays the same and is not over stays too:
        occurrences are counted in the order of the lines.

        A line is an item of each of the `columns`, which keep the items that do not change. A line
        that is over must be over on all later beats.
        """
        selection = self._last_selection(columns, since_beat, name_and_count)
        play_counts, counted_lines = dict(selection.counts), dict(selection.counted_lines)
        indices_left: list[int] = []
        uncounted_names: set[Hashable] = set()
        for line_index in selection.line_indices if selection.since_beat < since_beat else ():
            line = _line(columns, line_index)
            played_name, n_played = name_and_count(line) or (None, 0)
            if played_name in uncounted_names or not is_over(line):
                indices_left.append(line_index)
                if played_name is not None:
                    uncounted_names.add(played_name)
            elif played_name is not None:
                play_counts[played_name] = play_counts.get(played_name, 0) + n_played
                counted_lines[played_name] = line_index
        if selection.since_beat < since_beat:
            selection = _KnownSelection(
                columns, since_beat, indices_left, play_counts, counted_lines
            )
            self._selections = [*self._selections[1 - _SELECTIONS_KEPT :], selection]
        return [_line(columns, index) for index in selection.line_indices], selection.counts

    def _last_selection(
        self,
        columns: _Columns,
        since_beat: float,
        name_and_count: Callable[[_Line], NameAndCount | None],
    ) -> _KnownSelection:
        """The last look at these lines at `since_beat` or before, with changed lines left."""
        for selection in sorted(
            self._selections, key=lambda selection: selection.since_beat, reverse=True
        ):
            if (
                selection.since_beat <= since_beat
                and (adapted_selection := _adapted_selection(selection, columns, name_and_count))
                is not None
            ):
                return adapted_selection
        return _KnownSelection(columns, -math.inf, [*range(len(columns[0]))], {}, {})


def _line(columns: _Columns, number: int) -> Any:
    return tuple([column[number] for column in columns])


def _adapted_selection(
    selection: _KnownSelection,
    columns: _Columns,
    name_and_count: Callable[..., NameAndCount | None],
) -> _KnownSelection | None:
    """A look for nearly the same lines: changed lines are left. None if one of them was over, or
    changes the count of one that was.
    """
    column_pairs = zip(selection.columns, columns, strict=True)
    changes = [change for column_pair in column_pairs if (change := changed_part(*column_pair))]
    if not changes:
        return selection
    n_old, n_new = len(selection.columns[0]), len(columns[0])
    change_start = min(change.start for change in changes)
    n_after = min(n_old - change.start - len(change.before) for change in changes)
    first_changed, stop_changed = (
        bisect_left(selection.line_indices, index) for index in (change_start, n_old - n_after)
    )
    if stop_changed - first_changed < n_old - n_after - change_start:
        return None
    new_indices = range(change_start, n_new - n_after)
    for number in new_indices:
        played_name, _ = name_and_count(_line(columns, number)) or (None, 0)
        if selection.counted_lines.get(played_name, -1) >= change_start:
            return None
    line_shift = n_new - n_old
    indices_left = [
        *selection.line_indices[:first_changed],
        *new_indices,
        *(number + line_shift for number in selection.line_indices[stop_changed:]),
    ]
    counted_lines = {
        name: line_index if line_index < change_start else line_index + line_shift
        for name, line_index in selection.counted_lines.items()
    }
    # The changed lines are looked at again, on the same beat too.
    return _KnownSelection(
        columns,
        math.nextafter(selection.since_beat, -math.inf),
        indices_left,
        selection.counts,
        counted_lines,
    )
