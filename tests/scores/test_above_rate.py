"""Modes of transposed instruments above half the rate of a piece."""

from __future__ import annotations

import numpy as np
import pytest
from planned_sound import played
from sessions import Stepped

from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
instruments:
  bar:
    f: C4
    modules:
      hammer: {{CEL: {{M: 20g, f: 1Hz}}}}
      low: {{CEL: {{M: 200g, f: C4, t60: 1s}}}}
      high: {{CEL: {{M: 200g, f: {high}, t60: 1s}}}}
      b1: {{BUT: {{between: [hammer, low], K: 1e5, gap: 0.1mm}}}}
      b2: {{BUT: {{between: [hammer, high], K: 1e5, gap: 0.1mm}}}}
    out: {{SOV: [{heard}]}}
    play: {{strike: {{at: hammer, impulse: 1mNs..9mNs}}}}
    notes: [{notes}]
{more}strikes: {{tap: {{to: {struck}, at: 1|1, notes: {played}, every: 1, impulse: 2mNs}}}}
mix: {{channels: 1, route: [{{from: bar, to: 1}}]}}
render: {{bits: float, tail: 1s}}
"""
USUAL = {
    "high": "9kHz",
    "notes": "C6",
    "played": "C6",
    "struck": "bar",
    "heard": "low, high",
    "more": "",
}


def text(**changes: str) -> str:
    return SCORE.format(**USUAL | changes)


def test_modes_above_half_the_rate_are_left_out_and_named():
    result = load("s.yaml", text=text(notes="C4, C6", played="C4 C6"))
    assert result.piece is not None
    modules = {part: [m.name for m in i.modules] for part, i in result.piece.instruments.items()}
    assert modules["bar.C6"] == ["hammer", "low", "b1"]
    assert modules["bar.C4"] == ["hammer", "low", "high", "b1", "b2"]
    (note,) = [d for d in result.diagnostics if d.code == "N405"]
    assert "1 mode lies above half the rate of 44100 Hz" in note.message
    assert "bar.C6.high at 36 kHz" in note.message


def test_modes_above_half_rate_sound_as_without_them():
    without = text().replace("      high: {CEL: {M: 200g, f: 9kHz, t60: 1s}}\n", "")
    without = without.replace(
        "      b2: {BUT: {between: [hammer, high], K: 1e5, gap: 0.1mm}}\n", ""
    )
    without = without.replace("[low, high]", "[low]")
    assert np.array_equal(played(text()), played(without))


@pytest.mark.parametrize(
    "changes",
    [
        {"struck": "bar.high"},
        {"heard": "high"},
        {"more": "automation: [{at: 1|1, set: bar.C6.high.t60, to: 2s, over: 1}]\n"},
        {
            "more": "  rod: {modules: {m: {MAS: {M: 1g}}, "
            "r: {RES: {between: [m, bar.C6.high], K: 9}}}}\n"
        },
    ],
)
def test_modes_above_half_rate_used_elsewhere_remain(changes):
    result = load("s.yaml", text=text(**changes))
    assert result.piece is not None, result.diagnostics
    assert "high" in [m.name for m in result.piece.instruments["bar.C6"].modules]
    assert "N405" not in [d.code for d in result.diagnostics]


def test_modes_above_half_rate_at_written_pitch():
    written = (
        text(high="30kHz").replace("    notes: [C6]\n", "").replace(", notes: C6, every: 1", "")
    )
    result = load("s.yaml", text=written)
    assert "high" in [m.name for m in result.piece.instruments["bar"].modules]


def test_modes_above_half_rate_live_equals_render(tmp_path):
    session = Stepped(text(notes="C4, C6", played="C4 C6"), tmp_path)
    session.ok("play")
    session.run(0.3)
    session.ok("bar notes C6 C4 every 1/2 times 4 now")
    session.run(1.2)
    session.close()
    assert np.array_equal(session.sound, session.again())
