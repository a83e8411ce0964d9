"""Blocks of a score: lines that a session runs together, by a name."""

from __future__ import annotations

from collections.abc import Sequence

from ergon.notation.text import edit
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def define(score_texts: Texts, piece: Piece, block_name: str, block_lines: Sequence[str]) -> Texts:
    """Write a block; it replaces a block of the same name. Raises EditError."""
    if block_name in piece.blocks:
        score_texts = score_texts.remove(("blocks", block_name))
    for line in block_lines:
        score_texts = score_texts.append(("blocks", block_name), edit.quoted(line))
    return score_texts
