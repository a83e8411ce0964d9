"""The end of a bowed note."""

from __future__ import annotations

import numpy as np
import pytest
from planned_sound import played
from sweep import few

SCORE = """\
ergon: 1
tempo: {{bpm: 60}}
instruments: {{v: {{from: friction/viol}}}}
strikes: {{s: {line}}}
mix: {{channels: 1, route: [{{from: v, to: 1}}]}}
render: {{tail: 2s}}
"""
SHORT = '{{rhythm: "v:{0} ~@3", to: v, at: 1|1, times: 1}}'  # a beat long
LONG = '{{rhythm: "v:{0}@3 ~", to: v, at: 1|1, times: 1}}'
TWICE = '{{rhythm: "v:{0} v:{0} ~@2", to: v, at: 1|1, times: 1}}'


def levels(line: str, strength: str) -> list[float]:
    """The level of each tenth of a second [dB]."""
    sound = played(SCORE.format(line=line.format(strength)))[:, 0]
    tenths = sound[: len(sound) // 4410 * 4410].reshape(-1, 4410)
    return list(10.0 * np.log10((tenths**2).mean(axis=1) + 1e-30))


@pytest.mark.parametrize("strength", few(["pp", "mf", "f", "ff"], ["pp", "ff"]))
def test_bowed_note_sounds_until_its_end(strength):
    short, long = levels(SHORT, strength), levels(LONG, strength)
    assert short[:9] == pytest.approx(long[:9], abs=0.01)
    assert max(long[5:29]) - min(long[5:29]) < 12.0
    assert short[13] < short[5] - 20.0
    assert long[33] < long[25] - 20.0


def test_bowed_notes_connected_without_gap():
    twice, once = levels(TWICE, "ff"), levels(SHORT, "ff")
    assert twice[:9] == pytest.approx(once[:9], abs=0.01)
    assert twice[15] > twice[5] - 12.0
    assert twice[23] < twice[15] - 20.0
