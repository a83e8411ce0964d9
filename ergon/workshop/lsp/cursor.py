"""The place of a cursor in a score: the node, the table that reads it, and the field."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

from ergon.notation.tables import tuning
from ergon.notation.tables.fields import Field, Record
from ergon.notation.tables.notes import word_of
from ergon.notation.tables.shapes import Shape
from ergon.notation.text import document
from ergon.notation.text.document import Document, Node, Scalar
from ergon.notation.text.errors import Collector
from ergon.scores.reading.sections import SCORE_RECORD

_T = TypeVar("_T")
WORD = re.compile(r"[\w.#/-]*")
_WORD_BEFORE = re.compile(r"[\w.#/-]*$")
_PITCH_LIKE = re.compile(r"(?:[\w#♯♭+/\\-]|\.(?!\.))+")  # words that may be pitches, or have them
# Stands for text that is not written yet; no score has such a name.
_PLACEHOLDER = "erg0n-placeh0lder"
_WORD_MAX = 200  # characters of a word
_CLOSING = {"{": "}", "[": "]"}


@dataclass(frozen=True, slots=True)
class Cursor:
    """What is under a cursor."""

    node: Scalar
    is_name: bool  # the text before a ':'
    shape: Shape | None  # shape of the value at the cursor
    table: Record | None  # the innermost table round it
    field: Field | None  # field of that table
    path: tuple[str, ...]  # the names round it, outermost first
    sibling_names: frozenset[str]  # other names in the same mapping


def cursor_at(score_document: Document, index: int) -> Cursor | None:
    """What is under the character at `index`; None between values."""
    if score_document.root is None:
        return None
    node: Node = score_document.root
    shape: Shape | None = SCORE_RECORD
    table: Record | None = None
    field: Field | None = None
    path: tuple[str, ...] = ()
    entry_names: frozenset[str] = frozenset()
    while True:
        shape = None if shape is None else shape.chosen(node)
        if isinstance(node, document.Mapping):
            if isinstance(shape, Record):
                table = shape
            entry_before = _last_starting_before(
                ((key.start, (key, child)) for key, child in node.entries.values()),
                index,
            )
            if entry_before is None:
                return None
            key_node, child = entry_before
            entry_names = frozenset(node.entries)
            inner_shape = None if shape is None else shape.inner(key_node.text)
            field = shape.by_name.get(key_node.text) if isinstance(shape, Record) else None
            if key_node.start <= index <= key_node.end:
                sibling_names = entry_names - {key_node.text}
                record = table if isinstance(shape, Record) else None
                return Cursor(key_node, True, inner_shape, record, field, path, sibling_names)
            path = (*path, key_node.text)
            node, shape = child, inner_shape
        elif isinstance(node, document.Sequence):
            item_before = _last_starting_before(
                ((item.start, (i, item)) for i, item in enumerate(node.items)), index
            )
            if item_before is None:
                return None
            item_index, node = item_before
            shape = None if shape is None else shape.inner(item_index)
        elif isinstance(node, Scalar) and node.start <= index <= node.end:
            return Cursor(node, False, shape, table, field, path, entry_names)
        else:
            return None


def cursors_at_unwritten(
    text: str, index: int, score_document: Document
) -> list[tuple[Cursor, Document]]:
    """What the word that is being written at `index` may be: a value, a name, or both.

    The word is taken to be a placeholder, and brackets that the line leaves open are closed.
    """
    line_begin = text.rfind("\n", 0, index) + 1
    line_end = text.find("\n", index)
    text_before, text_after = (
        text[line_begin:index],
        text[index : len(text) if line_end < 0 else line_end],
    )
    text_before = text_before.removesuffix(word_before(text_before, len(text_before)))
    rest_of_line = WORD.sub("", text_after, count=1)
    closing = "" if rest_of_line.strip() else _closing_brackets(text_before)
    cursors = []
    for placeholder in (_PLACEHOLDER, f"{_PLACEHOLDER}: 0"):
        line = text_before + placeholder + (closing or rest_of_line)
        changed_text = text[:line_begin] + line + ("" if line_end < 0 else text[line_end:])
        read_document = document.compose(changed_text, score_document.file, Collector())
        cursor = cursor_at(read_document, line_begin + len(text_before))
        if cursor is not None and _PLACEHOLDER in cursor.node.text:
            cursors.append((cursor, read_document))
    return cursors


def _last_starting_before(entries: Iterable[tuple[int, _T]], text_index: int) -> _T | None:
    """The entry that begins last at or before a character. The order of entries does not tell: an
    alias has the position of its definition.
    """
    entries_before = [(start, value) for start, value in entries if start <= text_index]
    return max(entries_before, key=lambda entry: entry[0])[1] if entries_before else None


def _closing_brackets(line_text: str) -> str:
    """The closing brackets for those that a line leaves open."""
    opened = []
    for character in line_text:
        if character in _CLOSING:
            opened.append(_CLOSING[character])
        elif opened and character == opened[-1]:
            opened.pop()
    return "".join(reversed(opened))


def word_before(text: str, index: int) -> str:
    """The part of a word that is written before a character."""
    match = _WORD_BEFORE.search(text, max(0, index - _WORD_MAX), index)
    return match.group() if match else ""


def pitch_at(text: str, index: int) -> str | None:
    """The pitch round a character, as members are called by it: `A4+50cents`, `c4` of `c4.min`,
    `3to2` of `wires.3/2.m`; None if there is none.
    """
    begin = text.rfind("\n", 0, index) + 1
    for match in _PITCH_LIKE.finditer(text, begin, min(len(text), index + _WORD_MAX)):
        if match.start() <= index <= match.end():
            for word in tuning.spelled(match[0].strip(".")).split("."):
                if (pitch := word_of(word[:1].upper() + word[1:])) is not None:
                    return pitch
    return None


def word_at(text: str, index: int) -> str:
    """The word round a character: a name with its dots, empty where there is none."""
    match = WORD.match(text, index - len(word_before(text, index)))
    return match.group() if match else ""
