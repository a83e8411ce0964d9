"""Shapes: what may stand after a name, such as texts, lists, names and choices among them.

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

from ergon.notation.tables import expressions, loops
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.memory import Memory
from ergon.notation.text.spelling import nearest
from ergon.notation.text.typeset import plain, typeset_character
from ergon.notation.text.values import Place
from ergon.notation.text.window import is_plain

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

    def __new__(cls, word: str, place: Place, written: str | None = None) -> Name:
        """A string that remembers where it was written, and how if that differs."""
        name = super().__new__(cls, word)
        name.place = place
        name.written = str(word) if written is None else written
        return name


@dataclass(frozen=True, slots=True)
class Context:
    """The context of a reading: the collector of reports, and the owner of the fields (`key
    'k1'`).
    """

    collector: Collector
    owner: str = ""
    name: str = ""
    place: Place | None = None
    memory: Memory | None = None  # of the sections of a score
    tunings: Mapping[str, Tuning] = field(default_factory=dict)  # of instruments, by name

    def label(self, field_name: str) -> str:
        """`M of key 'k1'`."""
        if not field_name:
            return self.owner or "the score"
        return f"{field_name} of {self.owner}" if self.owner else f"'{field_name}'"

    def inside(self, noun: str, name: str, place: Place) -> Context:
        """The context of a named thing; a module is called by its instrument's name too."""
        inner_name = f"{self.name}.{name}" if noun == "module" and self.name else name
        owner = f"{noun} {quote(inner_name)}"
        return Context(self.collector, owner, name, place, tunings=self.tunings)

    def error(self, code: str, message: str, place: Place, **more: Any) -> None:
        """Report."""
        self.collector.error(code, message, place, **more)

    def text_error(self, error: TextError, node: Scalar, field_name: str) -> None:
        """Report a mistake inside a scalar at its characters; an empty name means the owner."""
        message = f"{self.label(field_name)}: {error.message}"
        place, suggestion = node.place_at(error.offset, error.length), error.suggestion
        character = None if "(U+" in message else typeset_character(node.text)
        if character is not None:
            message += f"; {quote(node.text.strip())} has {character}"
            is_all = error.length >= len(node.text.strip())
            suggestion = suggestion or (plain(node.text) if is_all else None)
        self.collector.error(error.code, message, place, suggestion=suggestion)


class Shape(ABC):
    """What may stand after a name."""

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
        """The shape below a name or an item's number; None where nothing may stand."""
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
    meanings: Mapping[str, str] = field(default_factory=dict, compare=False)  # of its words

    def vocabulary(self) -> Mapping[str, str]:
        """The words that its texts may have, each with what it means."""
        return self.meanings

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        try:
            if self.is_position:
                return expressions.position(node.text, node.document, self.parse)
            if self.has_values:
                return expressions.parse_with_names(node, self.parse)
            return self.parse(node.text)
        except TextError as error:
            if self.is_value:
                return self._computed(node, name, context, error)
            context.text_error(error, node, name)
            return MISSING

    def read_word(self, word: str, source: document.Document) -> Any:
        """The value of a word of a table. Raises TextError."""
        if self.is_position:
            return expressions.position(word, source, self.parse)
        return expressions.word_value(word, source, self.parse)

    def _computed(self, node: Scalar, name: str, context: Context, plain: TextError) -> Any:
        """The value of a node that is not a plain value: an expression, or a mistake to report."""
        try:
            literal = expressions.literal(node)
            if literal is not None and self.units == ("%",):
                literal = expressions.percent(literal)
        except TextError as error:
            context.text_error(error, node, name)
            return MISSING
        try:
            if literal is None:
                raise plain
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
        amounts_by_name = expressions.named_amounts(node.document)
        for scalar, error in amounts_by_name.wrong:
            context.text_error(error, scalar, name)
        return dict(amounts_by_name.names)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": "object", "additionalProperties": {"type": ["string", "number"]}}

    def words(self) -> str:
        """In words."""
        return "names with values, such as {heavy: 400g, low: D2}"


