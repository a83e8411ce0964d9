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
    """The items of a list from number `first_item` on, below the names that lead to the list.

    `text` is a YAML text of its own: `head_length` characters of names, then the characters from
    `start` to `stop` of the whole, then `tail`, which closes braces of the head.
    """

    text: str
    head_length: int
    start: int
    stop: int
    first_item: int
    tail: str = ""

    def put_back(self, edited: str) -> Splice | None:
        """The splice that puts an edited window back; None if the edit has changed the names."""
        if edited[: self.head_length] != self.text[: self.head_length] or not edited.endswith(
            self.tail
        ):
            return None
        return Splice(
            self.start, self.stop, edited[self.head_length : len(edited) - len(self.tail)]
        )


def last_items(
    section_text: str, name_node: Scalar, section_value: Node, path: Path, first_item: int | None
) -> Window | None:
    """The items from `first_item` on (None: the last one) of the list at a path below a section.

    `section_text` is the section's, `name_node` and `section_value` are its nodes. None where these
    lines cannot be read alone, or where that saves nothing.
    """
    if not is_plain(section_text):
        return None
    heads, closing_braces, window_node = (
        _head(section_text, name_node, section_value),
        "",
        section_value,
    )
    for word in path:
        entry_below = _entry(window_node, word)
        if entry_below is None or heads is None or entry_below[2]:
            return None
        name_node, value_below, _ = entry_below
        if section_text[window_node.start] == "{":
            head_text, closing_braces = (
                _head_within(section_text, name_node, value_below),
                "}" + closing_braces,
            )
        else:
            head_text = _head(section_text, name_node, value_below)
        heads, window_node = None if head_text is None else heads + head_text, value_below
    if heads is None or not isinstance(window_node, document.Sequence):
        return None
    first_item = len(window_node.items) - 1 if first_item is None else max(first_item, 0)
    if not 0 <= first_item < len(window_node.items):
        return None
    (start_index, _), stop_index = window_node.span(first_item), window_node.end
    if section_text[window_node.start] == "[":
        start_index = start_index if first_item else window_node.start + 1
    else:
        line_start = section_text.rfind("\n", 0, start_index) + 1
        _, items_end = window_node.span(-1)
        if (
            not _DASH.fullmatch(section_text, line_start, start_index)
            or section_text[items_end - 1] != "}"
        ):
            return None
        start_index, stop_index = line_start, _line_end(section_text, items_end)
    return Window(
        heads + section_text[start_index:stop_index] + closing_braces,
        len(heads),
        start_index,
        stop_index,
        first_item,
        closing_braces,
    )


def line_window(
    section_text: str, name_node: Scalar, section_value: Node, path: Path
) -> Window | None:
    """The line that holds the value at a path below a section, with the names above it.

    None if the path ends before a line of its own, or if that line cannot be read alone.
    """
    if not is_plain(section_text):
        return None
    text_before, window_node = _head(section_text, name_node, section_value), section_value
    for word in path[:-1]:
        entry_below = _entry(window_node, word)
        if entry_below is None or text_before is None:
            return None
        name_node, window_node, base = entry_below
        name_start, value_stop = base + name_node.start, base + window_node.end
        line_start = section_text.rfind("\n", 0, name_start) + 1
        line_stop = _line_end(section_text, base + name_node.end)
        if (
            isinstance(window_node, document.Mapping)
            and section_text[base + window_node.start] == "{"
        ):
            if section_text[line_start:name_start].strip() or value_stop > line_stop:
                return None
            return Window(
                text_before + section_text[line_start:line_stop],
                len(text_before),
                line_start,
                line_stop,
                0,
            )
        head_text = _head(section_text, name_node, window_node)
        text_before = None if head_text is None else text_before + head_text
    return None


def is_plain(text: str) -> bool:
    """Whether lines of a text mean the same alone: no alias, no lone carriage return."""
    has_alias = ("&" in text or "*" in text) and _ALIAS.search(text) is not None
    return not has_alias and text.count("\r") == text.count("\r\n")


def _entry(parent_node: Node, entry_word: str | int) -> tuple[Scalar, Node, int] | None:
    """The name and value of a mapping's entry, and where their places count from."""
    if not isinstance(parent_node, document.Mapping) or str(entry_word) not in parent_node.entries:
        return None
    return *parent_node.entries[str(entry_word)], parent_node.bases.get(str(entry_word), 0)


def _head(section_text: str, name_node: Scalar, section_value: Node) -> str | None:
    """The line of a name, up to a bracket that begins its value; None where more stands in it."""
    line_begin = section_text.rfind("\n", 0, name_node.start) + 1
    if section_text[line_begin : name_node.start].strip():
        return None
    if section_text[section_value.start : section_value.start + 1] in ("[", "{"):
        name_text = section_text[line_begin : section_value.start + 1]
        return None if "\n" in name_text else name_text
    line_end = _line_end(section_text, name_node.end)
    return (
        section_text[line_begin:line_end]
        if _NAME_ALONE.fullmatch(section_text[name_node.end : line_end].rstrip())
        else None
    )


def _head_within(text: str, name: Scalar, value_node: Node) -> str | None:
    """A name within braces, up to the bracket that begins its value; None where none does."""
    head = text[name.start : value_node.start + 1]
    return None if head[-1] not in "[{" or "\n" in head else head


def _line_end(text: str, index: int) -> int:
    """Where the line after that of a character begins."""
    return text.find("\n", index) + 1 or len(text)
