"""Parts: what a player plays, as a list of entries or as a table of rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple, cast

from ergon.notation.clock.positions import Length, Position
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Context, Name, Reference, Shape, Text, wrong_shape
from ergon.notation.text.document import Node, Scalar, Sequence
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.values import Place
from ergon.scores.gesture.transforms import Transform
from ergon.scores.pattern import words
from ergon.scores.pattern.order import Group, name_of, parse, single_name_pattern
from ergon.scores.pattern.pattern import Pattern, iteration_mistake
from ergon.scores.pattern.turn_chain import Change, as_turns
from ergon.scores.pattern.turns import parse as parse_turns
from ergon.scores.pattern.turns import with_numbers
from ergon.scores.reading.patterns import PATTERN_TABLE, PatternValues, pattern_of
from ergon.scores.reading.playing import Play
from ergon.scores.reading.playing_options import (
    ENTRY_FIELDS,
    HAND_WORDS,
    PLAY_DO,
    OptionValues,
    playing_options,
)

MAX_ROWS = 1_000_000
PATTERN_LENGTH_MAX = 10_000  # characters


def _report_unused_rate(context: Context, place: Place) -> None:
    reason = "a part entry has no rate, so the value is not used; write `rate` on the key"
    message = f"{context.label('rate')}: {reason}"
    context.error("N403", message, place)


class _EntryValues(PatternValues, OptionValues, total=False):
    """What is written of an entry or in a row, beside what is played."""

    at: Position
    every: Length
    times: int
    until: Position
    do: tuple[Change, ...]


def _play_of_values(play_values: Values) -> Play:
    if play_values.written("rate"):
        _report_unused_rate(play_values.context, play_values.place_of("rate"))
    until_place = play_values.place_of("until") if play_values.written("until") else None
    played: Played = play_values["play"] or Played("", None, play_values.place)
    written_options = cast("_EntryValues", play_values.by_name)
    return _play_of_entry(
        written_options, play_values.context, played, play_values.place_of("at"), until_place
    )


def _play_of_entry(
    entry_values: _EntryValues,
    context: Context,
    played: Played,
    begin_place: Place,
    until_place: Place | None,
) -> Play:
    transform_chain, turns = as_turns(entry_values.get("do", ()))
    if turns:
        entry_values = {
            **entry_values,
            "nth": with_numbers((*entry_values.get("nth", ()), *turns)),
        }
    pattern = pattern_of(entry_values, played.order or single_name_pattern(played.text))
    if iteration_error := iteration_mistake(pattern):
        context.error("E305", f"{quote(played.text)}: {iteration_error}", played.place)
    single_leaf = next(pattern.leaves(), None) if pattern.is_plain else None
    return Play(
        player=context.name,
        played_text=played.text if single_leaf is None else single_leaf.name or "",
        at=entry_values["at"],
        every=_repetition_length(pattern, entry_values.get("every"), transform_chain),
        times=entry_values.get("times"),
        until=entry_values.get("until"),
        do=transform_chain,
        options=playing_options(entry_values),
        place=played.place,
        begin_place=begin_place,
        until_place=until_place,
        pattern=pattern if single_leaf is None else None,
    )


def _repetition_length(
    pattern: Pattern, step_length: Length | None, transform_chain: Iterable[Transform]
) -> Length | None:
    """The time between repetitions, which `fast` and `slow` change; None where a gesture's own
    length says it.
    """
    factor = prod(change.period_factor for change in transform_chain)
    if factor != 1.0 and step_length is None and pattern.euclid is not None:
        step_length = Length(bars=1.0 / pattern.euclid.steps)  # a round lasts a bar
    return step_length if step_length is None or factor == 1.0 else step_length.times(factor)


class Played(NamedTuple):
    """What is played: its text with single spaces, and its pattern unless it is one name."""

    text: str
    order: Group | None
    place: Place


class _PlayedShape(Reference):
    """A gesture, a take, or a pattern of them."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        table_text = node.text if isinstance(node, Scalar) else ""
        if (
            not isinstance(node, Scalar)
            or not table_text.strip()
            or len(table_text) > PATTERN_LENGTH_MAX
        ):
            return super().read(node, name, context)
        if table_text.strip().isidentifier():
            return Played(Name(table_text.strip(), node.place), None, node.place)

        def name_at(word: str, offset: int) -> Name:
            return Name(name_of(word, offset), node.place_at(offset, len(word)))

        try:
            play_order = parse(table_text, name_at)
        except TextError as error:
            context.text_error(error, node, name)
            return MISSING
        return Played(" ".join(table_text.split()), play_order, node.place)