def choice(*words: str) -> Text:
    """One of a few words."""

    def parse(text: str) -> str:
        if text in words:
            return text
        message = f"{quote(text)} is not one of {', '.join(words)}"
        raise TextError(
            message, length=max(1, len(text)), suggestion=nearest(text, words), code="E206"
        )

    shown = " or ".join(f"`{word}`" for word in words)
    # An editor reads `bits: 24` as a number.
    numbers = tuple(int(word) for word in words if word.isdigit())
    types = ("string", "number") if numbers else ("string",)
    return Text(parse, shown, types=types, choices=(*words, *numbers))


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


@dataclass(frozen=True)
class ListOf(Shape):
    """Items of one shape; `single` lets a lone item stand without brackets."""

    item: Shape
    least: int = 0
    count_max: int = 1_000_000
    single: bool = False

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Sequence):
            items = node.items
        elif self.single:
            items = [node]
        elif isinstance(node, Scalar) and node.is_empty:
            items = []
        else:
            words = node.text.split() if isinstance(node, Scalar) else []
            listed = f"[{', '.join(words)}]" if self.least <= len(words) <= self.count_max else None
            return wrong_shape(self, node, name, context, suggestion=listed)
        if not self.least <= len(items) <= self.count_max:
            count_text = (
                f"{self.least}" if self.least == self.count_max else f"at least {self.least}"
            )
            if len(items) > self.count_max > self.least:
                count_text = f"at most {self.count_max:,}"
            message = (
                f"{context.label(name)}: the number of items is {len(items)}, but must be "
                f"{count_text}"
            )
            context.error("E106", message, node.place)
            return MISSING
        if isinstance(node, document.Sequence) and node.lines:
            items_read = self._by_lines(node, name, context)
        else:
            items_read = [self.item.read(item, name, context) for item in items]
        values = tuple([value for value in items_read if value is not MISSING])
        return values if len(values) >= self.least else MISSING  # a broken pair is no pair

    def _by_lines(self, node: document.Sequence, name: str, context: Context) -> list[Any]:
        """The values of items in lines of their own. Each item is read once; it is read again only
        if the reading made a report.
        """
        let = node.document.let
        key = id(self.item), name, context.owner, let
        values = [None if line is None else line.values.get(key) for line in node.lines]
        for number in [number for number, value in enumerate(values) if value is None]:
            n_reported, item, line = (
                context.collector.n_reports,
                node.items[number],
                node.lines[number],
            )
            item.document.let, item.document.lets = let, node.document.lets
            values[number] = self.item.read(item, name, context)
            if line is not None and context.collector.n_reports == n_reported:
                line.values[key] = values[number]
        return values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        array: dict[str, Any] = {"type": ["array"], "items": self.item.schema()}
        if self.least:
            array["minItems"] = self.least
        return merged(array, self.item.schema()) if self.single else array

    def words(self) -> str:
        """In words."""
        return f"a list, each {self.item.words()}"

    def chosen(self, node: Node) -> Shape:
        """A lone item is read by the item's shape."""
        is_lone = self.single and not isinstance(node, document.Sequence)
        return self.item.chosen(node) if is_lone else self

    def inner(self, name: str | int) -> Shape | None:
        """Items have one shape."""
        return self.item

    def field_names(self) -> Collection[str]:
        """The names of fields of a lone item."""
        return self.item.field_names() if self.single else ()


@dataclass(frozen=True)
class Pair(Shape):
    """Two items, each of its own shape."""

    first: Shape
    second: Shape

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, document.Sequence) or len(node.items) != 2:
            return wrong_shape(self, node, name, context)
        shapes = zip((self.first, self.second), node.items, strict=True)
        values = tuple(shape.read(item, name, context) for shape, item in shapes)
        return MISSING if MISSING in values else values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        items = [self.first.schema(), self.second.schema()]
        return {"type": ["array"], "items": items, "minItems": 2, "maxItems": 2}

    def words(self) -> str:
        """In words."""
        return f"[{self.first.words()}; {self.second.words()}]"

    def inner(self, name: str | int) -> Shape | None:
        """The shape of the first or of the second item."""
        return self.second if name == 1 else self.first


