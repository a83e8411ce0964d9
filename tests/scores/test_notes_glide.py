"""Automation of all notes of an instrument at once."""

from __future__ import annotations

import numpy as np
import pytest
from planned_sound import played
from sessions import Stepped

from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: 60, meter: 4/4}}]
instruments:
  bars:
    f: C4
    modules:
      low: {{CEL: {{M: 2g, f: C4, t60: 8s}}}}
      high: {{CEL: {{M: 1g, f: G5, t60: 4s}}}}
    out: {{SOV: [low, high]}}
    notes: [C4, E4, G4]
strikes:
  tune: {{to: bars.low, at: 1|1, notes: C4 E4 C4, every: 1, impulse: 1mNs}}
automation: [{lines}]
mix: {{channels: 1, route: [{{from: bars, to: 1}}]}}
render: {{bits: float, tail: 2s}}
"""
SESSION = SCORE.replace("automation: [{lines}]\n", "").format()


def loaded(lines: str):
    return load("s.yaml", text=SCORE.format(lines=lines))


def sound(lines: str) -> np.ndarray:
    return played(SCORE.format(lines=lines))


@pytest.mark.parametrize(
    ("line", "parameter"),
    [
        ("{{at: 1|1, {}: {}, to: x1.5, over: 2}}", "f"),
        ("{{at: 1|2, {}: {}, to: -150cents, over: 2, curve: smooth}}", "f"),
        ("{{at: 1|1, {}: {}, to: 2st@0 line -50cents@1 smooth 0st@2}}", "f"),
        ("{{at: 1|1, {}: {}, to: 0st 2st 4st, every: 1/2}}", "f"),
        ("{{at: 1|1, {}: {}, to: 1s, over: 2}}", "low.t60"),
        ("{{at: 1|1, {}: {}, to: 4g, over: 2}}", "low.M"),
    ],
)
def test_notes_together_as_one_by_one(line, parameter):
    together = sound(line.format("set", f"bars.{parameter}"))
    by_note = ", ".join(line.format("set", f"bars.{note}.{parameter}") for note in ("C4", "E4"))
    assert np.array_equal(together, sound(by_note))
    assert not np.array_equal(together, sound(""))


def test_lfo_of_all_notes_equals_single_ones():
    line = "{{at: 1|1, lfo: {}, range: -50cents..50cents, period: 1/4}}"
    by_note = ", ".join(line.format(f"bars.{note}.f") for note in ("C4", "E4"))
    assert np.array_equal(sound(line.format("bars.f")), sound(by_note))


def test_interval_in_automation():
    line = "{{at: 1|1, set: bars.f, to: {}, over: 2}}"
    ratio = 2.0 ** (3 / 12)
    assert np.array_equal(sound(line.format("3st")), sound(line.format(f"x{ratio!r}")))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("{at: 1|1, set: bars.f, to: A4, over: 1}", "the notes have pitches of their own"),
        ("{at: 1|1, set: bars.low.f, to: 440Hz, over: 1}", "the notes have pitches of their own"),
        ("{at: 1|1, set: bars.lower.f, to: 2st, over: 1}", "no such module"),
        ("{at: 1|1, set: bars.t60, to: 1s, over: 1}", "name a module for t60"),
        ("{at: 1|1, set: bars.low.t60, to: 2st, over: 1}", "unknown unit 'st'"),
    ],
)
def test_impossible_gestures_of_notes_are_refused(line, words):
    errors = loaded(line).diagnostics
    assert words in errors[0].message
    assert errors[0].place is not None


def test_set_of_all_notes_live_equals_render(tmp_path):
    session = Stepped(SESSION, tmp_path)
    session.ok("play")
    session.run(0.3)
    session.ok("set bars.f 2st over 1 now")
    session.run(1.0)
    session.ok("set bars.f x0.5 over 1/2 now")
    session.ok("set bars.transpose -30cents over 50ms now")
    session.run(1.0)
    session.close()
    assert np.array_equal(session.sound, session.again())


def test_notes_are_transposed_at_the_prompt(tmp_path):
    session = Stepped(SESSION, tmp_path)
    session.ok("set bars.transpose 100cents now")
    assert "transpose: 100cents" in session.session.schedule.head.texts.text
    session.ok("set bars.transpose -2st now")
    assert "transpose: -2st" in session.session.schedule.head.texts.text
    session.close()


def test_set_pitch_of_all_notes_is_refused(tmp_path):
    session = Stepped(SESSION, tmp_path)
    reply = session.type("set bars.f 2st")
    assert not reply.taken
    assert "set bars.transpose 2st" in reply.text
    session.close()
