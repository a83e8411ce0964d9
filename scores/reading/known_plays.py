"""When the lines of parts play, as far as it was computed before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

from ergon.common.changed import changed_part
from ergon.notation.text.memory import Memory
from ergon.scores.reading.piece import Gesture, Piece, Play

# The beats of a line's occurrences (None: only a take's file can tell), and their number.
Starts = tuple[Sequence[float] | None, int]


class KnownPlays:
    """What was computed for items of lists, kept in a memory while the `times` of the piece are the
    same.
    """

    def __init__(self, memory: Memory | None, file: str, times: Any) -> None:
        """Take the score's file. Without a memory nothing is known."""
        self._memory, self._file, self._times = memory, file, times

    def recall(self, what: str, items: Sequence[Any], condition: Any = None) -> list[Any]:
        """What was kept for these items, in their order; None where nothing is known.

        Items between those that have changed are looked at as changed too.
        """
        known = None
        if self._memory is not None:
            known = self._memory.held(f"{what} {self._file}", (self._times, condition))
        if known is None:
            return [None] * len(items)
        before, values = known
        changed = changed_part(before, items)
        return changed.put(values, [None] * len(changed.now))

    def keep(
        self, what: str, items: Sequence[Any], values: Sequence[Any], condition: Any = None
    ) -> None:
        """Keep a value for each item; None for items that have mistakes."""
        if self._memory is not None:
            name = f"{what} {self._file}"
            self._memory.hold(name, (self._times, condition), ([*items], [*values]))

    def names(self, plays: Sequence[Play]) -> list[tuple[str, ...]]:
        """The gestures and takes that each line names."""
        names = self.recall("names", plays)
        names = [play.names if own is None else own for play, own in zip(plays, names, strict=True)]
        self.keep("names", plays, names)
        return names

    def starts(self, piece: Piece) -> list[Starts | None]:
        """The beats of the occurrences of each line; None if they, or a gesture that some line
        plays, have changed.
        """
        before: Mapping[str, Gesture | None] = {}
        if self._memory is not None:
            before = self._memory.held(f"gestures {self._file}", None) or {}
        pairs = ((gesture, piece.gestures.get(name)) for name, gesture in before.items())
        if not all(_is_same(*pair) for pair in pairs):
            return [None] * len(piece.parts)
        return self.recall("starts", piece.parts, piece.seed)

    def keep_starts(self, piece: Piece, starts: Sequence[Starts | None]) -> None:
        """Keep the beats of occurrences; None for lines that have mistakes."""
        if self._memory is not None:
            names = dict.fromkeys(chain.from_iterable(self.names(piece.parts)))
            gestures = {name: piece.gestures.get(name) for name in names}
            self._memory.hold(f"gestures {self._file}", None, gestures)
            self.keep("starts", piece.parts, starts, piece.seed)


def _is_same(a: Gesture | None, b: Gesture | None) -> bool:
    """Whether two gestures are the same path."""
    if a is b or a is None or b is None:
        return a is b
    return (a.points, a.do, a.bar_checks) == (b.points, b.do, b.bar_checks)
