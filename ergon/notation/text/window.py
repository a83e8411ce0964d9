"""A line or the end of a long list as a text of its own, so that an edit reads little more than it
changes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ergon.notation.text import document
from ergon.notation.text.document import Node, Scalar
from ergon.notation.text.spans import Splice
from ergon.notation.text.splices import Path

_NAME_ALONE = re.compile(r":[ \t]*(?:#.*)?")
_ALIAS = re.compile(r"(?<![^\s\[{,])[&*]")  # or an anchor, or what only looks like one
_DASH = re.compile(r"[ \t]*-[ \t]+")


@dataclass(frozen=True, slots=True)
class Window:
    """The items of a list from number `first` on, below the names that lead to the list.

    `text` is a YAML text of its own: `head` characters of names, then the characters from `start`
    to `stop` of the whole, then `tail`, which closes braces of the head.
    """

    text: str
    head: int
    start: int
    stop: int
    first: int
    tail: str = ""

    def put_back(self, edited: str) -> Splice | None:
        """The splice that puts an edited window back; None if the edit has changed the names."""
        if edited[: self.head] != self.text[: self.head] or not edited.endswith(self.tail):
            return None
        return Splice(self.start, self.stop, edited[self.head : len(edited) - len(self.tail)])


def last_items(
    text: str, name: Scalar, value: Node, path: Path, first: int | None
) -> Window | None:
    """The items from `first` on (None: the last one) of the list at a path below a section.

    `text` is the section's, `name` and `value` are its nodes. None where these lines cannot be read
    alone, or where that saves nothing.
    """
    if not is_plain(text):
        return None
    heads, tail, node = _head(text, name, value), "", value
    for word in path:
        entry = _entry(node, word)
        if entry is None or heads is None or entry[2]:
            return None
        name, value_below, _ = entry
        if text[node.start] == "{":
            head_text, tail = _head_within(text, name, value_below), "}" + tail
        else:
            head_text = _head(text, name, value_below)
        heads, node = None if head_text is None else heads + head_text, value_below
    if heads is None or not isinstance(node, document.Sequence):
        return None
    first = len(node.items) - 1 if first is None else max(first, 0)
    if not 0 <= first < len(node.items):
        return None
    (start, _), stop = node.span(first), node.end
    if text[node.start] == "[":
        start = start if first else node.start + 1
    else:
        line = text.rfind("\n", 0, start) + 1
        _, end = node.span(-1)
        if not _DASH.fullmatch(text, line, start) or text[end - 1] != "}":
            return None
        start, stop = line, _line_end(text, end)
    return Window(heads + text[start:stop] + tail, len(heads), start, stop, first, tail)


def line_window(text: str, name: Scalar, value: Node, path: Path) -> Window | None:
    """The line that holds the value at a path below a section, with the names above it.

    None if the path ends before a line of its own, or if that line cannot be read alone.
    """
    if not is_plain(text):
        return None
    head, node = _head(text, name, value), value
    for word in path[:-1]:
        entry = _entry(node, word)
        if entry is None or head is None:
            return None
        name, node, base = entry
        begin, end = base + name.start, base + node.end
        line = text.rfind("\n", 0, begin) + 1
        stop = _line_end(text, base + name.end)
        if isinstance(node, document.Mapping) and text[base + node.start] == "{":
            if text[line:begin].strip() or end > stop:
                return None
            return Window(head + text[line:stop], len(head), line, stop, 0)
        head_text = _head(text, name, node)
        head = None if head_text is None else head + head_text
    return None


def is_plain(text: str) -> bool:
    """Whether lines of a text mean the same alone: no alias, no lone carriage return."""
    has_alias = ("&" in text or "*" in text) and _ALIAS.search(text) is not None
    return not has_alias and text.count("\r") == text.count("\r\n")


def _entry(node: Node, word: str | int) -> tuple[Scalar, Node, int] | None:
    """The name and value of a mapping's entry, and where their places count from."""
    if not isinstance(node, document.Mapping) or str(word) not in node.entries:
        return None
    return *node.entries[str(word)], node.bases.get(str(word), 0)


def _head(text: str, name: Scalar, value: Node) -> str | None:
    """The line of a name, up to a bracket that begins its value; None where more stands in it."""
    begin = text.rfind("\n", 0, name.start) + 1
    if text[begin : name.start].strip():
        return None
    if text[value.start : value.start + 1] in ("[", "{"):
        name_text = text[begin : value.start + 1]
        return None if "\n" in name_text else name_text
    end = _line_end(text, name.end)
    return text[begin:end] if _NAME_ALONE.fullmatch(text[name.end : end].rstrip()) else None


def _head_within(text: str, name: Scalar, value: Node) -> str | None:
    """A name within braces, up to the bracket that begins its value; None where none does."""
    head = text[name.start : value.start + 1]
    return None if head[-1] not in "[{" or "\n" in head else head


def _line_end(text: str, index: int) -> int:
    """Where the line after that of a character begins."""
    return text.find("\n", index) + 1 or len(text)
