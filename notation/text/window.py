"""A line or the end of a long list as a text of its own, so that an edit reads little more than it
changes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.splices import Path

_NAME_ALONE = re.compile(r":[ \t]*(?:#.*)?")
_ALIAS = re.compile(r"(?<![^\s\[{,])[&*]")  # or an anchor, or what only looks like one
_DASH = re.compile(r"[ \t]*-[ \t]+")


@dataclass(frozen=True, slots=True)
class Window:
    """The items of a list from number `first` on, below the names that lead to the list.

    `text` is a YAML text of its own: `head` characters of names, then the characters from `start`
    to `stop` of the whole.
    """

    text: str
    head: int
    start: int
    stop: int
    first: int

    def put_back(self, whole: str, edited: str) -> str | None:
        """The whole text with this window edited; None where the edit has changed the names."""
        if edited[: self.head] != self.text[: self.head]:
            return None
        return whole[: self.start] + edited[self.head :] + whole[self.stop :]


def last_items(
    text: str, name: Scalar, value: Node, path: Path, first: int | None
) -> Window | None:
    """The items from `first` on (None: the last one) of the list at a path below a section.

    `text` is the section's, `name` and `value` are its nodes. None where these lines cannot be read
    alone, or where that saves nothing.
    """
    if _ALIAS.search(text) or text.count("\r") != text.count("\r\n"):
        return None
    heads = [_head(text, name, value)]
    node = value
    for word in path:
        entry = node.entries.get(str(word)) if isinstance(node, document.Mapping) else None
        if entry is None:
            return None
        heads.append(_head(text, *entry))
        node = entry[1]
    if None in heads or not isinstance(node, document.Sequence):
        return None
    first = len(node.items) - 1 if first is None else first
    if not 1 <= first < len(node.items):
        return None
    (start, _), stop = node.span(first), node.end
    if text[node.start] != "[":
        line = text.rfind("\n", 0, start) + 1
        _, end = node.span(-1)
        if not _DASH.fullmatch(text, line, start) or text[end - 1] != "}":
            return None
        start, stop = line, _line_end(text, end)
    head = "".join(one for one in heads if one is not None)
    return Window(head + text[start:stop], len(head), start, stop, first)


def one_line(text: str, name: Scalar, value: Node, path: Path) -> Window | None:
    """The line of the value that a path below a section leads into, with the names above it.

    None where the path ends before a line of its own, or where that cannot be read alone.
    """
    if _ALIAS.search(text) or text.count("\r") != text.count("\r\n"):
        return None
    head, node = _head(text, name, value), value
    for word in path[:-1]:
        entry = node.entries.get(str(word)) if isinstance(node, document.Mapping) else None
        if entry is None or head is None:
            return None
        name, node = entry
        line = text.rfind("\n", 0, name.start) + 1
        stop = _line_end(text, name.end)
        if isinstance(node, document.Mapping) and text[node.start] == "{":
            if text[line : name.start].strip() or node.end > stop:
                return None
            return Window(head + text[line:stop], len(head), line, stop, 0)
        own = _head(text, name, node)
        head = None if own is None else head + own
    return None


def _head(text: str, name: Scalar, value: Node) -> str | None:
    """The line of a name, up to the bracket that begins a list; None where more stands in it."""
    begin = text.rfind("\n", 0, name.start) + 1
    if text[begin : name.start].strip():
        return None
    if isinstance(value, document.Sequence) and text[value.start] == "[":
        head = text[begin : value.start + 1]
        return None if "\n" in head else head
    end = _line_end(text, name.end)
    return text[begin:end] if _NAME_ALONE.fullmatch(text[name.end : end].rstrip()) else None


def _line_end(text: str, index: int) -> int:
    """Where the line after that of a character begins."""
    return text.find("\n", index) + 1 or len(text)
