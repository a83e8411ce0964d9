"""The parts of the score of MusicXML that a take names."""

from __future__ import annotations

from pathlib import Path

from ergon.notation.text import document
from ergon.notation.text.bounds import FileBounds
from ergon.notation.text.document import Document, Scalar
from ergon.scores.gesture.musicxml_bytes import SUFFIXES
from ergon.scores.gesture.musicxml_file import XmlPart, read_score
from ergon.scores.gesture.take_file import TakeError

from .cursor import Cursor


def parts_beside(cursor: Cursor, score_file: Document) -> tuple[XmlPart, ...]:
    """The parts among which a `channel` at the cursor chooses; none in other places, and for a file
    that cannot be read.
    """
    if cursor.is_name or cursor.field is None or cursor.field.name != "channel":
        return ()
    cursor_node = score_file.root
    for name in cursor.path[:2]:
        cursor_node = cursor_node.get(name) if isinstance(cursor_node, document.Mapping) else None
    take = cursor_node.get("file") if isinstance(cursor_node, document.Mapping) else None
    if not isinstance(take, Scalar) or Path(take.text).suffix.lower() not in SUFFIXES:
        return ()
    folder = Path(score_file.file).parent
    path = folder / take.text
    try:
        return read_score(path).parts if FileBounds.around(folder).allows(path) else ()
    except (TakeError, ValueError):  # ValueError: a name that no file can have
        return ()


def part_text(part: XmlPart) -> str:
    """A part in a few words."""
    notes = f"{len(part.notes)} notes" if len(part.notes) != 1 else "1 note"
    return f"part {part.label}: {notes}"
