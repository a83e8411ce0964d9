"""Answers about a position in a score: completions, explanations, definitions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from ergon.notation.tables import tuning
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.notes import Notes, nearest_note
from ergon.notation.tables.shapes import Reference, Shape, Text
from ergon.notation.text.document import Document
from ergon.notation.text.errors import TextError
from ergon.scores.reading.gesture_tables import CURVE_SHAPE, GestureShape, UnreadText
from ergon.scores.reading.part import OPTION_SHAPES, PartShape
from ergon.scores.reading.rhythms import RHYTHM_SHAPE

from . import cursor as cursors
from . import music_parts
from .catalogue import Catalogue, Definition
from .cursor import Cursor

_NOTES = [f"{letter}{octave}" for octave in range(1, 7) for letter in "CDEFGAB"]
_GESTURE_SECTIONS = ("gestures", "takes")


@dataclass(frozen=True, slots=True)
class Completion:
    """A possible word at the cursor."""

    word: str
    kind: Literal["field", "kind", "name", "value", "unit"]
    detail: str
    suffix: str = ""  # what is put in after the word


def completions(text: str, index: int, file: Document, catalogue: Catalogue) -> list[Completion]:
    """Words that may be written at a character of a score."""
    with tuning.used(catalogue.tuning):
        return _completions(text, index, file, catalogue)


def _completions(text: str, index: int, file: Document, catalogue: Catalogue) -> list[Completion]:
    number_before = _number_before(text, index)
    completion_by_word: dict[str, Completion] = {}
    text_cursor = cursors.cursor_at(file, index)
    if text_cursor is not None and "\n" in text_cursor.node.text:  # a table below '|' holds no YAML
        return list(_value_completions(text_cursor.shape, catalogue, number_before))
    for cursor, read_document in cursors.cursors_at_unwritten(text, index, file):
        for part in music_parts.parts_beside(cursor, read_document):
            completion_by_word[part.id] = Completion(part.id, "value", music_parts.part_text(part))
        completions = (
            _key_completions(cursor)
            if cursor.is_name
            else _value_completions(cursor.shape, catalogue, number_before)
        )
        for completion in completions:
            completion_by_word.setdefault(completion.word, completion)
    return list(completion_by_word.values())


def _key_completions(cursor: Cursor) -> Iterator[Completion]:
    """Fields and kinds of the table that are not written yet."""
    if cursor.table is None:
        return
    for field in cursor.table.fields:
        if field.name not in cursor.sibling_names:
            yield Completion(field.name, "field", _field_text(field), ": ")
    if cursor.sibling_names.isdisjoint(cursor.table.kinds):
        for kind, shape in cursor.table.kinds.items():
            yield Completion(kind, "kind", _shape_text(shape), ": ")


def _value_completions(
    shape: Shape | None, catalogue: Catalogue, number_before: str
) -> Iterator[Completion]:
    if isinstance(shape, Text) and number_before:
        for unit in shape.units or (("Hz", "kHz") if shape is k.PITCH else ()):
            yield Completion(number_before + unit, "unit", shape.words())
    elif isinstance(shape, Text):
        yield from _word_completions(shape)
        for choice in shape.choices:
            yield Completion(str(choice), "value", shape.words())
        if shape is k.BOOLEAN:
            yield from (Completion(word, "value", shape.words()) for word in ("true", "false"))
        if shape is k.PITCH:
            yield from (
                Completion(note, "value", f"{frequency_of(note):.2f} Hz") for note in _NOTES
            )
        if shape is RHYTHM_SHAPE:
            yield from _name_completions(catalogue.definitions_in("instruments"))
        if shape in (k.WHEN, k.MARK):
            yield from _name_completions(catalogue.definitions_in("marks"))
    elif isinstance(shape, Reference):
        yield from _name_completions(catalogue.definitions_in(*shape.sections))
    elif isinstance(shape, PartShape):
        yield from _name_completions(catalogue.definitions_in("marks", *_GESTURE_SECTIONS))
        for word, option in OPTION_SHAPES.items():
            yield Completion(word, "field", option.words(), " ")
        yield from _word_completions(shape)
    elif isinstance(shape, (GestureShape, UnreadText)):
        yield from (Completion(str(word), "value", "a curve") for word in CURVE_SHAPE.choices)
    elif shape is not None and shape.vocabulary():
        yield from _word_completions(shape)
    elif (
        shape is not None
        and (inner_shape := shape.inner(0)) is not None
        and inner_shape is not shape
    ):
        yield from _value_completions(inner_shape, catalogue, number_before)


def _word_completions(shape: Shape) -> Iterator[Completion]:
    for word, meaning in shape.vocabulary().items():
        yield Completion(word, "value", meaning)


def _name_completions(definitions: Iterable[Definition]) -> Iterator[Completion]:
    for name_definition in definitions:
        yield Completion(
            name_definition.name,
            "name",
            f"{name_definition.noun}, {name_definition.place.file}:{name_definition.place.line}",
        )


def _number_before(text: str, index: int) -> str:
    """The digits that end at a character: a unit may follow them."""
    begin = index
    while begin > 0 and (text[begin - 1].isdigit() or text[begin - 1] in ".-+/"):
        begin -= 1
    digits = text[begin:index]
    return digits if any(c.isdigit() for c in digits) else ""


def explanation(index: int, file: Document, catalogue: Catalogue) -> str | None:
    """The explanation of the text under a character, in Markdown; None if there is none."""
    cursor = cursors.cursor_at(file, index)
    if cursor is None:
        return None
    with tuning.used(_tuning_at(cursor, catalogue)):
        return _explanation(index, cursor, file, catalogue)


def _tuning_at(cursor: Cursor, catalogue: Catalogue) -> tuning.Tuning | None:
    """The tuning of the notes under a cursor: in an instrument, and in a name of one, its own."""
    path = cursor.node.text
    if cursor.path[:1] == ("instruments",):
        path = ".".join(cursor.path[1:2])
    return tuning.tuning_of_path(path, catalogue.tunings, catalogue.tuning)


def _explanation(index: int, cursor: Cursor, file: Document, catalogue: Catalogue) -> str | None:
    if cursor.is_name:
        if cursor.field is not None:
            return f"**{cursor.field.name}**: {_field_text(cursor.field)}"
        if cursor.table is not None and cursor.node.text in cursor.table.kinds:
            return f"**{cursor.node.text}**: {_shape_text(cursor.table.kinds[cursor.node.text])}"
    elif cursor.shape is k.PITCH:
        try:
            return _hertz_text(frequency_of(cursor.node.text))
        except TextError:
            return None
    elif meaning := _meaning(index, cursor, file.text):
        return meaning
    for part in music_parts.parts_beside(cursor, file):
        if cursor.node.text in (part.id, part.name):
            return f"**{part.id}**: {music_parts.part_text(part)}"
    name_definition = definition(index, file, catalogue)
    pitch_text = None if cursor.is_name else _pitch_text(index, cursor, file.text)
    if name_definition is None or pitch_text is not None:
        return pitch_text
    definition_line = (
        file.line(name_definition.place.line).strip()
        if name_definition.place.file == file.file
        else ""
    )
    source = (
        f"\n```yaml\n{definition_line}\n```"
        if definition_line
        else f" of {name_definition.place.file}"
    )
    return f"{name_definition.noun} **{name_definition.name}**{source}"


def _meaning(index: int, cursor: Cursor, text: str) -> str | None:
    """What the word under a character means in texts of this shape; None if they have none."""
    words = {} if cursor.shape is None else cursor.shape.vocabulary()
    word = cursors.word_at(text, index)
    return f"**{word}**: {words[word]}" if word in words else None


def _pitch_text(index: int, cursor: Cursor, text: str) -> str | None:
    """The frequency of the pitch under a character; None if there is none. Fractions are ratios
    only in lists of notes and in names, for elsewhere they are times.
    """
    word = cursors.pitch_at(text, index)
    is_notes = cursor.field is not None and isinstance(cursor.field.shape, Notes)
    may_be_ratio = is_notes or isinstance(cursor.shape, Reference)
    if word is None or not (may_be_ratio or word[:1].isalpha() or word.endswith("Hz")):
        return None
    try:
        return f"**{word}**: {_hertz_text(frequency_of(word))}"
    except TextError:
        return None


def _hertz_text(frequency: float) -> str:
    """A frequency, and how far it is from the next note of equal temperament."""
    if frequency <= 0.0:
        return f"{frequency:.3f} Hz"
    note, cents = nearest_note(frequency)
    return f"{frequency:.3f} Hz, {note}" + (f" {cents:+.1f} cents" if abs(cents) >= 0.05 else "")


def definition(index: int, file: Document, catalogue: Catalogue) -> Definition | None:
    """Where the name under a character is defined."""
    cursor = cursors.cursor_at(file, index)
    word = cursors.word_at(file.text, index).strip("/-")
    if cursor is None or cursor.is_name or not word:
        return None
    shape = cursor.shape
    if isinstance(shape, Reference) and "modules" in shape.sections and len(cursor.path) > 1:
        module_definition = catalogue.find(
            f"{cursor.path[1]}.{word}", ("modules",)
        )  # a module of the same one
        if module_definition is not None:
            return module_definition
    return catalogue.find(word, shape.sections if isinstance(shape, Reference) else ())


def frequency_of(text: str) -> float:
    """The frequency of a note or of a number with its unit [Hz]. Raises TextError."""
    frequency: float = k.PITCH.parse(text)
    return frequency


def _field_text(field: Field) -> str:
    default = f"; default: {field.shown}" if field.shown else ""
    return f"{field.doc} ({field.shape.words()}{'; required' if field.required else default})"


def _shape_text(shape: Shape) -> str:
    return shape.doc if isinstance(shape, Record) else shape.words()
