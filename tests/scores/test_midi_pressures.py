"""Pressure in MIDI files plays the act `press`, as on a keyboard."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import mido
import numpy as np
import pytest
from sessions import Stepped

import ergon
from ergon.api.score import read
from ergon.scores.gesture.midi_pressures import KeyPressure, read_pressures

# Weights that are pushed by F alone: their places say how hard they are pressed.
SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: {bpm: 60}
instruments:
  scales:
    modules: {m: {CEL: {M: 100g, f: C2, t60: 100ms}}}
    notes: [C2, E2]
    out: {SOX: m}
    play:
      lean:
        press: weight 0.2N..2N
        with: {floor: {SOL: {}}, weight: {LNL: {between: [floor, m], law: 0*d - F}}}
      press: {press: weight 0.1N..1N}
takes: {tune: {file: tune.mid}}
strikes: {tune: {play: tune, at: 1|1, to: scales}}
mix:
  channels: 2
  route: [{from: scales.C2, to: 1}, {from: scales.E2, to: 2}]
  master: {reference: SI}
render: {tail: 1s}
"""
C2, E2 = 36, 40
TICKS = 480

# Beats, and messages there: two channels, with pressures of a channel and of a key.
MESSAGES = (
    (0.0, mido.Message("aftertouch", channel=0, value=127)),  # nothing is down yet
    (0.5, mido.Message("note_on", channel=0, note=C2, velocity=127)),
    (1.0, mido.Message("aftertouch", channel=0, value=64)),
    (1.0, mido.Message("aftertouch", channel=1, value=127)),  # another channel
    (1.5, mido.Message("polytouch", channel=0, note=C2, value=127)),
    (1.5, mido.Message("polytouch", channel=0, note=E2, value=1)),  # another key
    (2.0, mido.Message("note_on", channel=1, note=E2, velocity=64)),
    (2.5, mido.Message("aftertouch", channel=0, value=0)),
    (3.0, mido.Message("aftertouch", channel=1, value=1)),
    (3.5, mido.Message("aftertouch", channel=0, value=100)),
    (4.0, mido.Message("note_off", channel=0, note=C2)),
    (4.5, mido.Message("note_off", channel=1, note=E2)),
)


def force(low: float, high: float, value: int) -> float:
    """What a value from 1 to 127 presses [N], by geometric steps; nothing for 0."""
    return low * (high / low) ** (value / 127) if value else 0.0


def expected(channel: int, note: int, beat: float) -> float:
    """How hard a note is pressed just before a beat [N], by its velocity and the last pressure."""
    velocity, pressure = 0, 0
    for when, message in MESSAGES:
        if when >= beat or message.channel != channel:
            continue
        if message.type == "note_on":
            velocity, pressure = message.velocity, 0
        elif message.type == "note_off":
            velocity = pressure = 0
        elif velocity and getattr(message, "note", note) == note:
            pressure = message.value
    return force(0.2, 2.0, velocity) + force(0.1, 1.0, pressure)


@pytest.fixture
def score(tmp_path: Path) -> Path:
    file = mido.MidiFile(ticks_per_beat=TICKS)
    track = mido.MidiTrack()
    before = 0.0
    for beat, message in MESSAGES:
        track.append(message.copy(time=round(TICKS * (beat - before))))
        before = beat
    file.tracks.append(track)
    file.save(tmp_path / "tune.mid")
    path = tmp_path / "score.yaml"
    path.write_text(SCORE, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("channel", "note", "column", "before_pressure"), [(0, C2, 0, 0.99), (1, E2, 1, 2.99)]
)
def test_pressure_in_file_acts_on_notes_of_channel(
    score: Path, channel: int, note: int, column: int, before_pressure: float
):
    sound = ergon.render(score, ergon.RenderOptions(bits="float")).frames[:, column]
    beats = np.arange(0.49, 5.0, 0.5)  # by then it stands still
    forces = np.array([expected(channel, note, beat) for beat in beats])
    places = sound[np.round(8000 * beats).astype(int)]
    compliance = sound[round(8000 * before_pressure)] / expected(channel, note, before_pressure)
    assert places / compliance == pytest.approx(forces, abs=1e-5)


def test_pressures_of_one_channel(score: Path):
    pressures = read_pressures(score.parent / "tune.mid", "1")
    assert pressures == (
        KeyPressure(1.0, C2, 64, 0.5),
        KeyPressure(1.5, C2, 127, 1.0),
        KeyPressure(3.5, C2, 100, 0.5),
    )


@pytest.mark.parametrize(("act", "is_passed_over"), [("press", False), ("push", True)])
def test_note_about_pressures(score: Path, act: str, is_passed_over: bool):
    text = SCORE.replace("      press: {press", f"      {act}: {{press")
    score.write_text(text, encoding="utf-8")
    messages = [d.message for d in read(score).diagnostics if d.code == "N404"]
    assert ["pressures" in message for message in messages] == [True] * is_passed_over


def test_transposed_and_stretched_pressures(score: Path):
    text = SCORE.replace("to: scales}", "to: scales, transpose: 4st, do: stretch 2}")
    text = text.replace("notes: [C2, E2]", "notes: [C2, E2, G#2]")
    score.write_text(text, encoding="utf-8")
    sound = ergon.render(score, ergon.RenderOptions(bits="float")).frames[:, 1]
    beats = np.arange(0.98, 10.0, 1.0)
    forces = np.array([expected(0, C2, beat / 2) for beat in beats])
    places = sound[np.round(8000 * beats).astype(int)]
    assert places / places[1] == pytest.approx(forces / forces[1], abs=1e-5)


def test_missing_notes_of_instrument_have_one_message(score: Path):
    score.write_text(SCORE.replace("[C2, E2]", "[C2, F2]").replace("scales.E2", "scales.F2"))
    codes = [d.code for d in read(score).diagnostics if d.code.startswith("E")]
    assert codes == ["E301"]


def test_pressure_from_the_beginning_of_a_note_in_a_session(tmp_path: Path):
    file = mido.MidiFile(ticks_per_beat=TICKS)
    note = dict(channel=0, note=C2)
    messages = (
        mido.Message("note_on", velocity=127, time=0, **note),
        mido.Message("aftertouch", channel=0, value=127, time=0),
        mido.Message("note_off", time=4 * TICKS, **note),
    )
    file.tracks.append(mido.MidiTrack(messages))
    file.save(tmp_path / "tune.mid")
    with closing(Stepped(SCORE, tmp_path)) as session:
        session.ok("play")
        levels = []
        for line in ("gain tune x0.5 now", "gain tune x1 now", ""):
            session.run(1.0)
            levels.append(session.sound[-1, 0])
            if line:
                session.ok(line)
        session.run(3.0)
        assert np.array(levels) / levels[0] == pytest.approx([1.0, 0.5, 1.0], rel=1e-3)
        assert abs(session.sound[-1, 0]) < 1e-6 * levels[0]
        session.close()
        assert np.array_equal(session.again(), session.sound)
