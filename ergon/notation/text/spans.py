"""The spans of all nodes of a YAML text, for edits.

Unlike the nodes of a document, aliases are spans of their own, collections say whether they are
written in flow style, and nothing ends later than its last character.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, NamedTuple

import yaml

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_BLANK = re.compile(r"(?:\s|(?:(?<=\s)|\A)#[^\r\n]*)*")
_ANCHOR = re.compile(r"&[^\s,\[\]{}]+\s*")
_HEADER = re.compile(r"(?:&\S+\s+)?[|>][-+0-9]*")
_END_OF_LINE = re.compile(r"[\r\n]|\Z")

Kind = Literal["scalar", "alias", "mapping", "sequence"]


class Splice(NamedTuple):
    """Characters from `start` to `end` become `text`."""

    start: int
    end: int
    text: str


@dataclass(slots=True)
class Span:
    """A node from its first character (or that of its anchor) to its last; `keys` are the keys of a
    mapping.
    """

    kind: Kind
    start: int
    end: int = 0
    is_flow: bool = False
    style: str | None = None
    value: str = ""
    keys: list[Span] = field(default_factory=list)
    items: list[Span] = field(default_factory=list)

    @property
    def is_empty(self) -> bool:
        """Nothing is written, or `~`, which says so."""
        return self.kind == "scalar" and self.style is None and self.value in ("", "~", "null")

    @property
    def is_block(self) -> bool:
        """A text below `|` or `>`."""
        return self.style in ("|", ">")

    def index(self, child_name: str | int) -> int | None:
        """The number of a child under a name or at an index; None where there is none."""
        if self.kind == "mapping":
            indices = (i for i, key in enumerate(self.keys) if key.value == child_name)
            return next(indices, None)
        if (
            self.kind == "sequence"
            and isinstance(child_name, int)
            and 0 <= child_name < len(self.items)
        ):
            return child_name
        return None


@dataclass(slots=True)
class Layout:
    """A text, its root span, its line break and its indentation step."""

    text: str
    root: Span | None
    newline: str
    indent_step: int

    def line_start(self, character_index: int) -> int:
        """Where the line of a character begins; a break belongs to the line that it ends."""
        if self.text.startswith("\r\n", character_index - 1) and character_index:
            character_index -= 1
        return (
            max(
                self.text.rfind("\n", 0, character_index), self.text.rfind("\r", 0, character_index)
            )
            + 1
        )

    def line_end(self, index: int) -> int:
        """Where the line of a character ends, its break not counted."""
        match = _END_OF_LINE.search(self.text, index)
        return match.start() if match else len(self.text)

    def next_line(self, index: int) -> int:
        """Where the line after that of a character begins."""
        end = self.line_end(index)
        return end + (2 if self.text.startswith("\r\n", end) else 1 if end < len(self.text) else 0)

    def column(self, index: int) -> int:
        """How many characters of its line come before."""
        return index - self.line_start(index)

    def begins_line(self, index: int) -> bool:
        """Whether only spaces come before in its line."""
        return not self.text[self.line_start(index) : index].strip()

    def next_token(self, index: int) -> int:
        """The next character from `index` on that is neither space nor comment."""
        match = _BLANK.match(self.text, index)
        return match.end() if match else index

    def header_end(self, span: Span) -> int:
        """Where the `|` of a block ends, its indicators counted."""
        match = _HEADER.match(self.text, span.start)
        return match.end() if match else span.start + 1

    def child_start(self, parent_span: Span, child_index: int) -> int:
        """Where a child begins: its name, or its dash in a block sequence."""
        if parent_span.kind == "mapping":
            return parent_span.keys[child_index].start
        if parent_span.is_flow:
            return parent_span.items[child_index].start
        if child_index:
            return self.next_token(parent_span.items[child_index - 1].end)
        anchor = _ANCHOR.match(self.text, parent_span.start)
        return self.next_token(anchor.end() if anchor else parent_span.start)

    def full_lines(self, start_index: int, end_index: int) -> tuple[int, int]:
        """The range of whole lines from the line of one character to that of another; it holds as
        many line breaks as lines.
        """
        return self.with_break(self.line_start(start_index), self.next_line(end_index))

    def with_break(self, start_index: int, end_index: int) -> tuple[int, int]:
        """The range of these lines; if the last has no line break, the break before the first is in
        the range instead.
        """
        if start_index and end_index == len(self.text) and not self.text.endswith(("\n", "\r")):
            start_index -= 2 if self.text.startswith("\r\n", start_index - 2) else 1
        return start_index, end_index

    def is_blank(self, index: int) -> bool:
        """Whether the line of a character is blank."""
        return not self.text[self.line_start(index) : self.line_end(index)].strip()


def apply_splices(source_text: str, splices: Iterable[Splice]) -> str:
    """A text with all replacements made."""
    pieces: list[str] = []
    copied_until = 0
    for splice in sorted(splices, key=lambda splice: splice.start):
        pieces += (source_text[copied_until : splice.start], splice.text)
        copied_until = max(
            copied_until, splice.end
        )  # two that are taken away may share a comma or a break
    return "".join((*pieces, source_text[copied_until:]))


@lru_cache(maxsize=8)  # the next edit begins with the text checked here
def layout(source_text: str) -> Layout:
    """Lay out a text that is YAML: one document, its depth and size known to be bounded."""
    root_span = _root(source_text)
    first_end = _END_OF_LINE.search(source_text)
    newline = (
        "\r\n" if source_text.startswith("\r\n", first_end.start() if first_end else 0) else "\n"
    )
    text_layout = Layout(source_text, root_span, newline, 2)
    if root_span is not None and root_span.kind == "mapping" and not root_span.is_flow:
        steps = (
            text_layout.column(item.keys[0].start) - text_layout.column(root_span.keys[0].start)
            for item in root_span.items
            if item.kind == "mapping" and not item.is_flow
        )
        text_layout.indent_step = next((step for step in steps if step > 0), 2)
    return text_layout


def _root(source_text: str) -> Span | None:
    stack: list[Span] = []
    root_span: Span | None = None
    for yaml_event in yaml.parse(source_text, _LOADER):
        if isinstance(yaml_event, yaml.CollectionEndEvent):
            node_span = stack.pop()
            node_span.end = (
                _mark_index(yaml_event.end_mark) if node_span.is_flow else node_span.items[-1].end
            )
        elif isinstance(yaml_event, yaml.NodeEvent):
            node_span = _span(source_text, yaml_event)
            if stack:
                _add(stack[-1], node_span)
            else:
                root_span = node_span
            if isinstance(yaml_event, yaml.CollectionStartEvent):
                stack.append(node_span)
    return root_span


def _span(source_text: str, node_event: yaml.NodeEvent) -> Span:
    start_index, end_index = _mark_index(node_event.start_mark), _mark_index(node_event.end_mark)
    if isinstance(node_event, yaml.CollectionStartEvent):
        kind: Kind = "mapping" if isinstance(node_event, yaml.MappingStartEvent) else "sequence"
        return Span(kind, start_index, end_index, is_flow=bool(node_event.flow_style))
    if not isinstance(node_event, yaml.ScalarEvent):
        return Span("alias", start_index, end_index, value=node_event.anchor or "")
    style = node_event.style if node_event.style in ("'", '"', "|", ">") else None
    if style in ("|", ">"):  # the empty lines below a block belong to no value
        last_character = start_index + len(source_text[start_index:end_index].rstrip())
        match = _END_OF_LINE.search(source_text, last_character)
        end_index = match.start() if match else last_character
    return Span("scalar", start_index, end_index, style=style, value=node_event.value)


def _add(parent: Span, span: Span) -> None:
    is_key = parent.kind == "mapping" and len(parent.keys) == len(parent.items)
    (parent.keys if is_key else parent.items).append(span)


def _mark_index(mark: object) -> int:
    return int(getattr(mark, "index", 0))
