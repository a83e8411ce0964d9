"""Melodies: strikes one by one, as a list or a table `at  what  impulse`, and phrases of them."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import notes, value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.named_values import has_name, is_computed, note_of
from ergon.notation.tables.shapes import MISSING, Context, Name, Reference, Shape, Text, wrong_shape
from ergon.notation.tables.strengths import LEVEL, Level, is_level
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import TextError
from ergon.notation.text.values import Place
from ergon.scores.pattern import words
from ergon.scores.reading.foreign_words import ADVICE_BY_WORD, FIELD_SYNONYMS

MAX_ROWS = 100_000  # rows of one melody
_ZERO_LENGTH = Length()
MAX_CHORD = 256  # names of one strike
_WORD_PATTERN = re.compile(r"\S+")
_ENTRY_HELP = "an entry says `what` is struck; `to`, beside `entries`, is whose notes they are"


@dataclass(frozen=True, slots=True)
class Row:
    """A strike as written: time, names of what is struck, and level (None: as the row before)."""

    at: Position | Length
    struck_names: tuple[Name, ...]
    level: Level | None
    place: Place
    written_names: tuple[Name, ...] = ()  # names before a transposition
    jitter: Length = _ZERO_LENGTH  # how far chance moves it, earlier or later
    length: Length | None = None  # None: it has no end
    is_swelling: bool = False  # whether the level swells to the next written one
    act: str = ""  # by which notes are played, if the instrument has it; "": the usual one


class StruckNamesShape(Reference):
    """Names separated by spaces, or as a list."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        items = node.items if isinstance(node, document.Sequence) else [node]
        struck_names: list[Name] = []
        for item_node in items:
            if not isinstance(item_node, Scalar):
                return wrong_shape(self, item_node, name, context)
            for word in _WORD_PATTERN.finditer(item_node.text):
                struck_name = _struck_name(word.group(), word.start(), item_node, name, context)
                if struck_name is None:
                    return MISSING
                struck_names.append(struck_name)
        if not 1 <= len(struck_names) <= MAX_CHORD:
            message = f"{context.label(name)}: from 1 to {MAX_CHORD} names are expected"
            context.error("E106", message, node.place)
            return MISSING
        return tuple(struck_names)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "array"], "items": {"type": ["string"]}}


def _is_impulse(last_row_word: str, text_node: Scalar, *, is_alone: bool) -> bool:
    """Whether the last word of a row is an impulse, not a name of what is struck. A ratio is an
    impulse, unless it is alone.
    """
    if notes.word_of(last_row_word) is not None and (is_alone or "/" not in last_row_word):
        return False
    if is_level(last_row_word) and not (is_alone and last_row_word[:1].isalpha()):
        return True
    try:
        return (
            is_computed(last_row_word, text_node.document)
            and note_of(last_row_word, text_node.document) is None
        )
    except TextError:
        return not is_alone or not has_name(last_row_word, text_node.document)


def _struck_name(
    struck_word: str, word_start: int, text_node: Scalar, field_name: str, context: Context
) -> Name | None:
    """The name that a word strikes: the word itself, or the note that it stands for."""
    try:
        note = note_of(struck_word, text_node.document)
    except TextError as error:
        error.offset += word_start
        context.text_error(error, text_node, field_name)
        return None
    return Name(note or struck_word, text_node.place_at(word_start, len(struck_word)))


class SwellingLevel(NamedTuple):
    """A level, and whether it leads to the next one that is written: `p ->`."""

    level: Level
    is_swelling: bool


def _parse_swelling(text: str) -> SwellingLevel:
    word = text.rstrip()
    is_swelling = word.endswith("->")
    return SwellingLevel(LEVEL.parse(word[:-2].rstrip() if is_swelling else text), is_swelling)


SWELLING_SHAPE = replace(
    LEVEL,
    parse=_parse_swelling,
    what=f"{LEVEL.what}; p -> leads to the next one",
    pattern=f"{(LEVEL.pattern or '$')[:-1]}( *->)?$",
)


def _row_of_values(values: Values) -> Row:
    level, is_swelling = values["impulse"] or (None, False)
    return Row(values["at"], values["what"], level, values.node.place, is_swelling=is_swelling)


def _entry_record(position_kind: Text, doc: str) -> Record:
    entry_fields = (
        Field("at", position_kind, doc, required=True),
        Field(
            "what",
            StruckNamesShape("notes or modules, such as D3, or D3 F3"),
            "what",
            required=True,
        ),
        Field("impulse", SWELLING_SHAPE, "how strongly", shown="that of the strike before"),
    )
    doc, foreign_words = "a strike of a melody: a note, a chord, a module", {"to": _ENTRY_HELP}
    return Record(
        "strike",
        doc,
        entry_fields,
        _row_of_values,
        help_by_foreign_name=foreign_words,
        synonyms=FIELD_SYNONYMS["strike"],
        advice_by_name=ADVICE_BY_WORD["strike"],
    )