@dataclass(frozen=True)
class Either(Shape):
    """One shape for a text, one for a mapping, one for a list."""

    scalar: Shape | None = None
    mapping: Shape | None = None
    sequence: Shape | None = None

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        shape = self._shape_for(node)
        if shape is None:
            return wrong_shape(self, node, name, context)
        return shape.read(node, name, context)

    def _shape_for(self, node: Node) -> Shape | None:
        if isinstance(node, document.Mapping):
            return self.mapping
        return self.sequence if isinstance(node, document.Sequence) else self.scalar

    def chosen(self, node: Node) -> Shape:
        """The shape of texts, of mappings or of lists."""
        shape = self._shape_for(node)
        return self if shape is None else shape.chosen(node)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        schemas = [s.schema() for s in (self.scalar, self.mapping, self.sequence) if s]
        return merged(*schemas)

    def words(self) -> str:
        """In words."""
        shapes = (self.scalar, self.mapping, self.sequence)
        return ", or ".join(shape.words() for shape in shapes if shape)


class _Entries:
    """The values of a section's entries, kept while their texts stay the same; they keep the places
    that they had then.
    """

    def __init__(self, node: document.Mapping, noun: str, memory: Memory | None) -> None:
        """Take the section's node. Only a loose memory keeps entries."""
        self._node, self._name = node, f"entries {noun} {node.document.file}"
        is_kept = memory is not None and memory.is_loose and is_plain(node.document.text)
        self._memory = memory if is_kept else None
        self._before: Mapping[str, tuple[str, Any]] = {}
        if self._memory is not None:
            self._before = self._memory.held_for(self._name, node.document.let) or {}
        self._now: dict[str, tuple[str, Any]] = {}

    def _text(self, word: str) -> str:
        key, child = self._node.entries[word]
        return self._node.document.text[key.start : child.end]

    def known(self, word: str) -> Any:
        """The value of an entry; None if its text has changed."""
        if (entry_before := self._before.get(word)) is None or entry_before[0] != self._text(word):
            return None
        self._now[word] = entry_before
        return entry_before[1]

    def keep(self, word: str, value: Any) -> None:
        """Keep the value of an entry, whose reading made no report."""
        if self._memory is not None:
            self._now[word] = self._text(word), value

    def hold(self) -> None:
        """Hold what was kept for the next reading."""
        if self._memory is not None:
            self._memory.hold(self._name, (self._node.document.let,), self._now)


