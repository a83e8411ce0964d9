"""Pages that lie: no numbers, floods, keys of others. Nothing moves, and the summary says so."""

import math
from pathlib import Path

import numpy as np
import pytest
from patience import until
from raw_page import RawPage

from ergon.live.pointer_hands import path_summary
from tests.live.test_page_hands import Playing, playing

FLOOD = 1_000_000  # positions; a page that sends a thousandth of it is cut off


def named(piece: Playing, player: str) -> str:
    """What the summary of the performance says of a player's key."""
    (board,) = [board for board in piece.ready.hands.boards if board.axes[0][1] == player]
    assert board.pointer is not None
    return path_summary(board, board.pointer)


@pytest.mark.parametrize("lie", [math.nan, math.inf, -math.inf])
def test_page_positions_without_a_number(work_folder: Path, lie: float):
    with playing() as piece, RawPage(piece.url) as page:
        assert page.text("hold 0")
        now = piece.lead("remi").now()
        assert page.positions(0, [(now, lie, 1.0), (lie, 0.02, 1.0), (now, 0.02, math.nan)])
        until(lambda: piece.tally("remi")["refused"] + piece.tally("remi")["taken"] >= 3, "all")
        assert piece.tally("remi")["refused"] >= 2
        key = piece.key(0)
        assert math.isfinite(key)
        assert abs(key) < 0.05
        assert "refused" in named(piece, "remi")
        trace = piece.lead("remi").trace()
        assert np.nanmax(np.abs(trace[:, 1:]), initial=0.0) <= 0.05 + 1e-9


def test_page_with_a_flood_of_positions(work_folder: Path):
    """A page that sends as fast as it can gets the positions that a hand may send, no more."""
    with playing() as piece, RawPage(piece.url) as page:
        assert page.text("hold 0")
        began, sent = piece.lead("remi").now(), 0
        while sent < FLOOD:
            now = piece.lead("remi").now()
            rows = [(now, 0.05 * (-1.0) ** step, 1.0) for step in range(64)]
            if not page.positions(0, rows):
                break
            sent += len(rows)
        assert 10_000 < sent < FLOOD, "the connection was not dropped"
        lasted = piece.lead("remi").now() - began
        assert piece.tally("remi")["taken"] < 5_000 * (lasted + 1.0)
        assert piece.tally("remi")["refused"] > 10_000
        assert abs(piece.key(0)) <= 0.05
        assert "refused" in named(piece, "remi")


def test_page_positions_of_another_key(work_folder: Path):
    with playing() as piece, RawPage(piece.url) as page, RawPage(piece.url) as liar:
        assert page.text("hold 0")
        now = piece.lead("remi").now()
        assert page.positions(0, [(now, 0.0, 1.0)])
        until(lambda: piece.tally("remi")["taken"] == 1, "the position of who holds it")
        assert liar.positions(0, [(now, 0.03, 1.0)] * 20)
        until(lambda: piece.tally("remi")["refused"] == 20, "refused positions")
        assert piece.tally("remi")["taken"] == 1
        assert abs(piece.key(0)) < 0.01
        assert "20 refused" in named(piece, "remi")


@pytest.mark.parametrize("words", ["hold 7", "hold -1", "hold x", "take 0", "ping", "ping x"])
def test_page_with_unknown_words(work_folder: Path, words: str):
    with playing() as piece, RawPage(piece.url) as page:
        assert page.text(words)
        now = piece.lead("remi").now()
        until(lambda: not page.positions(0, [(now, 0.0, 1.0)]), "the end of the connection")
        assert piece.tally("remi")["taken"] == 0
