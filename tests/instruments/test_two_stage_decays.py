"""A decay in two stages from two strings that meet at a bridge (Weinreich, JASA 62, 1977)."""

import re
from pathlib import Path

import numpy as np
import pytest
from checked import check

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44100.0
PAGE = Path(__file__).parents[2] / "docs/language.md"


def snippet() -> str:
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (result,) = (block for block in blocks if "bridge: {FRO" in block)
    return result


def level(strike: str) -> np.ndarray:
    """Of the lowest partial, every 0.1 s [dB]."""
    text = snippet() + f"strikes: {{s: {{to: {strike}, at: 0s, impulse: 1mNs}}}}\n"
    simulation = stage(load("x.yaml", text=text).piece, planned=True).simulation
    out = np.zeros((int(6 * RATE), 1))
    simulation.process(out)
    length = 8820
    turn = np.exp(-2j * np.pi * 220.0 / RATE * np.arange(length)) * np.hanning(length)
    starts = range(0, len(out) - length, 4410)
    return np.array([20 * np.log10(abs(np.dot(out[at : at + length, 0], turn))) for at in starts])


def test_struck_string_decays_in_two_stages():
    listened = level("course.one.12")
    # Half of the motion is alike in both strings, and half is opposite.
    t = np.arange(len(listened)) * 0.1 + 0.1
    slow = np.polyfit(t[30:], listened[30:], 1)
    assert -60.0 / slow[0] == pytest.approx(8.0, rel=0.03)
    over = 10.0 ** (listened[:6] / 20.0) - 10.0 ** (np.polyval(slow, t[:6]) / 20.0)
    fast = np.polyfit(t[:6], 20.0 * np.log10(over), 1)
    assert -60.0 / fast[0] == pytest.approx(1.0, rel=0.1)
    # Where the slopes meet at the beginning the two are alike.
    assert np.polyval(fast, 0.0) - np.polyval(slow, 0.0) == pytest.approx(0.0, abs=1.0)


def test_list_of_decays_help_mentions_two_stage():
    text = "ergon: 1\ninstruments: {s: {STRING: {masses: 9, M: 4g, f: A3, t60: [1s, 8s]}}}\n"
    (result,) = check(text).diagnostics
    assert result.code == "E106"
    assert "Two-stage decay" in result.help
