"""Parameters that follow a MIDI file, by a line at the prompt."""

import json
from contextlib import closing

import mido
import numpy as np
import pytest
from midi_files import TICKS, save
from sessions import Stepped

from ergon.scores.reading.load import load

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: {bpm: 240}
keys: {k: {M: 100g, K: 100N/m, Z: 8Ns/m}}
instruments:
  bell:
    modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 9s}}}
    out: {SOX: m}
strikes: {s: {to: bell.m, at: 1|1, every: 1, until: 40|1, impulse: 1mNs}}
mix: {channels: 1, route: [{from: bell, to: 1}]}
"""
LINE = "set bell.m.f from tune.mid by cc 1/33 range 300Hz..600Hz"
MOVES = (0, 40, 100, 127)  # of controller 1, one a quarter


@pytest.fixture
def session(tmp_path):
    events = [
        (quarter * TICKS, mido.Message("control_change", control=1, value=value))
        for quarter, value in enumerate(MOVES)
    ]
    events.append((TICKS, mido.Message("polytouch", note=60, value=64, channel=1)))
    save(tmp_path / "tune.mid", events)
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        stepped.ok("play")
        stepped.run(0.5)
        yield stepped


def pitch(sound: np.ndarray, rate: float) -> float:
    """The frequency between the first and last rising zero crossings [Hz]."""
    signs = np.flatnonzero((sound[:-1] < 0.0) & (sound[1:] >= 0.0))
    exact = signs + sound[signs] / (sound[signs] - sound[signs + 1])
    return float((len(exact) - 1) * rate / (exact[-1] - exact[0]))


def test_parameter_follows_file_as_in_score(session, tmp_path):
    session.ok(LINE)
    begin = len(session.sound)
    session.run(4.0)
    session.ok("save after.yaml")
    session.close()
    assert np.array_equal(session.again(), session.sound)
    (entry,) = load(tmp_path / "after.yaml").piece.automation
    rows = [json.loads(line) for line in session.journal.read_text().splitlines()]
    assert any(row.get("line") == LINE for row in rows)
    beat = session.session.schedule.head.piece.tempo_map.resolve(entry.at)
    running = session.session.schedule.running
    start = next(frame for frame in range(len(session.sound)) if running.beat(frame) >= beat)
    for quarter, value in enumerate(MOVES):
        expected = 300.0 + 300.0 * (value << 7) / 16383
        first = start + round((quarter * 0.25 + 0.03) * session.rate)
        last = start + round((quarter * 0.25 + 0.24) * session.rate)
        assert first > begin
        assert pitch(session.sound[first:last, 0], session.rate) == pytest.approx(
            expected, rel=2e-3
        )


def test_midi_follow_options_and_undo(session):
    session.ok(
        "set bell.m.t60 from tune.mid by pressure C4 range 0.5..2 channel 2 start 1 until 9|1"
    )
    text = session.session.schedule.head.texts.text
    for part in ("by: pressure C4", "range: 0.5..2", "channel: 2", "start: 1", "until: 9|1"):
        assert part in text
    session.ok("undo")
    assert "tune.mid" not in session.session.schedule.head.texts.text
    session.ok(LINE)
    session.ok("set bell.m.f 500Hz")
    session.run(2.0)
    session.close()
    assert np.array_equal(session.again(), session.sound)


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("set bell.m.f from nope.mid by cc 1 range 0.5..2", "nope.mid"),
        ("set bell.m.f from tune.mid by cc 1", "range"),
        ("set bell.m.f from tune.mid range 0.5..2", "by"),
        ("set bell.m.f from tune.mid by cc 200 range 0.5..2", "0 to 127"),
        ("set bell.m.f from tune.mid by wheel range 0.5..2", "not what moves in MIDI"),
        ("set bell.m.f from tune.mid by cc 1 range 0.5kg..2kg", "kg"),
        ("set bell.m.f from tune.mid by cc 1 range 0.5..2 channel 17", "16"),
        ("set bell.m.f from tune.mid by cc 9 range 0.5..2", "no values of `cc 9`"),
        ("set bell.m.f from tune.mid by cc 1 rnage 0.5..2", "rnage"),
        ("set bell.m.gap from tune.mid by cc 1 range 0.5..2", "gap"),
        ("set bell.m.f from ../tune.mid by cc 1 range 0.5..2", "tune.mid"),
    ],
)
def test_midi_follow_mistakes_are_refused(session, line, part):
    reply = session.type(line)
    assert not reply.taken
    assert part in reply.text
    assert session.session.schedule.head.texts.text == SCORE
