"""When the lines of parts play, as far as it was computed before."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ergon.notation.text.memory import Memory
from ergon.scores.reading.piece import Gesture, Piece, Play, Strikes

# By the id of a line: the line itself (which keeps the id from being reused), and its beat.
Begins = dict[int, tuple[Play, float]]
Starts = dict[int, tuple[Play, Sequence[float] | None, int]]  # with the number of beats
Played = dict[int, tuple[Play, tuple[str, ...]]]  # the gestures and takes that a line names

_KEPT = "begins", "starts", "names", "checked", "counts"


class KnownPlays:
    """The beats of lines, kept in a memory while the `times` of the piece are the same."""

    def __init__(self, memory: Memory | None, file: str, times: Any) -> None:
        """Take the score's file. Without a memory nothing is known."""
        self._memory = memory
        named = [f"{of} {file}" for of in _KEPT]
        self._begins, self._starts, self._names, self._checked, self._counts = named
        self._times = times
        self._played: Played = {}

    def names(self) -> Played:
        """The names that lines play; the caller adds those of new lines."""
        if self._memory is not None:
            self._played = self._memory.held(self._names, None) or {}
        return self._played

    def checked(self) -> dict[int, Any]:
        """Entries of other sections, by id, whose positions exist."""
        if self._memory is None:
            return {}
        return self._memory.held(self._checked, self._times) or {}

    def keep_checked(self, found: dict[int, Any]) -> None:
        """Keep entries whose positions exist."""
        if self._memory is not None:
            self._memory.hold(self._checked, self._times, found)

    def counts(self, piece: Piece) -> dict[int, tuple[Strikes, float]]:
        """The numbers of strikes, by the id of what strikes."""
        if self._memory is None:
            return {}
        return self._memory.held(self._counts, (self._times, piece.seed)) or {}

    def keep_counts(self, piece: Piece, found: dict[int, tuple[Strikes, float]]) -> None:
        """Keep the numbers of strikes."""
        if self._memory is not None:
            self._memory.hold(self._counts, (self._times, piece.seed), found)

    def begins(self) -> Begins:
        """The beats on which lines begin."""
        if self._memory is None:
            return {}
        return self._memory.held(self._begins, self._times) or {}

    def all_begins(self, parts: Sequence[Play]) -> list[float] | None:
        """The beats on which all lines begin, if these are the lines of the reading before."""
        if self._memory is None:
            return None
        known = self._memory.held(f"all {self._begins}", self._times)
        return [*known[1]] if known is not None and known[0] == parts else None

    def keep_all_begins(self, parts: Sequence[Play], begins: Sequence[float]) -> None:
        """Keep the beats on which all lines begin; none of them has a mistake."""
        if self._memory is not None:
            self._memory.hold(f"all {self._begins}", self._times, (parts, [*begins]))

    def all_starts(self, piece: Piece) -> tuple[Sequence[float] | None, ...] | None:
        """The beats of all occurrences, if the lines are those of the reading before."""
        if self._memory is None:
            return None
        known = self._memory.held(f"all {self._starts}", (self._times, piece.seed))
        if known is None or known[0] != piece.parts:
            return None
        pairs = ((gesture, piece.gestures.get(name)) for name, gesture in known[1].items())
        return known[2] if all(_is_same(*pair) for pair in pairs) else None

    def keep_all_starts(self, piece: Piece, starts: tuple[Sequence[float] | None, ...]) -> None:
        """Keep the beats of all occurrences; no line has a mistake."""
        if self._memory is not None:
            gestures = self._memory.held(self._starts, (self._times, piece.seed))[0]
            named = f"all {self._starts}"
            what = piece.parts, gestures, starts
            self._memory.hold(named, (self._times, piece.seed), what)

    def keep_begins(self, parts: Sequence[Play], found: Begins) -> None:
        """Keep what was found for the lines of these parts."""
        if self._memory is not None:
            kept = {id(play): found[id(play)] for play in parts if id(play) in found}
            self._memory.hold(self._begins, self._times, kept)

    def starts(self, piece: Piece) -> Starts:
        """The beats of all occurrences of lines; empty if a gesture that they play has changed."""
        if self._memory is None:
            return {}
        known = self._memory.held(self._starts, (self._times, piece.seed))
        if known is None:
            return {}
        gestures, starts = known
        own = piece.gestures
        is_same = all(_is_same(gesture, own.get(name)) for name, gesture in gestures.items())
        return starts if is_same else {}

    def keep_starts(self, piece: Piece, found: Starts) -> None:
        """Keep what was found for the lines of a piece."""
        if self._memory is None:
            return
        parts = piece.parts
        kept = {id(play): found[id(play)] for play in parts if id(play) in found}
        new = [play for play in parts if id(play) not in self._played]
        known = self._played | {id(play): (play, play.names) for play in new}
        played = {id(play): known[id(play)] for play in parts}
        self._memory.hold(self._names, None, played)
        names = {name for _, found in played.values() for name in found}
        gestures: Mapping[str, Gesture | None] = {name: piece.gestures.get(name) for name in names}
        self._memory.hold(self._starts, (self._times, piece.seed), (gestures, kept))


def _is_same(a: Gesture | None, b: Gesture | None) -> bool:
    """Whether two gestures are the same path."""
    if a is b or a is None or b is None:
        return a is b
    return (a.points, a.do, a.bar_checks) == (b.points, b.do, b.bar_checks)
