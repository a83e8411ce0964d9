"""Shapes: what may stand after a name. Here are those of one text; others are in `compound`.

A shape reads one node. It reports mistakes itself and then returns MISSING, so that the rest of
the file is still read and all mistakes are reported at once. The same shape gives its JSON
Schema and its words in the reference.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

from ergon.notation.tables import named_values
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.memory import Memory
from ergon.notation.text.spelling import nearest
from ergon.notation.text.typeset import plain, typeset_character
from ergon.notation.text.values import Place

MISSING: Final = object()  # read, found wrong, reported
MAX_NAME = 64  # characters: names are said aloud
NAME = re.compile(r"[^\W\d][\w-]*")
# The pattern by which an editor recognises an expression.
EXPRESSION = r"[a-z_]\w*|.*\w *[*(].*|.* ([-+]|mod) .*"
# NAME for editors, whose \w matches ASCII only.
NAME_PATTERN = "^[A-Za-z_\u00aa-\uffff][\\w\u00aa-\uffff-]*$"


class Name(str):
    """A name by which the score refers to something, with the place where it is written.

    `written` is the word there: `string.hammer` for each of `string.D3.hammer`, `string.E3.hammer`.
    """

    __slots__ = ("place", "written")
    place: Place
    written: str

    def __new__(cls, name_word: str, name_place: Place, written: str | None = None) -> Name:
        """A string that remembers where it was written, and how if that differs."""
        placed_name = super().__new__(cls, name_word)
        placed_name.place = name_place
        placed_name.written = str(name_word) if written is None else written
        return placed_name


@dataclass(frozen=True, slots=True)
class Context:
    """The context of a reading: the collector of reports, and the owner of the fields (`key
    'k1'`).
    """

    collector: Collector
    owner: str = ""
    name: str = ""
    place: Place | None = None
    memory: Memory | None = None  # sections of earlier versions of the score
    tunings: Mapping[str, Tuning] = field(default_factory=dict)  # tunings of instruments by name

    def label(self, field_name: str) -> str:
        """`M of key 'k1'`."""
        if not field_name:
            return self.owner or "the score"
        return f"{field_name} of {self.owner}" if self.owner else f"'{field_name}'"

    def inside(self, noun: str, name: str, inner_place: Place) -> Context:
        """The context of a named thing; a module is called by its instrument's name too."""
        inner_name = f"{self.name}.{name}" if noun == "module" and self.name else name
        owner = f"{noun} {quote(inner_name)}"
        return Context(self.collector, owner, name, inner_place, tunings=self.tunings)

    def error(self, code: str, message: str, place: Place, **more: Any) -> None:
        """Report."""
        self.collector.error(code, message, place, **more)

    def text_error(self, error: TextError, scalar_node: Scalar, field_name: str) -> None:
        """Report a mistake inside a scalar at its characters; an empty name means the owner."""
        message = f"{self.label(field_name)}: {error.message}"
        error_place, suggestion = scalar_node.place_at(error.offset, error.length), error.suggestion
        character = None if "(U+" in message else typeset_character(scalar_node.text)
        if character is not None:
            message += f"; {quote(scalar_node.text.strip())} has {character}"
            is_all = error.length >= len(scalar_node.text.strip())
            suggestion = suggestion or (plain(scalar_node.text) if is_all else None)
        self.collector.error(error.code, message, error_place, suggestion=suggestion)


class Shape(ABC):
    """The shape of a value: the nodes that a name accepts."""

    @abstractmethod
    def read(self, node: Node, name: str, context: Context) -> Any:
        """The value, or MISSING after a report."""

    @abstractmethod
    def schema(self) -> dict[str, Any]:
        """The same as JSON Schema, draft 7."""

    @abstractmethod
    def words(self) -> str:
        """What is written, for the reference and for messages: `a mass, such as 400g`."""

    def chosen(self, node: Node) -> Shape:
        """The shape that reads a node, where there are several for one name."""
        return self

    def inner(self, name: str | int) -> Shape | None:
        """The shape below a name or an item's number; None if no value is accepted there."""
        return None

    def field_names(self) -> Collection[str]:
        """The names of fields, if it is a table of them."""
        return ()

    def vocabulary(self) -> Mapping[str, str]:
        """The words that its texts may have, each with what it means; empty if they are not
        listed.
        """
        return {}


