"""What ships sounds at -20 LUFS, within 4, and its true peaks at -1 dBTP at most."""

import math
from pathlib import Path

import numpy as np
import pytest
from bs1770 import RATE, integrated
from scipy.signal import resample_poly

import ergon
from ergon.cli import app
from ergon.cli.new import TEMPLATES

BLOCK = 1 << 18  # frames, to save memory
LIBRARY = Path(__file__).parents[2] / "scores" / "library"
QUICK = ("fader",)
# Four minutes of 245,000 modules take half an hour and more; its mix is that of feathers-small.
TOO_LONG = ("feathers",)
SLOW = sorted(path.stem for path in LIBRARY.glob("*.yaml") if path.stem not in (*QUICK, *TOO_LONG))


def levels(score: Path) -> tuple[float, float]:
    """Loudness [LUFS] and true peak [dBTP] of a score, measured by other means than the product."""
    done = ergon.render(score)
    frames, peak = done.frames, 0.0
    for start in range(0, len(frames), BLOCK):
        block = frames[max(start - 64, 0) : start + BLOCK + 64]
        peak = max(peak, np.abs(resample_poly(block, 8, 1, axis=0)).max())
    assert done.rate == 44_100
    return integrated(resample_poly(frames, RATE // 300, 147, axis=0)), 20 * math.log10(peak)


def check(score: Path) -> None:
    loudness, peak = levels(score)
    assert loudness == pytest.approx(-20.0, abs=4.0)
    assert peak <= -0.9  # of -1, and the ripple of a meter at four times the rate


@pytest.mark.parametrize("template", TEMPLATES)
def test_loudness_of_a_new_piece(template, work_folder):
    assert app.run(["new", "piece", "-q", "--template", template]) == 0
    check(work_folder / "piece" / "score.yaml")


@pytest.mark.parametrize("name", QUICK)
def test_loudness_of_a_piece(name):
    check(LIBRARY / f"{name}.yaml")


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_loudness_of_each_piece(name):
    check(LIBRARY / f"{name}.yaml")
