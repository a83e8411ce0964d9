"""Beats of the piece as a composer writes them."""

from __future__ import annotations

import re

from ergon.scores.reading.piece import Piece

# An endless part is written with a distant end, because a score needs an end. A session that comes
# near it writes the next one. It is not farther away because every occurrence is checked.
LAST_BAR = 1000
NEAR_BARS = 100  # bars
ENDLESS_POSITION = re.compile(r"[0-9]*999\|1")


def position_text(piece: Piece, beat_of_piece: float) -> str:
    """A beat of the piece as `bar|beat`, precise enough to be read as the same instant."""
    bar, beat = piece.tempo_map.bar_beat(beat_of_piece)
    return f"{bar}|{beat:.12g}"


def endless_end(piece: Piece, begin_beat: float) -> str:
    """The end that is written for an endless entry that begins at a beat: `999|1`, `1999|1` …"""
    bar, _ = piece.tempo_map.bar_beat(begin_beat)
    return f"{((bar + NEAR_BARS) // LAST_BAR + 1) * LAST_BAR - 1}|1"
