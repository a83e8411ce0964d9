"""Sections that are lists; a single entry may be written without a list."""

from __future__ import annotations

from ergon.notation.text import document, edit
from ergon.notation.text.document import Node, Scalar
from ergon.scores.edits.texts import Texts


def items(texts: Texts, *path: str) -> list[Node]:
    """The entries of such a section."""
    node = _node(texts, path)
    if isinstance(node, document.Sequence):
        return node.items
    return [] if node is None or (isinstance(node, Scalar) and node.is_empty) else [node]


def place(texts: Texts, section: str, number: int, *further: str) -> edit.Path:
    """The path of an entry of such a section."""
    path = (section, *further)
    return (*path, number) if isinstance(_node(texts, path), document.Sequence) else path


def dropped(texts: Texts, section: str, number: int) -> Texts:
    """Remove an entry; a section that loses its last entry becomes an empty list, which keeps its
    comment.
    """
    if len(items(texts, section)) == 1:
        return texts.put((section,), "[]")
    return texts.remove((section, number))


def _node(texts: Texts, path: tuple[str, ...]) -> Node | None:
    node = texts.section(path[0])
    for name in path[1:]:
        node = node.get(name) if isinstance(node, document.Mapping) else None
    return node
