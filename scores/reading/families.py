"""Families of instruments: the files that ship, and what each instrument in a file is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import NamedTuple

from ergon.notation.text import document
from ergon.notation.text.bounds import SHIPPED_INSTRUMENTS_FOLDER
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector
from ergon.notation.text.files import Files, shipped


class Member(NamedTuple):
    """An instrument of a family; `comment` is the comment behind its name, empty if it has none."""

    name: str
    comment: str


def members(family: Document) -> tuple[Member, ...]:
    """The instruments that a file defines, in the order of the text."""
    return tuple(_members(family))


@cache  # files that ship do not change; all of them take 30 ms to read
def library() -> Mapping[str, tuple[Member, ...]]:
    """The families that ship, by the names of their files; those without instruments are left
    out.
    """
    families_by_name = {}
    for path in sorted(SHIPPED_INSTRUMENTS_FOLDER.glob("*.yaml")):
        family_document = Files(Collector(), path.parent).open(path, None)
        if family_document is not None and (family_members := members(family_document)):
            families_by_name[path.stem] = family_members
    return families_by_name


def file_of(family: str) -> str:
    """The name by which a score uses the file of a family that ships."""
    name = shipped(SHIPPED_INSTRUMENTS_FOLDER / f"{family}.yaml")
    assert name is not None
    return name


def _members(family: Document) -> Iterator[Member]:
    root = family.root
    instruments_node = root.get("instruments") if isinstance(root, document.Mapping) else None
    if not isinstance(instruments_node, document.Mapping):
        return
    for instrument_name, (word, _) in instruments_node.entries.items():
        source = word.document  # a section may have been read alone
        _, line_start, line_end = source.line_of(word.start)
        _, _, comment = source.text[line_start:line_end].partition(" #")
        yield Member(instrument_name, comment.strip())
