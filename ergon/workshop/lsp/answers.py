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
from ergon.scores.reading.part import OPTION_SHAPES, Part
from ergon.scores.reading.rhythms import RHYTHM

from . import cursor as cursors
from . import music_parts
from .catalogue import Catalogue, Definition
from .cursor import Cursor

_NOTES = [f"{letter}{octave}" for octave in range(1, 7) for letter in "CDEFGAB"]
_PLAYED = ("gestures", "takes")


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


def _completions(
    document_text: str, text_index: int, score_file: Document, catalogue: Catalogue
) -> list[Completion]:
    number_text = _number_before(document_text, text_index)
    by_word: dict[str, Completion] = {}
    in_text = cursors.cursor_at(score_file, text_index)
    if in_text is not None and "\n" in in_text.node.text:  # a table below '|' holds no YAML
        return list(_value_completions(in_text.shape, catalogue, number_text))
    for cursor, read in cursors.cursors_at_unwritten(document_text, text_index, score_file):
        for part in music_parts.parts_beside(cursor, read):
            by_word[part.id] = Completion(part.id, "value", music_parts.about(part))
        completions = (
            _key_completions(cursor)
            if cursor.is_name
            else _value_completions(cursor.shape, catalogue, number_text)
        )
        for completion in completions:
            by_word.setdefault(completion.word, completion)
    return list(by_word.values())


def _key_completions(cursor: Cursor) -> Iterator[Completion]:
    """Fields and kinds of the table that are not written yet."""
    if cursor.table is None:
        return
    for field in cursor.table.fields:
        if field.name not in cursor.written:
            yield Completion(field.name, "field", _field_text(field), ": ")
    if cursor.written.isdisjoint(cursor.table.kinds):
        for kind, shape in cursor.table.kinds.items():
            yield Completion(kind, "kind", _shape_text(shape), ": ")


def _value_completions(
    value_shape: Shape | None, catalogue: Catalogue, number_text: str
) -> Iterator[Completion]:
    if isinstance(value_shape, Text) and number_text:
        for unit in value_shape.units or (("Hz", "kHz") if value_shape is k.PITCH else ()):
            yield Completion(number_text + unit, "unit", value_shape.words())
    elif isinstance(value_shape, Text):
        yield from _word_completions(value_shape)
        for choice in value_shape.choices:
            yield Completion(str(choice), "value", value_shape.words())
        if value_shape is k.BOOLEAN:
            yield from (
                Completion(word, "value", value_shape.words()) for word in ("true", "false")
            )
        if value_shape is k.PITCH:
            yield from (
                Completion(note, "value", f"{frequency_of(note):.2f} Hz") for note in _NOTES
            )
        if value_shape is RHYTHM:
            yield from _name_completions(catalogue.definitions_in("instruments"))
        if value_shape in (k.WHEN, k.MARK):
            yield from _name_completions(catalogue.definitions_in("marks"))
    elif isinstance(value_shape, Reference):
        yield from _name_completions(catalogue.definitions_in(*value_shape.sections))
    elif isinstance(value_shape, Part):
        yield from _name_completions(catalogue.definitions_in("marks", *_PLAYED))
        for word, option in OPTION_SHAPES.items():
            yield Completion(word, "field", option.words(), " ")
        yield from _word_completions(value_shape)
    elif isinstance(value_shape, (GestureShape, UnreadText)):
        yield from (Completion(str(word), "value", "a curve") for word in CURVE_SHAPE.choices)
    elif value_shape is not None and value_shape.vocabulary():
        yield from _word_completions(value_shape)
    elif (
        value_shape is not None
        and (inner_shape := value_shape.inner(0)) is not None
        and inner_shape is not value_shape
    ):
        yield from _value_completions(inner_shape, catalogue, number_text)


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


def _number_before(document_text: str, text_index: int) -> str:
    """The digits that end at a character: a unit may follow them."""
    number_start = text_index
    while number_start > 0 and (
        document_text[number_start - 1].isdigit() or document_text[number_start - 1] in ".-+/"
    ):
        number_start -= 1
    digits = document_text[number_start:text_index]
    return digits if any(c.isdigit() for c in digits) else ""


