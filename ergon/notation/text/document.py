"""YAML text as nodes with places; every scalar stays the text that the composer wrote.

YAML guesses types (`1e-3` is a string, `1:30` is 90, `012` is 10), so nothing here is resolved:
each field parses its own text. Nodes are built from libyaml's events with an explicit stack, so
depth, size and aliases are bounded while reading, before anything big exists.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import accumulate, count
from operator import add
from pathlib import Path
from typing import Any

import yaml

from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.syntax import MAX_BYTES, MAX_LINES, explained, index_of_level, is_too_deep
from ergon.notation.text.values import Place

MAX_DEPTH = 64  # nested deeper than any score a person writes; keeps later recursion safe
TOO_DEEP = f"the nesting is deeper than {MAX_DEPTH} levels"
MAX_NODES = 2_000_000  # nodes with aliases expanded; about 1 GB at the worst

_NEAR_CHARACTERS = 4_096  # characters in which a row is counted each time
_STYLES = ("'", '"', "|", ">")
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(eq=False, slots=True)
class Node:
    """A piece of a document between two character indices."""

    document: Document = field(repr=False)
    start: int
    end: int

    @property
    def place(self) -> Place:
        """Where the node begins; its length ends with its first line."""
        document = self.document
        row_index, line_start, line_end = document.line_of(self.start)
        length = max(1, min(self.end, line_end) - self.start)
        return Place(
            document.file, document.first_row + row_index + 1, self.start - line_start + 1, length
        )


@dataclass(eq=False, slots=True)
class Scalar(Node):
    """A text; `style` is None for a plain one, or the character that began it (' " | >)."""

    text: str
    style: str | None

    @property
    def is_empty(self) -> bool:
        """Whether nothing is written after the colon."""
        return self.style is None and self.text in ("", "~", "null")

    def place_at(self, text_offset: int, text_length: int = 1) -> Place:
        """The place of `text_length` characters at `text_offset`, or the scalar's place."""
        if self.style == "|":
            return self._literal_place(text_offset, text_length)
        source_index = self._flow_index(text_offset)
        if source_index is None:
            return self.place
        room = max(1, self.document.line_end(source_index) - source_index)
        return self.document.place(source_index, max(1, min(text_length, room)))

    def _literal_place(self, text_offset: int, text_length: int) -> Place:
        """The place in a literal block: each line of its text is the end of a source line below the
        `|`.
        """
        node_table = self.document.table(self)
        if node_table.indent is None:
            node_table.indent = self._indent(node_table)
        if node_table.indent < 0:
            return self.place
        row_index = bisect_right(node_table.starts, text_offset) - 1
        text_column = text_offset - node_table.starts[row_index]
        room = len(node_table.row_text(self.text, row_index)) - text_column
        line = self.document.first_row + node_table.first_row + row_index + 1
        text_column += node_table.indent + 1
        return Place(self.document.file, line, text_column, max(1, min(text_length, room)))

    def _indent(self, node_table: Table) -> int:
        """The indentation of the block, the same for all its rows; -1 if text and source
        disagree.
        """
        for row_index in range(len(node_table.starts)):
            row_text = node_table.row_text(self.text, row_index)
            if row_text:  # an empty row may be indented less
                start, end = self.document.line_span(node_table.first_row + row_index)
                indent = end - start - len(row_text)
                is_same_text = indent >= 0 and self.document.text.startswith(
                    row_text, start + indent
                )
                return indent if is_same_text else -1
        return 0

    def _flow_index(self, text_offset: int) -> int | None:
        """Index in the source of a character of the text, found by walking both: folding turns a
        line break and its indentation into one space.
        """
        if self.style == ">":
            return None
        document_text = self.document.text
        source_index = self.start + (self.style is not None)
        for character in self.text[:text_offset]:
            if source_index >= self.end:
                return None
            if character == document_text[source_index]:
                source_index += 1
            elif character.isspace() and document_text[source_index].isspace():
                source_index = _skip_space(document_text, source_index, self.end)
            else:
                return None  # an escape, or a doubled quote
        if (
            text_offset < len(self.text)
            and source_index < self.end
            and document_text[source_index] != self.text[text_offset]
        ):
            source_index = _skip_space(document_text, source_index, self.end)
        return source_index


@dataclass(eq=False, slots=True)
class Line:
    """An item or entry in a line of its own, with the values that shapes have read from it.

    `node` is the item, or a mapping of the entry alone.
    """

    node: Node
    size: int
    values: dict[Any, Any] = field(default_factory=dict)


@dataclass(eq=False, slots=True)
class Sequence(Node):
    """Items in the order written.

    If items were composed line by line, `lines` holds their lines, and `bases` the indices at
    which these lines begin: the places of such an item count from there.
    """

    items: list[Node]
    lines: list[Line | None] = field(default_factory=list)
    bases: list[int] = field(default_factory=list)

    def span(self, number: int) -> tuple[int, int]:
        """Where an item begins and ends, as the places of the list count."""
        child, base = self.items[number], self.bases[number] if self.bases else 0
        return base + child.start, base + child.end


@dataclass(eq=False, slots=True)
class Mapping(Node):
    """Names and their values, in the order written; of a name written twice only the first counts.

    If entries were composed line by line, `lines` holds their lines, and `bases` the indices at
    which these lines begin: the places of such an entry count from there.
    """

    entries: dict[str, tuple[Scalar, Node]]
    lines: dict[str, Line] = field(default_factory=dict)
    bases: dict[str, int] = field(default_factory=dict)

    def get(self, name: str) -> Node | None:
        """The node under a name."""
        entry = self.entries.get(name)
        return entry[1] if entry else None


@dataclass(eq=False, slots=True)
class Table:
    """Rows of a literal block: the source line of the first row (from 0), and where each row begins
    in the block's text.
    """

    first_row: int
    starts: list[int]
    indent: int | None = None  # indentation of the block, computed at the first use

    def row_text(self, text: str, row: int) -> str:
        """One row, without its line break."""
        end = self.starts[row + 1] - 1 if row + 1 < len(self.starts) else len(text)
        return text[self.starts[row] : end]


@dataclass(eq=False, slots=True)
class Document:
    """The text of one file with its root node; turns character indices into places."""

    file: str
    text: str
    root: Node | None = None
    folder: Path = field(default_factory=Path)  # paths in the file are relative to it
    first_row: int = 0  # the first row of the text in its file
    size: int = 0  # how many nodes there are, aliases written out
    # The values that `let:` names, once read, and the node of `let:` if it is in another document.
    lets: Any = field(default=None, repr=False, compare=False)
    let: Node | None = field(default=None, repr=False, compare=False)
    # How many nodes the loops of mappings write out, by where these begin.
    loops: dict[int, int] = field(default_factory=dict, repr=False, compare=False)
    _starts: list[int] = field(default_factory=list, repr=False)
    _tables: dict[int, Table] = field(default_factory=dict, repr=False)

    def _line_starts(self) -> list[int]:
        if not self._starts:
            self._starts.extend(_line_starts(self.text))
        return self._starts

    def forget_lines(self) -> None:
        """Forget where lines begin, because the text has changed."""
        self._starts.clear()
        self._tables.clear()

    def row(self, index: int) -> int:
        """Line of a character, from 0."""
        return bisect_right(self._line_starts(), index) - 1

    def line_span(self, row_index: int) -> tuple[int, int]:
        """First index of a line and the index of its end, without the line break."""
        starts = self._line_starts()
        if row_index >= len(starts):
            return len(self.text), len(self.text)
        line_end = starts[row_index + 1] if row_index + 1 < len(starts) else len(self.text)
        while line_end > starts[row_index] and self.text[line_end - 1] in "\r\n":
            line_end -= 1
        return starts[row_index], line_end

    def line_of(self, character_index: int) -> tuple[int, int, int]:
        """The row of a character, from 0, with the first index and the end of its line."""
        if self._starts or character_index > _NEAR_CHARACTERS or "\r" in self.text:
            row = self.row(character_index)
            return row, *self.line_span(row)
        # Near the beginning of a text that may be long, lines are not looked for to its end.
        line_end = self.text.find("\n", character_index)
        line_start = self.text.rfind("\n", 0, character_index) + 1
        return (
            self.text.count("\n", 0, character_index),
            line_start,
            len(self.text) if line_end < 0 else line_end,
        )

    def line_end(self, index: int) -> int:
        """Index where the line of a character ends."""
        return self.line_span(self.row(index))[1]

    def line(self, number: int) -> str:
        """The text of a line, numbered from 1."""
        start, end = self.line_span(number - 1)
        return self.text[start:end]

    def place(self, index: int, length: int = 1) -> Place:
        """The place of a character."""
        row = self.row(index)
        line = self.first_row + row + 1
        return Place(self.file, line, index - self._line_starts()[row] + 1, length)

    def table(self, scalar: Scalar) -> Table:
        """The rows of a literal block, found once: a table of 100,000 rows is read row by row."""
        known_table = self._tables.get(scalar.start)
        if known_table is None:
            known_table = Table(self.row(scalar.start) + 1, _line_starts(scalar.text))
            self._tables[scalar.start] = known_table
        return known_table


class _Refused(Exception):
    """Ends the reading of a file: code, message, index, length."""

    def __init__(
        self, code: str, message: str, refused_index: int, refused_length: int = 1
    ) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.index = refused_index
        self.length = refused_length


def compose(source_text: str, file_name: str, collector: Collector, first_row: int = 0) -> Document:
    """Nodes of a YAML text; `root` is None when nothing is written or the text is refused."""
    document = Document(file_name, source_text, first_row=first_row)
    if len(source_text) > MAX_BYTES:
        message = f"the file has more than {MAX_BYTES // 2**20} MB; write a long gesture as a take"
        collector.error("E105", message, Place(file_name, 1, 1))
        return document
    if max(source_text.count("\n"), source_text.count("\r")) > MAX_LINES:
        message = f"the file has more than {MAX_LINES:,} lines; write a long gesture as a take"
        collector.error("E105", message, Place(file_name, 1, 1))
        return document
    try:
        document.root = _Composer(document, collector).run()
    except _Refused as refused:
        place = document.place(refused.index, refused.length)
        collector.error(refused.code, refused.message, place)
    except (yaml.YAMLError, UnicodeError, RecursionError) as error:
        index, message = explained(source_text, error)
        collector.error("E100", message, document.place(min(index, len(source_text))))
    return document


@dataclass(slots=True)
class _OpenCollection:
    """A mapping or sequence whose end has not come yet."""

    event: yaml.CollectionStartEvent
    children: list[Node]
    size: int = 1
    height: int = 1

    def add(self, node: Node, size: int, height: int) -> None:
        self.children.append(node)
        self.size += size
        self.height = max(self.height, height + 1)


class _Composer:
    """Builds nodes from events; refuses what a score has no use for."""

    def __init__(self, document: Document, collector: Collector) -> None:
        self.document = document
        self.collector = collector
        self.anchors: dict[str, tuple[Node, int, int]] = {}
        self.stack: list[_OpenCollection] = []
        self.root: Node | None = None
        self.n_nodes = 0

    def run(self) -> Node | None:
        try:
            return self.build_root()
        except yaml.YAMLError as error:
            if not is_too_deep(error):
                raise
            place = (_event_end(self.stack[-1].event), len(self.stack)) if self.stack else (0, 0)
            index = index_of_level(self.document.text, error, place, MAX_DEPTH + 1)
            raise _Refused("E105", TOO_DEEP, index) from None

    def build_root(self) -> Node | None:
        n_documents = 0
        for yaml_event in yaml.parse(self.document.text, _LOADER):
            if isinstance(yaml_event, yaml.ScalarEvent):
                self.scalar(yaml_event)
            elif isinstance(yaml_event, (yaml.MappingStartEvent, yaml.SequenceStartEvent)):
                self.open(yaml_event)
            elif isinstance(yaml_event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
                self.close(_event_end(yaml_event))
            elif isinstance(yaml_event, yaml.AliasEvent):
                self.alias(yaml_event)
            elif isinstance(yaml_event, yaml.DocumentStartEvent):
                n_documents += 1
                if n_documents > 1:
                    message = "a second document begins here ('---'); a file holds one score"
                    raise _Refused("E104", message, _event_start(yaml_event), 3)
        self.document.size = self.n_nodes
        return self.root

    def scalar(self, event: yaml.ScalarEvent) -> None:
        scalar_start = _event_start(event)
        self.refuse_tag(event)
        self.count_nodes(1, scalar_start)
        style = event.style if event.style in _STYLES else None  # libyaml calls plain ''
        node = Scalar(self.document, scalar_start, _event_end(event), event.value, style)
        self.add(node, event.anchor, 1, 1)

    def open(self, event: yaml.CollectionStartEvent) -> None:
        self.refuse_tag(event)
        self.count_nodes(1, _event_start(event))
        if len(self.stack) >= MAX_DEPTH:
            raise _Refused("E105", TOO_DEEP, _event_start(event))
        self.stack.append(_OpenCollection(event, []))

    def close(self, end: int) -> None:
        open_frame = self.stack.pop()
        frame_start = _event_start(open_frame.event)
        closed_node: Node
        if isinstance(open_frame.event, yaml.SequenceStartEvent):
            closed_node = Sequence(self.document, frame_start, end, open_frame.children)
        else:
            closed_node = Mapping(
                self.document, frame_start, end, self.entries(open_frame.children)
            )
        self.add(closed_node, open_frame.event.anchor, open_frame.size, open_frame.height)

    def alias(self, event: yaml.AliasEvent) -> None:
        alias_start, alias_name = _event_start(event), event.anchor or ""
        alias_length = len(alias_name) + 1
        if any(frame.event.anchor == alias_name for frame in self.stack):
            message = f"alias {quote('*' + alias_name)} refers to the value that contains it"
            raise _Refused("E104", message, alias_start, alias_length)
        if alias_name not in self.anchors:
            message = (
                f"no anchor '&{alias_name[:40]}' is defined above; write "
                "a word that begins with '*' in quotes"
            )
            raise _Refused("E104", message, alias_start, alias_length)
        anchored_node, anchor_size, anchor_height = self.anchors[alias_name]
        if len(self.stack) + anchor_height > MAX_DEPTH:
            raise _Refused(
                "E105",
                f"an alias makes the nesting deeper than {MAX_DEPTH} levels",
                alias_start,
                alias_length,
            )
        self.count_nodes(anchor_size, alias_start)
        self.add(anchored_node, None, anchor_size, anchor_height)

    def add(self, node: Node, anchor: str | None, size: int, height: int) -> None:
        if anchor:
            self.anchors[anchor] = (node, size, height)
        if self.stack:
            self.stack[-1].add(node, size, height)
        else:
            self.root = node

    def count_nodes(self, size: int, index: int) -> None:
        self.n_nodes += size
        if self.n_nodes > MAX_NODES:
            message = f"the file has more than {MAX_NODES:,} entries, with aliases expanded"
            raise _Refused("E105", message, index)

    def entries(self, children: list[Node]) -> dict[str, tuple[Scalar, Node]]:
        named_entries: dict[str, tuple[Scalar, Node]] = {}
        for key_node, value_node in zip(children[::2], children[1::2], strict=True):
            if not isinstance(key_node, Scalar):
                self.collector.error("E106", "the text before ':' must be a name", key_node.place)
            elif key_node.text == "<<" and key_node.style is None:
                message = "merge keys ('<<') are not part of the score language; use 'like:'"
                self.collector.error("E104", message, key_node.place)
            elif key_node.text in named_entries:
                first_place = named_entries[key_node.text][0].place
                message = f"{quote(key_node.text)} is already defined on line {first_place.line}"
                self.collector.error("E102", message, key_node.place)
            else:
                named_entries[key_node.text] = (key_node, value_node)
        return named_entries

    def refuse_tag(self, event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
        if event.tag is not None and event.tag != "!":
            message = f"tag {quote(event.tag)} is not allowed in a score; remove it"
            raise _Refused("E104", message, _event_start(event))


def _event_start(event: yaml.Event) -> int:
    return event.start_mark.index if event.start_mark else 0


def _event_end(event: yaml.Event) -> int:
    return event.end_mark.index if event.end_mark else 0


def _line_starts(source_text: str) -> list[int]:
    """Indices where lines begin: after \\n, \\r\\n or a lone \\r, as editors count."""
    if "\r" not in source_text:
        line_ends = accumulate(map(len, source_text.split("\n")[:-1]))
        return [0, *map(add, line_ends, count(1))]
    starts = [0]
    line_index = 0
    for text_line in source_text.split("\n"):
        if "\r" in text_line[:-1]:
            starts.extend(
                line_index + offset + 1 for offset, c in enumerate(text_line[:-1]) if c == "\r"
            )
        line_index += len(text_line) + 1
        starts.append(line_index)
    starts.pop()
    return starts


def _skip_space(source: str, index: int, end: int) -> int:
    while index < end and source[index].isspace():
        index += 1
    return index


def n_lines(text: str) -> int:
    """The number of line ends in a text, as a document counts lines."""
    n_lines = text.count("\n")
    return n_lines if "\r" not in text else n_lines + text.count("\r") - text.count("\r\n")
