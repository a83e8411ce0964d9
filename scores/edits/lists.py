"""Sections that are lists; a single entry may be written without a list."""

from __future__ import annotations

from ergon.notation.text import document, edit
from ergon.notation.text.document import Node, Scalar
from ergon.scores.edits.texts import Texts


def section_entries(texts: Texts, *path: str) -> list[Node]:
    """The entries of such a section."""
    list_node = _node(texts, path)
    if isinstance(list_node, document.Sequence):
        return list_node.items
    return (
        []
        if list_node is None or (isinstance(list_node, Scalar) and list_node.is_empty)
        else [list_node]
    )


def entry_path(texts: Texts, section: str, number: int, *inner_names: str) -> edit.Path:
    """The path of an entry of such a section."""
    path = (section, *inner_names)
    return (*path, number) if isinstance(_node(texts, path), document.Sequence) else path


def without_entry(score_texts: Texts, section_name: str, item_index: int) -> Texts:
    """Remove an entry; a section that loses its last entry becomes an empty list, which keeps its
    comment.
    """
    if len(section_entries(score_texts, section_name)) == 1:
        return score_texts.put((section_name,), "[]")
    return score_texts.remove((section_name, item_index))


def _node(texts: Texts, path: tuple[str, ...]) -> Node | None:
    node = texts.section(path[0])
    for name in path[1:]:
        node = node.get(name) if isinstance(node, document.Mapping) else None
    return node
