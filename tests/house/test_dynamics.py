"""The figures of docs/pieces.md: loudness range and passages by signals whose figures are known."""

import numpy as np
import pytest
from sweep import few

from docs.generators.dynamics import PAGE, PIECES, dynamics, piece_dynamics, row

RATE = 48_000
QUICK = ("rain",)


def tones(*parts: tuple[float, float]) -> np.ndarray:
    """A stereo sine of 1 kHz: seconds and level [dBFS] of each part."""
    levels = np.concatenate([np.full(int(s * RATE), 10 ** (db / 20)) for s, db in parts])
    sine = levels * np.sin(2 * np.pi * 1000 * np.arange(len(levels)) / RATE)
    return np.stack([sine, sine], axis=1)


@pytest.mark.parametrize(
    ("levels", "asked"),
    # The first four signals of EBU Tech 3342, table 1.
    [((-20, -30), 10), ((-20, -15), 5), ((-40, -20), 20), ((-50, -35, -20, -35, -50), 15)],
)
def test_loudness_range_of_ebu_signals(levels, asked):
    measured = dynamics(tones(*((20, level) for level in levels)), RATE, 0.0)
    assert measured.loudness_range == pytest.approx(asked, abs=1.0)


def test_dynamics_without_tail():
    # A stereo sine of 1 kHz at -20 dBFS has -20 LUFS.
    measured = dynamics(tones((10, -40), (10, -20), (10, -55)), RATE, 10.0)
    assert measured.loudest == pytest.approx(-20, abs=0.1)
    assert measured.softest == pytest.approx(-40, abs=0.1)
    assert measured.true_peak == pytest.approx(-20, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", few(PIECES, QUICK))
def test_concert_piece_dynamics_equal_page(name):
    seconds, measured = piece_dynamics(name)
    assert measured.span >= 20
    assert row(name, seconds, measured) in PAGE.read_text(encoding="utf-8")
