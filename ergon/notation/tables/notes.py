"""Notes by name: their numbers, scales and chords, and lists of notes as they are written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ergon import _core
from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
from ergon.notation.tables.octaves import octaves_of_ratio
from ergon.notation.tables.shapes import MISSING, Context, Shape, wrong_shape
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

MAX_NOTES = 256  # notes of one instrument
LOWEST, HIGHEST = 0, 131  # C-1 and B9
# Semitones above the root.
SCALES: Mapping[str, tuple[int, ...]] = {
    "major": (0, 2, 4, 5, 7, 9, 11),
    "minor": (0, 2, 3, 5, 7, 8, 10),
    "harmonic-minor": (0, 2, 3, 5, 7, 8, 11),
    "melodic-minor": (0, 2, 3, 5, 7, 9, 11),
    "dorian": (0, 2, 3, 5, 7, 9, 10),
    "phrygian": (0, 1, 3, 5, 7, 8, 10),
    "lydian": (0, 2, 4, 6, 7, 9, 11),
    "mixolydian": (0, 2, 4, 5, 7, 9, 10),
    "locrian": (0, 1, 3, 5, 6, 8, 10),
    "pentatonic": (0, 2, 4, 7, 9),
    "minor-pentatonic": (0, 3, 5, 7, 10),
    "blues": (0, 3, 5, 6, 7, 10),
    "whole-tone": (0, 2, 4, 6, 8, 10),
    "chromatic": tuple(range(12)),
    "maj": (0, 4, 7),
    "min": (0, 3, 7),
    "dim": (0, 3, 6),
    "aug": (0, 4, 8),
    "sus2": (0, 2, 7),
    "sus4": (0, 5, 7),
    "maj7": (0, 4, 7, 11),
    "min7": (0, 3, 7, 10),
    "dom7": (0, 4, 7, 10),
    "dim7": (0, 3, 6, 9),
    "m7b5": (0, 3, 6, 10),
}

_NOTE = re.compile(r"([A-G])([#♯b♭]?)(-?\d)")
_LETTERS = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_SIGNS = {"": 0, "#": 1, "♯": 1, "b": -1, "♭": -1}
_SHARP = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_FLAT = ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")
_NOTE_NAMES = ("C", "C#", "D", "Eb", "E", "F", "F#", "G", "G#", "A", "Bb", "B")
_WORD = re.compile(r"\S+")
_WITH_CENTS = re.compile(r"([A-G][^+\d-]*-?\d)(?:([+-][\d_]+)cents?)?")
_EXAMPLE = "D3 F3 A3, C3..C5 pentatonic, C3 minor count 8 or A3.min7"


def number(note_word: str) -> int | None:
    """The number of a note in semitones, 60 for C4 and 69 for A4; None if the word is not a
    note.
    """
    note_match = _NOTE.fullmatch(note_word)
    if note_match is None:
        return None
    return 12 * (int(note_match[3]) + 1) + _LETTERS[note_match[1]] + _SIGNS[note_match[2]]


def name(note_number: int, *, flat: bool = False) -> str:
    """The name of a note by its number, with a sharp or a flat."""
    octave, step = divmod(note_number, 12)
    return f"{(_FLAT if flat else _SHARP)[step]}{octave - 1}"


def nearest_note(frequency: float) -> tuple[str, float]:
    """The note of equal temperament (A4 = 440 Hz) next to a frequency [Hz], and how far above it
    the frequency lies [cents]."""
    semitones = 69 + 12 * octaves_of_ratio(frequency / 440)
    key = round(semitones)
    octave, step = divmod(key, 12)
    return f"{_NOTE_NAMES[step]}{octave - 1}", 100 * (semitones - key)


def word_of(note_text: str) -> str | None:
    """The name of the member for a pitch: `A4+386_3cents` for `A4+386.3cents`, `3to2` for `3/2`;
    None if the text is not a pitch.
    """
    word = tuning.spelled(note_text)
    return word if tuning.is_pitch(word) else None


def pitch(pitch_text: str) -> float | None:
    """The height of a pitch in semitones: 69.0 at 440 Hz; None if the text is not a pitch. Notes of
    equal temperament have whole numbers.

    Raises TextError for a key that the tuning leaves out.
    """
    pitch_word = tuning.spelled(pitch_text)
    if tuning.current().is_plain and (note := number(pitch_word)) is not None:
        return note
    return tuning.current().pitch(pitch_word)


def step(note_text: str) -> float | None:
    """The number of a note by which it is moved: its key, where semitones are keys, or how high it
    is in semitones; None if the text is no pitch. Raises TextError.
    """
    key = number(note_text) if tuning.current().has_keys else None
    return pitch(note_text) if key is None else key


def moved(pitch_word: str, semitones: float) -> str:
    """The word of a pitch moved by semitones; an integer of them is keys, where notes are keys.
    Raises TextError.
    """
    cents_match = _WITH_CENTS.fullmatch(pitch_word)
    if cents_match is None:
        return tuning.hertz_word(q.frequency(pitch_word) * _core.pow(2.0, semitones / 12.0))
    note_name, cents = cents_match[1], float((cents_match[2] or "0").replace("_", "."))
    current_tuning, note_key = tuning.current(), number(note_name)
    counts_keys = isinstance(semitones, int) or (
        current_tuning.scale is None and semitones.is_integer()
    )
    if current_tuning.has_keys and note_key is not None and counts_keys:
        note_name = name(note_key + int(semitones))
    else:
        cents += 100.0 * semitones
    cents = round(cents, 6)
    return tuning.spelled(f"{note_name}{cents:+.10g}cents") if cents else note_name


def chord(root_note: str, scale: str) -> list[str]:
    """The words of the notes of a scale or a chord, by its name, above a note. Raises TextError
    where they have no name.
    """
    scale_steps, root = SCALES[scale], number(root_note)
    if tuning.current().has_keys and root is not None:
        is_flat = root_note[1:2] in ("b", "♭")
        return [name(root + step, flat=is_flat) for step in scale_steps]
    if root is None:
        base_frequency = q.frequency(root_note)
        return [
            tuning.hertz_word(base_frequency * _core.pow(2.0, step / 12.0)) for step in scale_steps
        ]
    return tuning.current().above(root_note, scale_steps)


def scale_step(scale_word: str) -> str:
    """The word of a note, or of a step of a scale, in semitones above its root: of `A3.minor.7`
    that of E4. Raises TextError where it has no name.
    """
    root, _, scale = tuning.spelled(scale_word).partition(".")
    scale, _, semitones = scale.rpartition(".")
    return chord(root, scale)[SCALES[scale].index(int(semitones))] if semitones else root


def read_note(note_word: str) -> int:
    """The number of a note that is written. Raises TextError."""
    q.frequency(note_word)  # says what is meant by H3 or c4
    midi_number = number(note_word)
    if midi_number is None or not LOWEST <= midi_number <= HIGHEST:
        message = f"{quote(note_word)} is not a note such as A3 or Bb2"
        raise TextError(message, length=max(1, len(note_word)), code="E201")
    return midi_number


def parse_notes(text: str) -> tuple[str, ...]:
    """Read `D3 F3 A3`, `C3..C5 pentatonic`, `C3 minor count 8`, `A3.min7`. Raises TextError."""
    placed_words = [(match.group(), match.start()) for match in _WORD.finditer(text)]
    if not placed_words:
        raise TextError(f"no note is written; write for instance {_EXAMPLE}", code="E201")
    if ".." in placed_words[0][0] or any(word == "count" for word, _ in placed_words):
        return _range(placed_words)
    note_words: list[str] = []
    for typed_word, text_offset in placed_words:
        root_note, dot, scale = tuning.spelled(typed_word).partition(".")
        try:
            check_note(root_note)
        except TextError as error:
            error.offset += text_offset
            raise
        if dot:
            _scale(scale, text_offset + len(typed_word) - len(scale))
        note_words += chord(root_note, scale) if dot else [root_note]
    return _checked_notes(note_words)


def _read_number(word: str, word_offset: int) -> int:
    try:
        return read_note(word)
    except TextError as error:
        error.offset += word_offset
        raise


def check_note(note_text: str) -> None:
    """Check that a text is a note, or another pitch by which members are called. Raises
    TextError.
    """
    note_word = tuning.spelled(note_text)
    if number(note_word) is None and tuning.is_pitch(note_word):
        q.frequency(note_word)
    else:
        read_note(note_word)


def _range(words: list[tuple[str, int]]) -> tuple[str, ...]:
    (first_word, words_offset), later_words = words[0], words[1:]
    low_name, range_dots, high_name = first_word.partition("..")
    count = None
    low = _read_number(low_name, words_offset)
    high = _read_number(high_name, words_offset + len(low_name) + 2) if range_dots else None
    scale, scale_offset = "chromatic", words_offset
    if later_words and later_words[0][0] != "count":
        (scale, scale_offset), later_words = later_words[0], later_words[1:]
    steps = _scale(scale, scale_offset)
    if later_words and later_words[0][0] == "count":
        count_word, count_offset = (
            later_words[1] if len(later_words) > 1 else ("", later_words[0][1])
        )
        if not re.fullmatch(r"[0-9]{1,6}", count_word) or not 1 <= int(count_word) <= MAX_NOTES:
            message = f"`count` needs a whole number from 1 to {MAX_NOTES}"
            raise TextError(
                message, offset=count_offset, length=max(1, len(count_word)), code="E202"
            )
        count, later_words = int(count_word), later_words[2:]
    if later_words:
        word, word_offset = later_words[0]
        message = f"unknown word {quote(word)}; notes are written like {_EXAMPLE}"
        raise TextError(message, offset=word_offset, length=len(word), code="E204")
    if high is not None and high < low:
        message = f"the range {quote(first_word)} runs downwards; write the lower note first"
        suggestion = f"{high_name}..{low_name}"
        raise TextError(
            message, offset=words_offset, length=len(first_word), suggestion=suggestion, code="E202"
        )
    highest_note = HIGHEST if high is None else high
    octaves = range((HIGHEST - low) // 12 + 1)
    if not tuning.current().has_keys:
        spelled_names = _spelled_range(
            low_name, name(highest_note) if high is None else high_name, scale
        )[:count]
    else:
        note_numbers = [low + 12 * octave + step for octave in octaves for step in steps]
        is_flat = low_name[1:2] in ("b", "♭")
        spelled_names = [
            low_name,
            *(name(note, flat=is_flat) for note in note_numbers[1:] if note <= highest_note),
        ][:count]
    if count is not None and len(spelled_names) < count:
        message = (
            f"from {low_name} to {high_name or name(HIGHEST)} there are {len(spelled_names)} notes"
        )
        message += f", not {count}"
        raise TextError(message, offset=words_offset, length=len(first_word), code="E202")
    return _checked_notes(spelled_names)


def _spelled_range(low_note: str, high_note: str, scale: str) -> list[str]:
    """The notes of a scale from one to another, where a sharp is no flat; chromatic: all steps."""
    current_tuning, top_pitch = tuning.current(), pitch(high_note) or 0.0
    if scale == "chromatic":
        return current_tuning.degrees(low_note, high_note)
    match = _NOTE.fullmatch(low_note)
    assert match is not None
    roots = (f"{match[1]}{match[2]}{octave}" for octave in range(int(match[3]), 10))
    notes = [note for root in roots for note in current_tuning.above(root, SCALES[scale])]
    return [note for note in notes if (pitch(note) or 0.0) <= top_pitch]


def _scale(scale: str, scale_offset: int) -> tuple[int, ...]:
    if scale not in SCALES:
        message = f"{quote(scale)} is not the name of a scale or a chord"
        suggestion = nearest(scale, SCALES)
        length = max(1, len(scale))
        raise TextError(
            message, offset=scale_offset, length=length, suggestion=suggestion, code="E206"
        )
    return SCALES[scale]


def _checked_notes(note_words: list[str]) -> tuple[str, ...]:
    if len(note_words) > MAX_NOTES:
        message = f"{len(note_words)} notes are written; the maximum is {MAX_NOTES}"
        raise TextError(message, code="E202")
    notes_by_pitch: dict[float | None, str] = {}
    for note_word in note_words:
        if (same_note := notes_by_pitch.setdefault(pitch(note_word), note_word)) is not note_word:
            message = f"{quote(note_word)} is written twice"
            if same_note != note_word:
                message = (
                    f"{quote(note_word)} is the same note as {quote(same_note)}; remove one of them"
                )
            raise TextError(message, code="E202")
    return tuple(note_words)


@dataclass(frozen=True)
class Notes(Shape):
    """`[D3, F3, A3]`, `C3..C5 pentatonic`, `C3 minor count 8`: the names of notes."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        item_nodes = node.items if isinstance(node, document.Sequence) else [node]
        note_words: list[str] = []
        for item_node in item_nodes:
            if not isinstance(item_node, Scalar) or not item_nodes:
                return wrong_shape(self, item_node, name, context)
            try:
                note_words += parse_notes(item_node.text)
                _checked_notes(note_words)
            except TextError as error:
                context.text_error(error, item_node, name)
                return MISSING
        if not note_words:
            context.error("E106", f"{context.label(name)}: no note is written", node.place)
            return MISSING
        return tuple(note_words)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["array", "string"], "items": {"type": ["string"]}, "minItems": 1}

    def words(self) -> str:
        """In words."""
        return f"notes, such as [D3, F3, A3] or {_EXAMPLE}"
