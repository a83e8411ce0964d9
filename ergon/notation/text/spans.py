"""Where everything of a YAML text stands, as an edit needs it.

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

    def index(self, name: str | int) -> int | None:
        """The number of a child under a name or at an index; None where there is none."""
        if self.kind == "mapping":
            indices = (i for i, key in enumerate(self.keys) if key.value == name)
            return next(indices, None)
        if self.kind == "sequence" and isinstance(name, int) and 0 <= name < len(self.items):
            return name
        return None


@dataclass(slots=True)
class Layout:
    """A text, its root span, its line break and its indentation step."""

    text: str
    root: Span | None
    newline: str
    indent_step: int

    def line_start(self, index: int) -> int:
        """Where the line of a character begins; a break belongs to the line that it ends."""
        if self.text.startswith("\r\n", index - 1) and index:
            index -= 1
        return max(self.text.rfind("\n", 0, index), self.text.rfind("\r", 0, index)) + 1

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

    def child_start(self, parent: Span, number: int) -> int:
        """Where a child begins: its name, or its dash in a block sequence."""
        if parent.kind == "mapping":
            return parent.keys[number].start
        if parent.is_flow:
            return parent.items[number].start
        if number:
            return self.next_token(parent.items[number - 1].end)
        anchor = _ANCHOR.match(self.text, parent.start)
        return self.next_token(anchor.end() if anchor else parent.start)

    def full_lines(self, start: int, end: int) -> tuple[int, int]:
        """The range of whole lines from the line of one character to that of another; it holds as
        many line breaks as lines.
        """
        return self.with_break(self.line_start(start), self.next_line(end))

    def with_break(self, start: int, end: int) -> tuple[int, int]:
        """The range of these lines; if the last has no line break, the break before the first is in
        the range instead.
        """
        if start and end == len(self.text) and not self.text.endswith(("\n", "\r")):
            start -= 2 if self.text.startswith("\r\n", start - 2) else 1
        return start, end

    def is_blank(self, index: int) -> bool:
        """Whether the line of a character is blank."""
        return not self.text[self.line_start(index) : self.line_end(index)].strip()


def apply_splices(text: str, splices: Iterable[Splice]) -> str:
    """A text with all replacements made."""
    pieces: list[str] = []
    offset = 0
    for splice in sorted(splices, key=lambda splice: splice.start):
        pieces += (text[offset : splice.start], splice.text)
        offset = max(offset, splice.end)  # two that are taken away may share a comma or a break
    return "".join((*pieces, text[offset:]))


@lru_cache(maxsize=8)  # the next edit begins with the text checked here
def layout(text: str) -> Layout:
    """Lay out a text that is YAML: one document, its depth and size known to be bounded."""
    root = _root(text)
    first_end = _END_OF_LINE.search(text)
    newline = "\r\n" if text.startswith("\r\n", first_end.start() if first_end else 0) else "\n"
    result = Layout(text, root, newline, 2)
    if root is not None and root.kind == "mapping" and not root.is_flow:
        steps = (
            result.column(item.keys[0].start) - result.column(root.keys[0].start)
            for item in root.items
            if item.kind == "mapping" and not item.is_flow
        )
        result.indent_step = next((step for step in steps if step > 0), 2)
    return result


def _root(text: str) -> Span | None:
    stack: list[Span] = []
    root: Span | None = None
    for event in yaml.parse(text, _LOADER):
        if isinstance(event, yaml.CollectionEndEvent):
            span = stack.pop()
            span.end = _mark(event.end_mark) if span.is_flow else span.items[-1].end
        elif isinstance(event, yaml.NodeEvent):
            span = _span(text, event)
            if stack:
                _add(stack[-1], span)
            else:
                root = span
            if isinstance(event, yaml.CollectionStartEvent):
                stack.append(span)
    return root


def _span(text: str, event: yaml.NodeEvent) -> Span:
    start, end = _mark(event.start_mark), _mark(event.end_mark)
    if isinstance(event, yaml.CollectionStartEvent):
        kind: Kind = "mapping" if isinstance(event, yaml.MappingStartEvent) else "sequence"
        return Span(kind, start, end, is_flow=bool(event.flow_style))
    if not isinstance(event, yaml.ScalarEvent):
        return Span("alias", start, end, value=event.anchor or "")
    style = event.style if event.style in ("'", '"', "|", ">") else None
    if style in ("|", ">"):  # the empty lines below a block belong to no value
        last_character = start + len(text[start:end].rstrip())
        match = _END_OF_LINE.search(text, last_character)
        end = match.start() if match else last_character
    return Span("scalar", start, end, style=style, value=event.value)


def _add(parent: Span, span: Span) -> None:
    is_key = parent.kind == "mapping" and len(parent.keys) == len(parent.items)
    (parent.keys if is_key else parent.items).append(span)


def _mark(mark: object) -> int:
    return int(getattr(mark, "index", 0))
