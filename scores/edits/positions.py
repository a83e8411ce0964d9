"""Beats of the piece as a composer writes them."""

from __future__ import annotations

import re

from ergon.scores.reading.piece import Piece

# What goes on without end is written with an end far off, for a score has one. A session that
# comes near takes the next: the checker counts every occurrence up to it, so it cannot be far.
LAST_BAR = 1000
NEAR = 100  # bars
END = re.compile(r"[0-9]*999\|1")


def written(piece: Piece, beats: float) -> str:
    """A beat of the piece as `bar|beat`, exact enough to be the same instant again."""
    bar, beat = piece.tempo_map.bar_beat(beats)
    return f"{bar}|{beat:.12g}"


def end(piece: Piece, beats: float) -> str:
    """Where what begins at a beat ends when nobody ends it: `999|1`."""
    bar, _ = piece.tempo_map.bar_beat(beats)
    return f"{((bar + NEAR) // LAST_BAR + 1) * LAST_BAR - 1}|1"
