"""When the lines of parts play, as far as it was computed before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

from ergon.common.changed import changed_part
from ergon.notation.tables.shapes import MISSING
from ergon.notation.text.memory import Memory
from ergon.scores.reading.piece import Piece
from ergon.scores.reading.playing import Gesture, Play


class Known(NamedTuple):
    """A value for each item, None for those that are `unknown`, by their numbers."""

    items: Sequence[Any]
    values: list[Any]
    unknown: list[int]


class KnownPlays:
    """What was computed for items of lists, kept in a memory while the `times` of the piece are the
    same.
    """

    def __init__(self, memory: Memory | None, file: str, times: Any) -> None:
        """Take the score's file. Without a memory nothing is known."""
        self._memory, self._file, self._times = memory, file, times

    def recall(self, what: str, items: Sequence[Any], condition: Any = None) -> Known:
        """What was kept for these items."""
        known = None
        if self._memory is not None:
            known = self._memory.held(f"{what} {self._file}", (self._times, condition))
        if known is None:
            return Known(items, [None] * len(items), [*range(len(items))])
        if known.items is items:
            return known  # type: ignore[no-any-return]
        changed = changed_part(known.items, items)
        values = changed.put(known.values, [None] * len(changed.now))
        first, last = changed.start, changed.start + len(changed.before)
        shift = len(items) - len(known.items)
        unknown = [number for number in known.unknown if number < first]
        unknown += range(first, first + len(changed.now))
        unknown += [number + shift for number in known.unknown if number >= last]
        return Known(items, values, unknown)

    def keep(self, what: str, known: Known, condition: Any = None) -> None:
        """Keep what is known now."""
        if self._memory is not None:
            unknown = [number for number in known.unknown if known.values[number] is None]
            lasting = Known(known.items, known.values, unknown)
            self._memory.hold(f"{what} {self._file}", (self._times, condition), lasting)

    def plays(
        self, parts: Mapping[str, Any]
    ) -> tuple[tuple[Play, ...], dict[str, tuple[str, ...]]]:
        """The lines of all parts, and the gestures and takes that each part names."""
        name = f"plays {self._file}"
        before = None if self._memory is None else self._memory.held_for(name, parts)
        if before is not None:
            return before  # type: ignore[no-any-return]
        plays = tuple([play for part in parts.values() if part is not MISSING for play in part])
        named = self.recall("names", plays)
        for number in named.unknown:
            named.values[number] = plays[number].names
        self.keep("names", named)
        words, first = {}, 0
        for player, part in parts.items():
            n_plays = 0 if part is MISSING else len(part)
            names = named.values[first : first + n_plays]
            words[player] = (*dict.fromkeys(chain.from_iterable(names)),)
            first += n_plays
        if self._memory is not None:
            self._memory.hold(name, (parts,), (plays, words))
        return plays, words

    def starts(self, piece: Piece) -> Known:
        """The beats of the occurrences of each line and their number; nothing is known if a gesture
        that some line plays has changed.
        """
        before: Mapping[str, Gesture | None] = {}
        if self._memory is not None:
            before = self._memory.held(f"gestures {self._file}", None) or {}
        pairs = ((gesture, piece.gestures.get(name)) for name, gesture in before.items())
        if all(_is_same(*pair) for pair in pairs):
            return self.recall("starts", piece.parts, piece.seed)
        n_parts = len(piece.parts)
        return Known(piece.parts, [None] * n_parts, [*range(n_parts)])

    def keep_starts(self, piece: Piece, starts: Known) -> None:
        """Keep the beats of the occurrences of each line."""
        if self._memory is not None:
            named = self.recall("names", piece.parts)
            for number in named.unknown:
                named.values[number] = piece.parts[number].names
            names = dict.fromkeys(chain.from_iterable(named.values))
            gestures = {name: piece.gestures.get(name) for name in names}
            self._memory.hold(f"gestures {self._file}", None, gestures)
            self.keep("starts", starts, piece.seed)

    def beats(self, starts: Known) -> tuple[Sequence[float] | None, ...]:
        """The beats alone; those of the same lines are the same object."""
        name = f"beats {self._file}"
        before = None if self._memory is None else self._memory.held_for(name, starts.values)
        if before is not None:
            return before  # type: ignore[no-any-return]
        beats = tuple([pair and pair[0] for pair in starts.values])
        if self._memory is not None:
            self._memory.hold(name, (starts.values,), beats)
        return beats


def _is_same(a: Gesture | None, b: Gesture | None) -> bool:
    """Whether two gestures are the same path."""
    if a is b or a is None or b is None:
        return a is b
    return (a.points, a.do, a.bar_checks) == (b.points, b.do, b.bar_checks)