@dataclass(frozen=True)
class Text(Shape):
    """A scalar that `parse` turns into a value; TextErrors become reports in their place."""

    parse: Callable[[str], Any]
    what: str
    pattern: str | None = None
    types: tuple[str, ...] = ("string", "number")
    choices: tuple[str | int, ...] = ()
    units: tuple[str, ...] = ()
    is_value: bool = False  # names of `let:` and arithmetic may stand for it
    has_values: bool = False  # names of `let:` may stand for words of it
    is_position: bool = False  # both, unless a mark has the same name
    meanings: Mapping[str, str] = field(default_factory=dict, compare=False)  # word → its meaning

    def vocabulary(self) -> Mapping[str, str]:
        """The words that its texts may have, each with what it means."""
        return self.meanings

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        try:
            if self.is_position:
                return named_values.position(node.text, node.document, self.parse)
            if self.has_values:
                return named_values.parse_with_names(node, self.parse)
            return self.parse(node.text)
        except TextError as error:
            if self.is_value:
                return self._computed(node, name, context, error)
            context.text_error(error, node, name)
            return MISSING

    def read_word(self, read_word_text: str, source_document: document.Document) -> Any:
        """The value of a word of a table. Raises TextError."""
        if self.is_position:
            return named_values.position(read_word_text, source_document, self.parse)
        return named_values.word_value(read_word_text, source_document, self.parse)

    def _computed(self, node: Scalar, name: str, context: Context, plain_error: TextError) -> Any:
        """The value of a node that is not a plain value: an expression, or a mistake to report."""
        try:
            literal = named_values.literal(node)
            if literal is not None and self.units == ("%",):
                literal = named_values.percent(literal)
        except TextError as error:
            context.text_error(error, node, name)
            return MISSING
        try:
            if literal is None:
                raise plain_error
            return self.parse(literal)
        except TextError as error:
            if literal is not None:
                error = TextError(
                    f"{quote(node.text.strip())} is {literal}: {error.message}",
                    length=max(1, len(node.text)),
                    code=error.code,
                )
            context.text_error(error, node, name)
            return MISSING

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        schema: dict[str, Any] = {"type": list(self.types)}
        if self.choices:
            schema["enum"] = list(self.choices)
        if self.pattern:
            pattern = self.pattern
            if self.is_value or self.is_position:
                pattern = f"^(?:{pattern.removeprefix('^').removesuffix('$')}|{EXPRESSION})$"
            schema |= {"pattern": pattern, "patternErrorMessage": f"Expected: {self.what}"}
        return schema

    def words(self) -> str:
        """In words."""
        return self.what


class NamedValues(Shape):
    """`{heavy: 400g, low: D2}`: values to which others may refer by name."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node; its document keeps the values."""
        if not isinstance(node, document.Mapping):
            return wrong_shape(self, node, name, context)
        named_amounts = named_values.named_amounts(node.document)
        for scalar, error in named_amounts.mistakes:
            context.text_error(error, scalar, name)
        return dict(named_amounts.names)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": "object", "additionalProperties": {"type": ["string", "number"]}}

    def words(self) -> str:
        """In words."""
        return "names with values, such as {heavy: 400g, low: D2}"


def choice(*choice_words: str) -> Text:
    """One of a few words."""

    def parse(written_text: str) -> str:
        if written_text in choice_words:
            return written_text
        message = f"{quote(written_text)} is not one of {', '.join(choice_words)}"
        raise TextError(
            message,
            length=max(1, len(written_text)),
            suggestion=nearest(written_text, choice_words),
            code="E206",
        )

    choices_text = " or ".join(f"`{word}`" for word in choice_words)
    # An editor reads `bits: 24` as a number.
    numbers = tuple(int(word) for word in choice_words if word.isdigit())
    types = ("string", "number") if numbers else ("string",)
    return Text(parse, choices_text, types=types, choices=(*choice_words, *numbers))


@dataclass(frozen=True)
class Reference(Shape):
    """The name of something; whether it exists is checked after everything is read.

    `sections` are those of a score whose names may stand here; `modules` are those of
    instruments.
    """

    what: str
    sections: tuple[str, ...] = ()

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        if not node.text.strip() or len(node.text) > 4 * MAX_NAME:
            context.error("E103", f"{context.label(name)}: {self.what} is expected", node.place)
            return MISSING
        return Name(node.text, node.place)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "number"]}

    def words(self) -> str:
        """In words."""
        return self.what


def lost_indentation(
    entries: Mapping[str, tuple[Scalar, Node]], is_lost: Callable[[str, str], bool]
) -> tuple[str, str] | None:
    """The first empty name, and the name after it, which was to be indented below it; None if there
    is none. `is_lost` returns whether the second name means nothing beside the first.
    """
    for (name_above, (name, child)), (entry_word, (key, _)) in pairwise(entries.items()):
        is_empty = isinstance(child, Scalar) and child.is_empty
        is_beside = key.place.column == name.place.column and key.place.line > name.place.line
        if is_empty and is_beside and is_lost(name_above, entry_word):
            return name_above, entry_word
    return None


def report_lost(context: Context, name_above: str, lost_word: str, lost_key: Scalar) -> None:
    """Report a name that is beside an empty one, instead of below it."""
    message = f"nothing is written below {quote(name_above)}, and {quote(lost_word)} is beside it"
    help_text = (
        f"put two more spaces before {quote(lost_word)} and the lines that belong to "
        f"{quote(name_above)}"
    )
    context.error("E101", message, lost_key.place, help=help_text)


def name_help(word: str) -> str | None:
    """Help for a name that is none, because of how its characters are written."""
    if (character := typeset_character(word)) is not None:
        return f"{quote(word)} has {character}"
    return "put a space after ':'" if ":" in word else None


def wrong_shape(
    expected_shape: Shape,
    wrong_node: Node,
    field_name: str,
    context: Context,
    help: str | None = None,
    suggestion: str | None = None,
) -> Any:
    """Report a node that is a mapping, list or text where another kind is expected."""
    if isinstance(wrong_node, document.Mapping):
        actual_text = "is a mapping"
    elif isinstance(wrong_node, Scalar):
        actual_text = "is empty" if wrong_node.is_empty else f"is {quote(wrong_node.text)}"
    else:
        actual_text = "is a list"
    message = f"{context.label(field_name)} {actual_text}; expected: {expected_shape.words()}"
    if isinstance(wrong_node, document.Sequence) and isinstance(expected_shape, Text | Reference):
        help = "a list is not read here: repeat the entry, once for each value"
    context.error("E106", message, wrong_node.place, help=help, suggestion=suggestion)
    return MISSING
