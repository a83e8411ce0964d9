"""Which edits leave modules and what is heard of them as they are."""

import pytest
from one_bell import SCORE

from ergon.scores.reading.digest import is_same_network
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece


def piece(text: str) -> Piece:
    result = load("score.yaml", text=text).piece
    assert result is not None
    return result


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("title: One bell", "# a remark\ntitle: Two bells"),
        ("M: 2g, f: A3", "M: 0.002kg,    f: 220Hz"),
        ("times: 2", "times: 3"),
        ("{at: 1|1, bpm: 120", "{at: 1|1, bpm: 100"),
        ("smooth 6mm", "smooth 5mm"),
    ],
)
def test_same_matter_with_other_playing_and_spelling(old: str, new: str):
    assert old in SCORE
    assert is_same_network(piece(SCORE), piece(SCORE.replace(old, new)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("K: 900N/m", "K: 901N/m"),
        ("f: A3", "f: A4"),
        ("to: [1, 2]", "to: [1]"),
        ("channels: 2", "channels: 3"),
        ("M: 400g", "M: 401g"),
        ("out: {SOX: m}", "out: {SOF: b}"),
        ("title: One bell", "title: One bell\nseed: 3"),
        (", travel: -15mm..15mm}", ", travel: -14mm..15mm}"),
    ],
)
def test_same_matter_with_other_modules_and_routes(old: str, new: str):
    assert old in SCORE
    assert not is_same_network(piece(SCORE), piece(SCORE.replace(old, new)))
