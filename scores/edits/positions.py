"""Beats of the piece as a composer writes them."""

from __future__ import annotations

import re

from ergon.scores.reading.piece import Piece

# An endless part is written with a distant end, because a score needs one. A session that
# comes near takes the next; it cannot be farther, because every occurrence is checked.
LAST_BAR = 1000
NEAR = 100  # bars
END = re.compile(r"[0-9]*999\|1")


def written(piece: Piece, beats: float) -> str:
    """A beat of the piece as `bar|beat`, exact enough to be the same instant again."""
    bar, beat = piece.tempo_map.bar_beat(beats)
    return f"{bar}|{beat:.12g}"


def end(piece: Piece, beats: float) -> str:
    """The end of an endless entry that begins at a beat: `999|1`."""
    bar, _ = piece.tempo_map.bar_beat(beats)
    return f"{((bar + NEAR) // LAST_BAR + 1) * LAST_BAR - 1}|1"
