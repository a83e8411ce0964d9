"""Notes that draw or press for as long as they last, also where another version takes over."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf

from ergon import _core

ModuleKey = tuple[str, str]  # part and module of a MAT

NoteKey = tuple[str, ModuleKey, int, int]

_TAKEOVER_MARGIN = 0.01  # [s] more than from the instant of a takeover to what plays from there on


@dataclass(frozen=True, slots=True)
class DrawnNote:
    """A note of strikes `strikes_name`: an impulse [N·s] moves a MAT, from `begin` to `end` [s].

    `ordinal_at_instant` counts those that move it from one instant on: a bow that presses, and the
    pressure on a key that presses it further.
    """

    strikes_name: str
    module_key: ModuleKey
    begin: float
    end: float
    impulse: float
    ordinal_at_instant: int = 0

    @property
    def key(self) -> NoteKey:
        """What is the same for a note in two versions: its instant to the microsecond."""
        return self.strikes_name, self.module_key, round(1e6 * self.begin), self.ordinal_at_instant


class DrawnNotes:
    """The drawn notes of a timeline. Each ends by the opposite of what it began with.

    Of the notes of the stage before, those that this one has too go on, with another impulse if
    that has changed; all others end where this one takes over.
    """

    def __init__(
        self,
        timeline: _core.Timeline,
        old_notes: Sequence[DrawnNote] = (),
        takeover_instant: float = -inf,
        rate: float = inf,
    ) -> None:
        """Take the notes of the stage before, and the instant [s] from which on this one plays."""
        self._timeline, self._first_frame_instant = timeline, takeover_instant + 1.0 / rate
        self._old_notes = {
            note.key: note for note in old_notes if note.begin < takeover_instant < note.end
        }
        self._note_counts: Counter[tuple[NoteKey, tuple[float, float]]] = Counter()
        self.notes: list[DrawnNote] = []

    def play(self, note: DrawnNote, mat: int, source: int, interval: tuple[float, float]) -> None:
        """Play a note that begins within an interval of instants [s]; or one that the stage before
        has begun, if this interval follows it.
        """
        ordinal_at_instant = self._note_counts[note.key, interval]
        self._note_counts[note.key, interval] += 1
        note = replace(note, ordinal_at_instant=ordinal_at_instant)
        is_new, is_continued = (
            interval[0] <= note.begin < interval[1],
            interval[0] > self._first_frame_instant - _TAKEOVER_MARGIN,
        )
        old_note = self._old_notes.pop(note.key, None) if is_continued and not is_new else None
        if is_new:
            self._push(mat, note.begin, note.impulse, source)
        elif old_note is None:
            return
        else:
            self._push(mat, self._first_frame_instant, note.impulse - old_note.impulse, source)
        self._push(mat, note.end, -note.impulse, source)
        self.notes.append(note)

    def end_discontinued_notes(
        self, mat_of: Callable[[ModuleKey], int | None], source: int
    ) -> None:
        """End the notes that do not go on."""
        for drawn_note in self._old_notes.values():
            mat = mat_of(drawn_note.module_key)
            if mat is not None:
                self._push(mat, self._first_frame_instant, -drawn_note.impulse, source)
        self._old_notes.clear()

    def _push(self, mat: int, instant: float, impulse: float, source: int) -> None:
        if impulse:
            self._timeline.strike(mat, instant, impulse=impulse, source=source)