@dataclass(frozen=True)
class NamesOf(Shape):
    """Free names, each with the same shape; a broken one stays in the result as MISSING.

    If `has_loops`, loops and conditions may make them.
    """

    item: Shape
    noun: str
    doc: str = ""
    has_loops: bool = False

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, Scalar) and node.is_empty:
            return {}
        if not isinstance(node, document.Mapping):
            return wrong_shape(self, node, name, context)
        result: dict[str, Any] = {}
        # The value of an entry in a line of its own is read once, unless the reading made a report.
        let = node.document.let
        condition = id(self.item), context.name, let
        entries = _Entries(node, self.noun, context.memory)
        fields = self.item.field_names()
        lost = lost_indentation(node.entries, lambda _, word: word in fields)
        all_names = loops.written_out(node, context.collector) if self.has_loops else node
        for word, entry in all_names.entries.items():
            key, child = entry
            if lost is not None and word == lost[0]:
                report_lost(context, *lost, node.entries[lost[1]][0])
                result[word] = MISSING
                break
            is_written = node.entries.get(word) is entry  # no loop makes it
            line = node.lines.get(word) if is_written else None
            if line is not None and condition in line.values:
                result[word] = line.values[condition]
                continue
            if is_written and line is None and (entry_before := entries.known(word)) is not None:
                result[word] = entry_before
                continue
            if not NAME.fullmatch(word) or len(word) > MAX_NAME:
                message = f"{quote(word)} is not a name for a {self.noun}: "
                message += "a name has letters, digits, '-' and '_', and begins with a letter"
                context.error("E110", message, key.place, help=name_help(word))
                continue
            inner_context = context.inside(self.noun, word, key.place)
            if line is not None:
                child.document.let, child.document.lets = let, node.document.lets
            n_reported = context.collector.n_reports
            value = result[word] = self.item.read(child, "", inner_context)
            if context.collector.n_reports > n_reported:
                continue
            if line is not None:
                line.values[condition] = value
            elif is_written:
                entries.keep(word, value)
        entries.hold()
        return result

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        schema: dict[str, Any] = {
            "type": ["object", "null"],
            "propertyNames": {"pattern": NAME_PATTERN},
            "additionalProperties": self.item.schema(),
        }
        if self.has_loops:
            schema["propertyNames"] = {"pattern": f"{NAME_PATTERN}|{loops.PATTERN}"}
            schema["patternProperties"] = {loops.PATTERN: {"type": "object"}}
        return schema

    def words(self) -> str:
        """In words."""
        return f"names, each {self.item.words()}"

    def inner(self, name: str | int) -> Shape | None:
        """Every name has the same shape; below a loop stand names as beside it."""
        return self if self.has_loops and loops.is_loop(str(name)) else self.item


def merged(*schemas: dict[str, Any]) -> dict[str, Any]:
    """Merge schemas of different types: keywords of one type do not constrain another, so a union
    needs no `anyOf`.
    """
    result: dict[str, Any] = {}
    types: list[str] = []
    for schema in schemas:
        types += [t for t in schema.get("type", []) if t not in types]
        result |= schema
    if types:
        result["type"] = types
    return result


def lost_indentation(
    entries: Mapping[str, tuple[Scalar, Node]], is_lost: Callable[[str, str], bool]
) -> tuple[str, str] | None:
    """The first empty name, and the name after it, which was to be indented below it; None if there
    is none. `is_lost` returns whether the second name means nothing beside the first.
    """
    for (name_above, (name, child)), (word, (key, _)) in pairwise(entries.items()):
        is_empty = isinstance(child, Scalar) and child.is_empty
        is_beside = key.place.column == name.place.column and key.place.line > name.place.line
        if is_empty and is_beside and is_lost(name_above, word):
            return name_above, word
    return None


def report_lost(context: Context, name_above: str, word: str, key: Scalar) -> None:
    """Report a name that is beside an empty one, instead of below it."""
    message = f"nothing is written below {quote(name_above)}, and {quote(word)} is beside it"
    help = (
        f"put two more spaces before {quote(word)} and the lines that belong to {quote(name_above)}"
    )
    context.error("E101", message, key.place, help=help)


def name_help(word: str) -> str | None:
    """Help for a name that is none, because of how its characters are written."""
    if (character := typeset_character(word)) is not None:
        return f"{quote(word)} has {character}"
    return "put a space after ':'" if ":" in word else None


def wrong_shape(
    shape: Shape,
    node: Node,
    name: str,
    context: Context,
    help: str | None = None,
    suggestion: str | None = None,
) -> Any:
    """Report a mapping, list or text that stands where another is expected."""
    if isinstance(node, document.Mapping):
        actual = "is a mapping"
    elif isinstance(node, Scalar):
        actual = "is empty" if node.is_empty else f"is {quote(node.text)}"
    else:
        actual = "is a list"
    message = f"{context.label(name)} {actual}; expected: {shape.words()}"
    if isinstance(node, document.Sequence) and isinstance(shape, Text | Reference):
        help = "a list is not read here: repeat the entry, once for each value"
    context.error("E106", message, node.place, help=help, suggestion=suggestion)
    return MISSING
