"""The end of a bowed note."""

from __future__ import annotations

import numpy as np
import pytest
from planned_sound import played

SCORE = """\
ergon: 1
tempo: {{bpm: 60}}
instruments: {{v: {{from: friction/viol}}}}
strikes: {{s: {line}}}
mix: {{channels: 1, route: [{{from: v, to: 1}}]}}
render: {{tail: 2s}}
"""
ENDED = '{{rhythm: "v:{0} ~@3", to: v, at: 1|1, times: 1}}'  # a beat long
ENDLESS = "{{to: v, at: 1|1, impulse: {0}}}"
TWICE = '{{rhythm: "v:{0} v:{0} ~@2", to: v, at: 1|1, times: 1}}'


def levels(line: str, strength: str) -> list[float]:
    """The level of each tenth of a second [dB]."""
    sound = played(SCORE.format(line=line.format(strength)))[:, 0]
    tenths = sound[: len(sound) // 4410 * 4410].reshape(-1, 4410)
    return list(10.0 * np.log10((tenths**2).mean(axis=1) + 1e-30))


@pytest.mark.parametrize("strength", ["mf", "f", "ff", "fff"])
def test_level_falls_after_the_end_of_a_note(strength):
    ended, endless = levels(ENDED, strength), levels(ENDLESS, strength)
    assert ended[:9] == pytest.approx(endless[:9], abs=0.01)
    assert ended[12] < ended[5] - 30.0
    if strength in ("ff", "fff"):  # the bow would go on
        assert endless[11] > endless[5] - 12.0
        assert ended[12] < endless[12] - 25.0


def test_bow_goes_on_from_note_to_note():
    twice, once = levels(TWICE, "ff"), levels(ENDED, "ff")
    assert twice[:9] == pytest.approx(once[:9], abs=0.01)
    assert twice[15] > twice[5] - 12.0
    assert twice[22] < twice[15] - 30.0
