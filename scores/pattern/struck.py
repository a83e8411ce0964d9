"""What a word of a rhythm strikes, how strongly and how long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal, NamedTuple

from ergon.notation.tables import notes, tuning
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest


class Repeats(NamedTuple):
    """Strokes that repeat a note over its span: so many a second [Hz], from one factor of the
    impulse to another.
    """

    rate: float
    first_factor: float = 1.0
    last_factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Struck:
    """A word of a rhythm text, where it is written, and what transformations add to it.

    An integer of `semitones` counts keys of a scale.

    It sounds for `length` of its span, from `delay` [s] after the beginning. `line` counts the
    lines of the text, which top-level commas divide. A stroke that is `part_of` the stroke of its
    word before or after it takes no level of its own.
    """

    word: str
    offset: int
    semitones: float = 0
    factor: float = 1.0
    line: int = 0
    length: Fraction = Fraction(1)
    delay: float = 0.0
    repeats: Repeats | None = None
    part_of: Literal["before", "after"] | None = None


def name_of(struck: Struck) -> str:
    """The name or note of a word, without its level: `kick` of `kick:f`."""
    return struck.word.partition(":")[0]


def key_of(struck: Struck) -> str:
    """What a stroke strikes, as a text: its word, and by how many semitones it is moved."""
    return f"{name_of(struck)}{struck.semitones:+.10g}" if struck.semitones else name_of(struck)


def note_of(word: str) -> str | None:
    """The note that a word means, which may begin with a small letter: `c4`; None for a name."""
    return notes.word_of(word[:1].upper() + word[1:])


def notes_of(note_word: str) -> tuple[str, ...]:
    """The notes that a word means: of `c4` one, of `c4.min7` those of a chord or a scale, all
    together; none of a name. Raises TextError for a chord that has no name.
    """
    root, dot, chord = tuning.spelled(note_word).partition(".")
    low_note = note_of(root)
    if low_note is None:
        return ()
    if not dot:
        return (low_note,)
    if chord not in notes.SCALES:
        message = f"{quote(chord)} is not the name of a chord or a scale"
        suggestion = nearest(chord, notes.SCALES)
        offset = len(note_word) - len(chord)
        raise TextError(message, offset=offset, length=len(chord), suggestion=suggestion)
    return tuple(notes.chord(low_note, chord))


def single_notes(struck_word: Struck) -> tuple[Struck, ...]:
    """The notes of a word one by one, each as a word with the same level; a name is one of them.

    Raises TextError.
    """
    chord = notes_of(name_of(struck_word))
    if len(chord) < 2:
        return (struck_word,)
    _, colon, level = struck_word.word.partition(":")
    return tuple(replace(struck_word, word=f"{note}{colon}{level}") for note in chord)


def sorted_by_pitch(chord: Sequence[Struck]) -> list[Struck]:
    """The single notes of strokes, from the lowest to the highest, each once; in the order of
    writing if any is no note.
    """
    distinct_notes = list(dict.fromkeys(note for struck in chord for note in single_notes(struck)))
    pitches = {struck: _pitch_of_word(struck) for struck in distinct_notes}
    if None in pitches.values():
        return distinct_notes
    return sorted(distinct_notes, key=lambda struck: pitches[struck] or 0.0)


def _pitch_of_word(struck_word: Struck) -> float | None:
    note = note_of(name_of(struck_word))
    if note is None:
        return None
    try:
        return notes.pitch(
            notes.moved(note, struck_word.semitones) if struck_word.semitones else note
        )
    except TextError:  # a key that the tuning leaves out
        return None