def explanation(text_index: int, score_file: Document, catalogue: Catalogue) -> str | None:
    """The explanation of the text under a character, in Markdown; None if there is none."""
    cursor = cursors.cursor_at(score_file, text_index)
    if cursor is None:
        return None
    with tuning.used(_tuning_at(cursor, catalogue)):
        return _explanation(text_index, cursor, score_file, catalogue)


def _tuning_at(cursor: Cursor, catalogue: Catalogue) -> tuning.Tuning | None:
    """The tuning of the notes under a cursor: in an instrument, and in a name of one, its own."""
    path = cursor.node.text
    if cursor.path[:1] == ("instruments",):
        path = ".".join(cursor.path[1:2])
    return tuning.tuning_of_path(path, catalogue.tunings, catalogue.tuning)


def _explanation(
    text_index: int, cursor: Cursor, score_file: Document, catalogue: Catalogue
) -> str | None:
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
    elif meaning := _meaning(text_index, cursor, score_file.text):
        return meaning
    for part in music_parts.parts_beside(cursor, score_file):
        if cursor.node.text in (part.id, part.name):
            return f"**{part.id}**: {music_parts.about(part)}"
    name_definition = definition(text_index, score_file, catalogue)
    pitch_text = None if cursor.is_name else _pitch_text(text_index, cursor, score_file.text)
    if name_definition is None or pitch_text is not None:
        return pitch_text
    definition_line = (
        score_file.line(name_definition.place.line).strip()
        if name_definition.place.file == score_file.file
        else ""
    )
    source = (
        f"\n```yaml\n{definition_line}\n```"
        if definition_line
        else f" of {name_definition.place.file}"
    )
    return f"{name_definition.noun} **{name_definition.name}**{source}"


def _meaning(text_index: int, cursor: Cursor, document_text: str) -> str | None:
    """What the word under a character means in texts of this shape; None if they have none."""
    words = {} if cursor.shape is None else cursor.shape.vocabulary()
    word = cursors.word_at(document_text, text_index)
    return f"**{word}**: {words[word]}" if word in words else None


def _pitch_text(text_index: int, cursor: Cursor, document_text: str) -> str | None:
    """The frequency of the pitch under a character; None if there is none. Fractions are ratios
    only in lists of notes and in names, for elsewhere they are times.
    """
    cursor_word = cursors.pitch_at(document_text, text_index)
    is_notes = cursor.field is not None and isinstance(cursor.field.shape, Notes)
    is_sure = is_notes or isinstance(cursor.shape, Reference)
    if cursor_word is None or not (
        is_sure or cursor_word[:1].isalpha() or cursor_word.endswith("Hz")
    ):
        return None
    try:
        return f"**{cursor_word}**: {_hertz_text(frequency_of(cursor_word))}"
    except TextError:
        return None


def _hertz_text(frequency: float) -> str:
    """A frequency, and how far it is from the next note of equal temperament."""
    if frequency <= 0.0:
        return f"{frequency:.3f} Hz"
    note, cents = nearest_note(frequency)
    return f"{frequency:.3f} Hz, {note}" + (f" {cents:+.1f} cents" if abs(cents) >= 0.05 else "")


def definition(text_index: int, score_file: Document, catalogue: Catalogue) -> Definition | None:
    """Where the name under a character is defined."""
    cursor = cursors.cursor_at(score_file, text_index)
    cursor_word = cursors.word_at(score_file.text, text_index).strip("/-")
    if cursor is None or cursor.is_name or not cursor_word:
        return None
    shape = cursor.shape
    if isinstance(shape, Reference) and "modules" in shape.sections and len(cursor.path) > 1:
        module_definition = catalogue.find(
            f"{cursor.path[1]}.{cursor_word}", ("modules",)
        )  # a module of the same one
        if module_definition is not None:
            return module_definition
    return catalogue.find(cursor_word, shape.sections if isinstance(shape, Reference) else ())


def frequency_of(text: str) -> float:
    """The frequency of a note or of a number with its unit [Hz]. Raises TextError."""
    value: float = k.PITCH.parse(text)
    return value


def _field_text(field: Field) -> str:
    default = f"; default: {field.shown}" if field.shown else ""
    return f"{field.doc} ({field.shape.words()}{'; required' if field.required else default})"


def _shape_text(shape: Shape) -> str:
    return shape.doc if isinstance(shape, Record) else shape.words()
