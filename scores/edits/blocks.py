"""Blocks of a score: lines that a session runs together, by a name."""

from __future__ import annotations

from collections.abc import Sequence

from ergon.notation.text import edit
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def define(texts: Texts, piece: Piece, name: str, lines: Sequence[str]) -> Texts:
    """Write a block; it replaces a block of the same name. Raises EditError."""
    if name in piece.blocks:
        texts = texts.remove(("blocks", name))
    for line in lines:
        texts = texts.append(("blocks", name), edit.quoted(line))
    return texts
