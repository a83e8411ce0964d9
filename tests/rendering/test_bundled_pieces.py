"""The beginning of every piece that ships, as a player hears it."""

from pathlib import Path

import numpy as np
import pytest
from sweep import few

import ergon
from ergon.cli.bundled import bundled_scores

PIECES = bundled_scores()
SECONDS = 8  # by then parts have fallen asleep and were woken
QUICK = {"change-ringing"}


@pytest.mark.parametrize("name", few(PIECES, QUICK))
def test_render_bundled_piece(name: str, work_folder: Path):
    built = ergon.render(PIECES[name], ergon.RenderOptions(until=f"{SECONDS}s"))
    assert len(built.frames) <= SECONDS * built.rate
    assert np.isfinite(built.frames).all()
    assert np.abs(built.frames).max() > 1e-3
