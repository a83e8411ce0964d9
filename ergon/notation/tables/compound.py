"""Shapes that are made of others: lists, pairs, alternatives, and names with values."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import loops
from ergon.notation.tables.shapes import (
    MAX_NAME,
    MISSING,
    NAME,
    NAME_PATTERN,
    Context,
    Shape,
    lost_indentation,
    name_help,
    report_lost,
    wrong_shape,
)
from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.errors import quote
from ergon.notation.text.memory import Memory
from ergon.notation.text.window import is_plain


@dataclass(frozen=True)
class ListOf(Shape):
    """Items of one shape; `single` lets a lone item stand without brackets."""

    item: Shape
    count_min: int = 0
    count_max: int = 1_000_000
    single: bool = False

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Sequence):
            item_nodes = node.items
        elif self.single:
            item_nodes = [node]
        elif isinstance(node, Scalar) and node.is_empty:
            item_nodes = []
        else:
            words = node.text.split() if isinstance(node, Scalar) else []
            list_text = (
                f"[{', '.join(words)}]" if self.count_min <= len(words) <= self.count_max else None
            )
            return wrong_shape(self, node, name, context, suggestion=list_text)
        if not self.count_min <= len(item_nodes) <= self.count_max:
            count_text = (
                f"{self.count_min}"
                if self.count_min == self.count_max
                else f"at least {self.count_min}"
            )
            if len(item_nodes) > self.count_max > self.count_min:
                count_text = f"at most {self.count_max:,}"
            message = (
                f"{context.label(name)}: the number of items is {len(item_nodes)}, but must be "
                f"{count_text}"
            )
            context.error("E106", message, node.place)
            return MISSING
        if isinstance(node, document.Sequence) and node.lines:
            items = self._read_by_lines(node, name, context)
        else:
            items = [self.item.read(item, name, context) for item in item_nodes]
        values = tuple([value for value in items if value is not MISSING])
        return values if len(values) >= self.count_min else MISSING  # a broken pair is no pair

    def _read_by_lines(
        self, list_node: document.Sequence, field_name: str, context: Context
    ) -> list[Any]:
        """The values of items in lines of their own. Each item is read once; it is read again only
        if the reading made a report.
        """
        let_node = list_node.document.let
        line_key = id(self.item), field_name, context.owner, let_node
        values = [None if line is None else line.values.get(line_key) for line in list_node.lines]
        for index in [number for number, value in enumerate(values) if value is None]:
            n_reports, item_node, item_line = (
                context.collector.n_reports,
                list_node.items[index],
                list_node.lines[index],
            )
            item_node.document.let, item_node.document.lets = let_node, list_node.document.lets
            values[index] = self.item.read(item_node, field_name, context)
            if item_line is not None and context.collector.n_reports == n_reports:
                item_line.values[line_key] = values[index]
        return values

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        array: dict[str, Any] = {"type": ["array"], "items": self.item.schema()}
        if self.count_min:
            array["minItems"] = self.count_min
        return schema_of_types(array, self.item.schema()) if self.single else array

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
        schemas = [shape.schema() for shape in (self.scalar, self.mapping, self.sequence) if shape]
        return schema_of_types(*schemas)

    def words(self) -> str:
        """In words."""
        shapes = (self.scalar, self.mapping, self.sequence)
        return ", or ".join(shape.words() for shape in shapes if shape)


class _EntryMemory:
    """The values of a section's entries, kept while their texts stay the same; they keep the places
    that they had then.
    """

    def __init__(self, section_node: document.Mapping, noun: str, memory: Memory | None) -> None:
        """Take the section's node. Only a loose memory keeps entries."""
        self._node, self._name = section_node, f"entries {noun} {section_node.document.file}"
        is_kept = memory is not None and memory.is_loose and is_plain(section_node.document.text)
        self._memory = memory if is_kept else None
        self._old_entries: Mapping[str, tuple[str, Any]] = {}
        if self._memory is not None:
            self._old_entries = self._memory.held_for(self._name, section_node.document.let) or {}
        self._new_entries: dict[str, tuple[str, Any]] = {}

    def _entry_text(self, word: str) -> str:
        key, child = self._node.entries[word]
        return self._node.document.text[key.start : child.end]

    def old_value(self, word: str) -> Any:
        """The value of an entry; None if its text has changed."""
        if (old_entry := self._old_entries.get(word)) is None or old_entry[0] != self._entry_text(
            word
        ):
            return None
        self._new_entries[word] = old_entry
        return old_entry[1]

    def keep(self, word: str, entry_value: Any) -> None:
        """Keep the value of an entry, whose reading made no report."""
        if self._memory is not None:
            self._new_entries[word] = self._entry_text(word), entry_value

    def store(self) -> None:
        """Hold what was kept for the next reading."""
        if self._memory is not None:
            self._memory.hold(self._name, (self._node.document.let,), self._new_entries)


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
        values_by_name: dict[str, Any] = {}
        # The value of an entry in a line of its own is read once, unless the reading made a report.
        let_node = node.document.let
        line_key = id(self.item), context.name, let_node
        remembered_entries = _EntryMemory(node, self.noun, context.memory)
        fields = self.item.field_names()
        lost_indent = lost_indentation(node.entries, lambda _, word: word in fields)
        written_node = loops.written_out(node, context.collector) if self.has_loops else node
        for entry_word, named_entry in written_node.entries.items():
            key_node, child_node = named_entry
            if lost_indent is not None and entry_word == lost_indent[0]:
                report_lost(context, *lost_indent, node.entries[lost_indent[1]][0])
                values_by_name[entry_word] = MISSING
                break
            is_written = node.entries.get(entry_word) is named_entry  # no loop makes it
            known_line = node.lines.get(entry_word) if is_written else None
            if known_line is not None and line_key in known_line.values:
                values_by_name[entry_word] = known_line.values[line_key]
                continue
            if (
                is_written
                and known_line is None
                and (remembered_value := remembered_entries.old_value(entry_word)) is not None
            ):
                values_by_name[entry_word] = remembered_value
                continue
            if not NAME.fullmatch(entry_word) or len(entry_word) > MAX_NAME:
                message = f"{quote(entry_word)} is not a name for a {self.noun}: "
                message += "a name has letters, digits, '-' and '_', and begins with a letter"
                context.error("E110", message, key_node.place, help=name_help(entry_word))
                continue
            inner_context = context.inside(self.noun, entry_word, key_node.place)
            if known_line is not None:
                child_node.document.let, child_node.document.lets = let_node, node.document.lets
            n_reports = context.collector.n_reports
            entry_value = values_by_name[entry_word] = self.item.read(child_node, "", inner_context)
            if context.collector.n_reports > n_reports:
                continue
            if known_line is not None:
                known_line.values[line_key] = entry_value
            elif is_written:
                remembered_entries.keep(entry_word, entry_value)
        remembered_entries.store()
        return values_by_name

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
        """Every name has the same shape, also below a loop."""
        return self if self.has_loops and loops.is_loop(str(name)) else self.item


def schema_of_types(*schemas: dict[str, Any]) -> dict[str, Any]:
    """Merge schemas of different types: keywords of one type do not constrain another, so a union
    needs no `anyOf`.
    """
    union: dict[str, Any] = {}
    types: list[str] = []
    for schema in schemas:
        types += [type_name for type_name in schema.get("type", []) if type_name not in types]
        union |= schema
    if types:
        union["type"] = types
    return union