_PLAYED_SHAPE = _PlayedShape(
    "a gesture or a take, or several, such as knock lean knock", ("gestures", "takes")
)
_TURNS_SHAPE = Text(
    parse_turns, "transformations of some rounds, such as 4th do mirror", has_values=True
)
_WHEN_FIELD = Field("at", value_kinds.WHEN, "when it begins", required=True)
_OPTION_FIELDS = (
    Field("every", value_kinds.LENGTH, "time between repetitions or steps", shown="its own length"),
    Field(
        "times",
        value_kinds.TIMES,
        "number of repetitions; of whole rounds, where a pattern plays",
        shown="once, or until `until`",
    ),
    Field("until", value_kinds.WHEN, "position from which on no repetition begins"),
    *PATTERN_TABLE,
    Field("nth", _TURNS_SHAPE, "transformations of every nth round"),
    *ENTRY_FIELDS,
    Field("rate", value_kinds.RATE, "not used; the rate of the key is"),
)
PLAY_RECORD = Record(
    "part entry",
    "a gesture or take, when, how often and how",
    (
        _WHEN_FIELD,
        Field("play", _PLAYED_SHAPE, "what is played: a name or a pattern", required=True),
        *_OPTION_FIELDS,
        Field("do", PLAY_DO, "transformations, left to right"),
    ),
    _play_of_values,
    synonyms={"repeat": "times"},
)
# The shape that reads each word's value, here and at the prompt.
OPTION_SHAPES = {f.name: f.shape for f in (_WHEN_FIELD, *_OPTION_FIELDS)}


@dataclass(frozen=True)
class PartShape(Shape):
    """A list of entries, or a table: `A  lean every 8 times 2`."""

    entries: ListOf

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, Sequence) or (isinstance(node, Scalar) and node.is_empty):
            return self.entries.read(node, name, context)
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        plays = []
        for row_index, (row_text, row_offset) in enumerate(words.rows(node.text)):
            if row_index >= MAX_ROWS:
                context.error("E105", f"the table has more than {MAX_ROWS:,} rows", node.place)
                break
            play = _play_of_row(row_text, row_offset, node, context)
            if play is not None:
                plays.append(play)
        return tuple(plays)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        array = self.entries.schema()
        return {**array, "type": ["array", "string", "null"]}

    def words(self) -> str:
        """In words."""
        return "a list of entries, or a table below '|' with rows such as A  knock every 1"

    def vocabulary(self) -> dict[str, str]:
        """The words of transformations in rows."""
        return HAND_WORDS

    def chosen(self, node: Node) -> Shape:
        """The list of entries, unless a table is written."""
        return self if isinstance(node, Scalar) and not node.is_empty else self.entries


def _play_of_row(
    row_text: str, text_offset: int, text_node: Scalar, context: Context
) -> Play | None:
    try:
        parsed_row = words.parse_row(
            row_text,
            text_offset,
            lambda word, offset: Name(word, text_node.place_at(offset, len(word))),
        )
    except TextError as error:
        context.text_error(error, text_node, "")
        return None
    entry_fields: dict[str, object] = {}
    is_refused = False
    for option_name, word in (("at", parsed_row.at), *parsed_row.play.options.items()):
        option_value = _read_option(option_name, word, text_node, context)
        if option_value is MISSING:
            is_refused = True
        else:
            entry_fields[option_name] = option_value
    if is_refused:
        return None
    entry_fields["do"] = parsed_row.play.transforms
    if "rate" in entry_fields:
        _report_unused_rate(context, _place(parsed_row.play.options["rate"], text_node))
    played_words, end_word = parsed_row.play.played, parsed_row.play.options.get("until")
    played_text = " ".join(played_words.text.split())
    row_place = _place(parsed_row.at, text_node)
    # In a literal block a row is one line of the file, so the column follows from that of
    # `row_place`.
    played_column = row_place.column + played_words.offset - parsed_row.at.offset
    is_block = text_node.style == "|"
    place = (
        Place(row_place.file, row_place.line, played_column, len(played_words.text))
        if is_block
        else _place(played_words, text_node)
    )
    return _play_of_entry(
        cast("_EntryValues", entry_fields),
        context,
        Played(Name(played_text, place), parsed_row.play.pattern, place),
        row_place,
        _place(end_word, text_node) if end_word else None,
    )


def _place(word: words.Word, node: Scalar) -> Place:
    return node.place_at(word.offset, len(word.text))


def _read_option(
    option_name: str, option_word: words.Word, text_node: Scalar, context: Context
) -> Any:
    shape = OPTION_SHAPES.get(option_name)
    if not isinstance(shape, Text):
        context.error(
            "E108", f"{option_name!r} is not built yet for a part", _place(option_word, text_node)
        )
        return MISSING
    try:
        return shape.read_word(option_word.text, text_node.document)
    except TextError as error:
        error.offset += option_word.offset
        context.text_error(error, text_node, option_name)
        return MISSING


PART_SHAPE = PartShape(ListOf(PLAY_RECORD))
