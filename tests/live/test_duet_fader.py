"""The piece that ships for a FireFader: its hand gets forces that it can feel."""

from pathlib import Path

import numpy as np
import pytest
from duets import duet, recorded
from emulators import emulator

PIECE = Path(__file__).parents[2] / "scores" / "library" / "fader.yaml"
SWEEP = "0mm@0 (smooth 30mm@1 smooth -30mm@3 smooth 0mm@4)*40"


@pytest.mark.slow
def test_firefader_piece_force_above_300_mn(tmp_path: Path):
    take = tmp_path / "hand.take"
    with emulator("firefader", "--lockstep", "--gesture", SWEEP) as fader:
        live = ("--live", f"remi={fader.url}")
        with duet(
            PIECE, *live, "--audio", "null:fast", "--gain", "0dB", "--record", take
        ) as single:
            assert single.end() == 0, single.lines
    assert not [line for line in single.lines if "scaled" in line], single.lines
    result = recorded(take)
    # Forces rise for two seconds at the start.
    forces, sent = result.forces()[3_000:, 0], result.sent()[3_000:, 0]
    assert np.abs(sent).max() > 0.3
    assert np.abs(sent).max() > 0.95 * np.abs(forces).max()
