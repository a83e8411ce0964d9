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


class KnownValues(NamedTuple):
    """A value for each item, None for those that are `unknown_indices`, by their numbers."""

    items: Sequence[Any]
    values: list[Any]
    unknown_indices: list[int]


class KnownPlays:
    """What was computed for items of lists, kept in a memory while the `times` of the piece are the
    same.
    """

    def __init__(self, memory: Memory | None, file: str, times: Any) -> None:
        """Take the score's file. Without a memory nothing is known."""
        self._memory, self._file, self._times = memory, file, times

    def recall(self, subject: str, items: Sequence[Any], condition: Any = None) -> KnownValues:
        """What was kept for these items."""
        old_values = None
        if self._memory is not None:
            old_values = self._memory.held(f"{subject} {self._file}", (self._times, condition))
        if old_values is None:
            return KnownValues(items, [None] * len(items), [*range(len(items))])
        if old_values.items is items:
            return old_values  # type: ignore[no-any-return]
        changed_range = changed_part(old_values.items, items)
        recalled_values = changed_range.put(old_values.values, [None] * len(changed_range.now))
        first_changed, stop_changed = (
            changed_range.start,
            changed_range.start + len(changed_range.before),
        )
        index_shift = len(items) - len(old_values.items)
        unknown_indices = [
            number for number in old_values.unknown_indices if number < first_changed
        ]
        unknown_indices += range(first_changed, first_changed + len(changed_range.now))
        unknown_indices += [
            number + index_shift for number in old_values.unknown_indices if number >= stop_changed
        ]
        return KnownValues(items, recalled_values, unknown_indices)

    def keep_values(self, subject: str, known_values: KnownValues, condition: Any = None) -> None:
        """Keep what is known now."""
        if self._memory is not None:
            unknown_indices = [
                number
                for number in known_values.unknown_indices
                if known_values.values[number] is None
            ]
            stored_values = KnownValues(known_values.items, known_values.values, unknown_indices)
            self._memory.hold(f"{subject} {self._file}", (self._times, condition), stored_values)

    def plays(
        self, parts: Mapping[str, Any]
    ) -> tuple[tuple[Play, ...], dict[str, tuple[str, ...]]]:
        """The lines of all parts, and the gestures and takes that each part names."""
        memory_key = f"plays {self._file}"
        old_plays = None if self._memory is None else self._memory.held_for(memory_key, parts)
        if old_plays is not None:
            return old_plays  # type: ignore[no-any-return]
        plays = tuple([play for part in parts.values() if part is not MISSING for play in part])
        names_by_play = self.recall("names", plays)
        for number in names_by_play.unknown_indices:
            names_by_play.values[number] = plays[number].names
        self.keep_values("names", names_by_play)
        names_by_player, first_play = {}, 0
        for player, part in parts.items():
            n_plays = 0 if part is MISSING else len(part)
            names = names_by_play.values[first_play : first_play + n_plays]
            names_by_player[player] = (*dict.fromkeys(chain.from_iterable(names)),)
            first_play += n_plays
        if self._memory is not None:
            self._memory.hold(memory_key, (parts,), (plays, names_by_player))
        return plays, names_by_player

    def known_starts(self, piece: Piece) -> KnownValues:
        """The beats of the occurrences of each line and their number; nothing is known if a gesture
        that some line plays has changed.
        """
        old_gestures: Mapping[str, Gesture | None] = {}
        if self._memory is not None:
            old_gestures = self._memory.held(f"gestures {self._file}", None) or {}
        gesture_pairs = (
            (gesture, piece.gestures.get(name)) for name, gesture in old_gestures.items()
        )
        if all(_is_same(*pair) for pair in gesture_pairs):
            return self.recall("starts", piece.parts, piece.seed)
        n_parts = len(piece.parts)
        return KnownValues(piece.parts, [None] * n_parts, [*range(n_parts)])

    def keep_starts(self, piece: Piece, starts: KnownValues) -> None:
        """Keep the beats of the occurrences of each line."""
        if self._memory is not None:
            names_by_play = self.recall("names", piece.parts)
            for number in names_by_play.unknown_indices:
                names_by_play.values[number] = piece.parts[number].names
            names = dict.fromkeys(chain.from_iterable(names_by_play.values))
            gestures = {name: piece.gestures.get(name) for name in names}
            self._memory.hold(f"gestures {self._file}", None, gestures)
            self.keep_values("starts", starts, piece.seed)

    def start_beats(self, starts: KnownValues) -> tuple[Sequence[float] | None, ...]:
        """The beats alone; those of the same lines are the same object."""
        memory_key = f"beats {self._file}"
        old_beats = (
            None if self._memory is None else self._memory.held_for(memory_key, starts.values)
        )
        if old_beats is not None:
            return old_beats  # type: ignore[no-any-return]
        beats = tuple(
            [starts_and_count and starts_and_count[0] for starts_and_count in starts.values]
        )
        if self._memory is not None:
            self._memory.hold(memory_key, (starts.values,), beats)
        return beats


def _is_same(first_gesture: Gesture | None, second_gesture: Gesture | None) -> bool:
    """Whether two gestures are the same path."""
    if first_gesture is second_gesture or first_gesture is None or second_gesture is None:
        return first_gesture is second_gesture
    return (first_gesture.points, first_gesture.do, first_gesture.bar_checks) == (
        second_gesture.points,
        second_gesture.do,
        second_gesture.bar_checks,
    )