ENTRY_RECORD = _entry_record(value_kinds.WHEN, "where in the piece")
PHRASE_ENTRY_RECORD = _entry_record(
    value_kinds.LENGTH, "how long after the beginning of the phrase"
)


@dataclass(frozen=True)
class EntriesShape(Shape):
    """A list of strikes, or a table with rows such as `1|1  D3 F3  2mNs`."""

    entry_record: Record

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Sequence):
            return _checked_rows(
                ListOf(self.entry_record, 1, MAX_ROWS).read(node, name, context), context
            )
        if not isinstance(node, Scalar) or node.is_empty:
            return wrong_shape(self, node, name, context)
        rows, is_broken = [], False
        for number, (phrase_row, row_offset) in enumerate(words.rows(node.text)):
            if number >= MAX_ROWS:
                context.error("E105", f"the table has more than {MAX_ROWS:,} rows", node.place)
                return MISSING
            row = self._row(phrase_row, row_offset, node, context)
            is_broken |= row is None
            rows += [row] if row is not None else []
        if not rows and not is_broken:
            context.error("E106", f"{context.label(name)}: the table has no row", node.place)
            return MISSING
        return MISSING if is_broken else _checked_rows(tuple(rows), context)

    def _row(self, row: str, offset: int, node: Scalar, context: Context) -> Row | None:
        row_cells = [(word.group(), offset + word.start()) for word in _WORD_PATTERN.finditer(row)]
        (position_text, position_start), option_cells = row_cells[0], row_cells[1:]
        impulse, is_swelling = None, bool(option_cells) and option_cells[-1][0] == "->"
        if is_swelling:
            arrow_word, arrow_start = option_cells.pop()
            if not option_cells or not is_level(option_cells[-1][0]):
                message = "`->` leads from a level to the next one: write p -> in this row"
                offset_in_node = node.place_at(arrow_start, len(arrow_word))
                context.error("E204", message, offset_in_node)
                return None
        if option_cells and _is_impulse(option_cells[-1][0], node, is_alone=len(option_cells) == 1):
            impulse = self._parse_value("impulse", *option_cells.pop(), node, context)
        row_time = self._parse_value("at", position_text, position_start, node, context)
        if not 1 <= len(option_cells) <= MAX_CHORD:
            message = "a row has a time, what is struck and an impulse, such as 1|1  D3 F3  2mNs"
            context.error("E204", message, node.place_at(position_start, len(position_text)))
            return None
        struck_names = [
            _struck_name(word, offset_in_node, node, "what", context)
            for word, offset_in_node in option_cells
        ]
        if row_time is MISSING or impulse is MISSING or None in struck_names:
            return None
        valid_names = tuple(name for name in struck_names if name is not None)
        row_level = impulse and impulse.level
        return Row(
            row_time,
            valid_names,
            row_level,
            node.place_at(position_start, len(position_text)),
            is_swelling=is_swelling,
        )

    def _parse_value(
        self, field: str, word: str, offset: int, node: Scalar, context: Context
    ) -> Any:
        shape = self.entry_record.by_name[field].shape
        assert isinstance(shape, Text)
        try:
            return shape.read_word(word, node.document)
        except TextError as error:
            error.offset += offset
            context.text_error(error, node, field)
            return MISSING

    def chosen(self, node: Node) -> Shape:
        """The list of strikes, unless a table is written."""
        return (
            ListOf(self.entry_record, 1, MAX_ROWS) if isinstance(node, document.Sequence) else self
        )

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        array = ListOf(self.entry_record, 1).schema()
        return {**array, "type": ["array", "string"]}

    def words(self) -> str:
        """In words."""
        example = "1|1" if self.entry_record is ENTRY_RECORD else "1/2"
        return f"a list of strikes, or a table below '|' with rows such as {example}  D3 F3  2mNs"


def _checked_rows(phrase_rows: Any, context: Context) -> Any:
    """Rows, unless one swells to no level, or to one of another kind."""
    if phrase_rows is MISSING:
        return MISSING
    rows = [row for row in phrase_rows if isinstance(row, Row)]
    for row_index, phrase_row in enumerate(rows):
        if not phrase_row.is_swelling or phrase_row.level is None:
            continue
        swell_end = next(
            (later_row.level for later_row in rows[row_index + 1 :] if later_row.level is not None),
            None,
        )
        if swell_end is None:
            message = "`->` leads to the next level, and no entry after this one has a level"
        elif swell_end.is_strength != phrase_row.level.is_strength or not (
            _is_single_level(phrase_row.level) and _is_single_level(swell_end)
        ):
            message = "`->` leads from one level to another of its kind, such as p -> and f"
        else:
            continue
        context.error("E204", message, phrase_row.place)
        return MISSING
    return phrase_rows


def _is_single_level(level: Level) -> bool:
    return level.low == level.high and level.factor == 1.0
