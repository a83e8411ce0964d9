"""Names of MIDI notes."""

from __future__ import annotations

from ergon.notation.text.errors import TextError, quote

_MIDI_NOTE_COUNT = 128
_SEMITONES_BY_LETTER = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_SEMITONES_BY_ACCIDENTAL = {"": 0, "#": 1, "b": -1}


def note_number(note_text: str) -> int:
    """The number of a note, written as 0 to 127 or as a name: C4 is 60. Raises TextError."""
    number = -1
    if note_text.isascii() and note_text.isdigit() and len(note_text) <= 3:
        number = int(note_text)
    elif note_text[:1] in _SEMITONES_BY_LETTER:
        accidental_sign = note_text[1:2] if note_text[1:2] in ("#", "b") else ""
        octave = note_text[1 + len(accidental_sign) :]
        if octave in ("-1", *map(str, range(10))):
            number = (
                12 * (int(octave) + 1)
                + _SEMITONES_BY_LETTER[note_text[0]]
                + _SEMITONES_BY_ACCIDENTAL[accidental_sign]
            )
    if not 0 <= number < _MIDI_NOTE_COUNT:
        raise TextError(
            f"{quote(note_text)} is not a note: write a number from 0 to 127, or a name such as C4 "
            "(60)",
            length=max(1, len(note_text)),
        )
    return number
