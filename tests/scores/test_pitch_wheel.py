"""The pitch wheel of MIDI files: what it does to each note."""

from __future__ import annotations

import math
import random
from pathlib import Path

import mido
import numpy as np
import pytest
from midi_files import TICKS, note, save
from planned_sound import played

from ergon.notation.text.errors import Collector
from ergon.scores.gesture.midi_wheels import read_wheels
from ergon.scores.reading.load import load
from ergon.scores.staging.automating import automation_points, numbers_at

SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: {bpm}, meter: {meter}}}]
instruments:
  bars:
    f: C4
    modules:
      low: {{CEL: {{M: 2g, f: C4, t60: 60s}}}}
      high: {{CEL: {{M: 1g, f: G5, t60: 60s}}}}
    out: {{SOV: low}}
    play: {{strike: {{at: low, impulse: 1mNs..9mNs}}}}
    notes: [C4, D4, E4, G4]
takes: {{tune: {{file: tune.mid, bend: {bend}}}}}
strikes: {{line: {{play: tune, to: bars, at: 1|1{more}}}}}
mix: {{channels: 1, route: [{{from: bars, to: 1}}]}}
render: {{bits: float, tail: 8s}}
"""


def wheel(tick: int, value: int, channel: int = 0):
    return tick, mido.Message("pitchwheel", pitch=value, channel=channel)


def control(tick: int, number: int, value: int, channel: int = 0):
    return tick, mido.Message("control_change", control=number, value=value, channel=channel)


def wheel_range(tick: int, semitones: int, channel: int = 0):
    numbers = (101, 0), (100, 0), (6, semitones)
    return [control(tick, *pair, channel) for pair in numbers]


def mpe_zone(tick: int, n_channels: int, master: int = 0):
    numbers = (101, 0), (100, 6), (6, n_channels)
    return [control(tick, *pair, master) for pair in numbers]


def score(
    folder: Path, curvature: str = "2st", meter: str = "4/4", bpm: float = 60, more: str = ""
):
    path = folder / "s.yaml"
    path.write_text(SCORE.format(bend=curvature, meter=meter, bpm=bpm, more=more), encoding="utf-8")
    return load(path)


def test_bend_of_each_channel(tmp_path: Path):
    file = save(
        tmp_path / "tune.mid",
        note(0, 60, channel=0) + note(0, 64, channel=1),
        [wheel(TICKS, 4096, 0), wheel(2 * TICKS, -8192, 1)],
    )
    assert read_wheels(file, None, 200.0) == {
        60: ((0.0, 0.0), (1.0, 100.0)),
        64: ((0.0, 0.0), (2.0, -200.0)),
    }
    assert read_wheels(file, "1", 1200.0) == {60: ((0.0, 0.0), (1.0, 600.0))}


def test_bend_before_note(tmp_path: Path):
    events = [*note(TICKS, 60), wheel(TICKS, 8191), wheel(TICKS // 2, -8192)]
    file = save(tmp_path / "tune.mid", events)
    assert read_wheels(file, None, 100.0) == {60: ((1.0, 100.0 * 8191 / 8192),)}


def test_bend_range_from_file(tmp_path: Path):
    events = [*wheel_range(0, 12), *note(1, 60), wheel(TICKS, 4096)]
    file = save(tmp_path / "tune.mid", events)
    assert read_wheels(file, None, 200.0)[60][-1] == (1.0, 600.0)


def test_other_registered_parameters_set_no_range(tmp_path: Path):
    others = [control(0, 101, 0), control(0, 100, 1), control(0, 6, 64), control(0, 6, 9)]
    file = save(tmp_path / "tune.mid", [*others, *note(1, 60), wheel(TICKS, 4096)])
    assert read_wheels(file, None, 200.0)[60][-1] == (1.0, 100.0)


def test_bend_of_notes_in_zones(tmp_path: Path):
    events = [
        *mpe_zone(0, 3),
        *note(10, 60, channel=1),
        *note(10, 64, channel=2),
        wheel(TICKS, 1024, 1),  # an eighth of 48 semitones
        wheel(2 * TICKS, 4096, 0),  # half of the master's two semitones, for both
        *note(3 * TICKS, 67, channel=1),  # takes the channel of the first note
        wheel(4 * TICKS, 0, 1),
    ]
    file = save(tmp_path / "tune.mid", events)
    start = 10 / TICKS
    assert read_wheels(file, None, 200.0) == {
        60: ((start, 0.0), (1.0, 600.0), (2.0, 700.0)),
        64: ((start, 0.0), (2.0, 100.0)),
        67: ((3.0, 700.0), (4.0, 100.0)),
    }


def test_bend_range_of_zone(tmp_path: Path):
    events = [*mpe_zone(0, 3), *wheel_range(1, 24, 2), *note(10, 60, channel=1)]
    file = save(tmp_path / "tune.mid", [*events, wheel(TICKS, 4096, 1)])
    assert read_wheels(file, None, 200.0)[60][-1] == (1.0, 1200.0)


@pytest.mark.parametrize("meter", ["4/4", "6/8", "3/2"])
def test_wheel_pitches_equal_mido_in_every_meter(tmp_path: Path, meter: str):
    """Against the wheel as mido reads it, at the instants of the file at 75 quarters a minute."""
    draw = random.Random(7)
    ticks = sorted(draw.sample(range(30, 20 * TICKS, 7), 60))
    events = [wheel(tick, draw.randrange(-8192, 8192)) for tick in ticks]
    save(tmp_path / "tune.mid", note(0, 62, 21 * TICKS), events)
    unit = int(meter.partition("/")[2])
    result = score(tmp_path, meter=meter, bpm=75 * unit / 4)
    assert result.piece is not None, result.diagnostics
    points = automation_points(result.piece, -math.inf, 200.0, Collector())
    curve = points.points["bars.D4", "low"]
    unbent = curve[0][1]
    file, now, value = mido.MidiFile(tmp_path / "tune.mid"), 0.0, 0
    compared = 0
    for message in mido.merge_tracks(file.tracks):
        later = now + message.time * 0.8 / TICKS
        if later - now > 0.03:  # the wheel stands, but for the time in which the next is reached
            factor = (numbers_at(curve, later - 0.015)[0] / unbent) ** 0.5
            cents = 1200.0 * math.log2(factor)
            assert cents == pytest.approx(200.0 * value / 8192, abs=0.01)
            compared += 1
        now = later
        value = message.pitch if message.type == "pitchwheel" else value
    assert compared > 40


def test_bend_pitch_in_the_sound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    save(tmp_path / "tune.mid", note(0, 60, 8 * TICKS), [wheel(TICKS, 4096), wheel(4 * TICKS, 0)])
    monkeypatch.chdir(tmp_path)
    score(tmp_path, "3st")
    sound = played((tmp_path / "s.yaml").read_text(encoding="utf-8"))[:, 0]
    for start, cents in ((0.1, 0.0), (1.5, 150.0), (4.5, 0.0)):
        part = sound[int(start * 44100) : int((start + 0.4) * 44100)]
        spectrum = np.abs(np.fft.rfft(part * np.hanning(len(part)), 1 << 20))
        peak = np.argmax(spectrum) * 44100 / (1 << 20)
        expected = 440.0 * 2 ** (-9 / 12 + cents / 1200)
        assert 1200 * math.log2(peak / expected) == pytest.approx(0.0, abs=1.5)


def test_bend_of_transposed_and_repeated_phrases(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0, 60), [wheel(TICKS, 8191), wheel(3 * TICKS, 0)])
    result = score(tmp_path, more=", transpose: 2st, every: 1bar, times: 2")
    assert result.piece is not None, result.diagnostics
    (glide,) = result.piece.strikes[0].glides
    assert glide.target.part == "bars.D4"
    points = automation_points(result.piece, -math.inf, 20.0, Collector()).points
    curve = points["bars.D4", "low"]
    for start in (0.0, 4.0):
        high, low = (numbers_at(curve, start + later)[0] for later in (2.0, 3.9))
        assert (high / low) ** 0.5 == pytest.approx(2 ** (2 * 8191 / 8192 / 12), rel=1e-6)


def test_wheel_without_bend_is_named(tmp_path: Path):
    save(tmp_path / "tune.mid", note(0, 60), [wheel(TICKS, 100)], wheel_range(0, 2))
    with_bend = score(tmp_path)
    assert [d.code for d in with_bend.diagnostics] == []
    path = tmp_path / "s.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace(", bend: 2st", ""), encoding="utf-8")
    without = load(path)
    (named,) = [d for d in without.diagnostics if d.code == "N404"]
    assert "1 pitch bend" in named.message
    assert not without.piece.strikes[0].glides


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("at: 1|1}", "at: 1|1, do: reverse}"), "played as it is"),
        (("    f: C4\n", ""), "f"),
        (("bend: 2st", "bend: 2"), "2st"),
    ],
)
def test_bend_of_unsuitable_instrument_is_refused(tmp_path: Path, change, words):
    save(tmp_path / "tune.mid", note(0, 60), [wheel(TICKS, 100)])
    score(tmp_path)
    path = tmp_path / "s.yaml"
    text = path.read_text(encoding="utf-8")
    assert change[0] in text
    path.write_text(text.replace(*change), encoding="utf-8")
    messages = [d for d in load(path).diagnostics if d.code.startswith("E")]
    assert messages
    assert words in f"{messages[0].message} {messages[0].suggestion}"
