"""Glides at the prompt: heard, saved, kept, undone and rendered, of everything that can glide."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import sessions
from sessions import Stepped

from ergon.scores.reading.load import load
from ergon.scores.staging.automating import value_on_beat
from ergon.scores.staging.stage import stage

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 120, meter: 4/4}]
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      s: {STRING: {masses: 20, M: 5g, f: 110Hz, t60: 8s, X0: {at: 5, x: 1mm}}}
      m: {CEL: {M: 2g, f: 220Hz, t60: 8s}}
      b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}}
    out: {SOX: s.7}
gestures: {knock: 0mm@0 smooth 3mm@1/8 throw 0mm@1/4}
players: {ada: {hand: virtual, key: k}}
parts: {ada: []}
mix: {channels: 1, route: [{from: bell, to: 1}]}
render: {bits: float, tail: 8s}
"""


@pytest.fixture
def session(tmp_path: Path):
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        yield stepped


def pitch(sound: np.ndarray, rate: float) -> float:
    """The strongest frequency [Hz], between bins by a parabola."""
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)), 8 * len(sound)))
    position = int(spectrum[8:].argmax()) + 8
    low, here, high = np.log(spectrum[position - 1 : position + 2])
    return (position + 0.5 * (low - high) / (low - 2 * here + high)) * rate / (8 * len(sound))


def played_pitch(session: Stepped, begin: float, end: float) -> float:
    rate = session.rate
    return pitch(session.sound[int(begin * rate) : int(end * rate), 0], rate)


def test_pitch_glide_of_string_live_and_saved(session, tmp_path):
    session.ok("play from 1|1")
    session.ok("set bell.s.f A3 over 2bar")
    session.run(8.0)
    begun = session.session.schedule.running.clock.begin_instant
    (entry,) = session.session.schedule.head.piece.automation
    tempo = session.session.schedule.head.piece.tempo_map
    start = begun + tempo.seconds(tempo.resolve(entry.at))
    assert played_pitch(session, start - 1.0, start) == pytest.approx(110.0, rel=0.01)
    assert played_pitch(session, start + 1.9, start + 2.1) == pytest.approx(110 * 2**0.5, rel=0.02)
    assert played_pitch(session, start + 4.2, start + 5.0) == pytest.approx(220.0, rel=0.01)
    # It glides: no step of the sound is rougher than those before and after.
    third = np.abs(np.diff(session.sound[:, 0], 3))
    position = int(start * session.rate)
    assert (
        third[position - 200 : position + 4000].max()
        < 2 * third[position - 9000 : position - 200].max()
    )
    session.ok("save gliding")
    saved = load(tmp_path / "gliding.yaml").piece
    assert saved is not None
    assert [one.name for one in saved.automation] == ["bell.s.f"]
    complete = stage(saved)
    rendered = np.zeros((complete.n_frames, complete.simulation.n_out))
    complete.simulation.process(rendered)
    from_start = saved.tempo_map.seconds(saved.tempo_map.resolve(saved.automation[0].at))
    rate = session.rate
    late = rendered[int((from_start + 4.2) * rate) : int((from_start + 5.0) * rate), 0]
    early = rendered[int((from_start - 1) * rate) : int(from_start * rate), 0]
    assert (pitch(early, rate), pitch(late, rate)) == pytest.approx((110.0, 220.0), rel=0.01)
    session.close()
    assert np.array_equal(session.again(), session.sound)


STRING = "      s: {STRING: {masses: 20, M: 5g, f: 110Hz, t60: 8s, X0: {at: 5, x: 1mm}}}\n"
SINGLE_PITCH = SCORE.replace(STRING, "").replace("SOX: s.7", "SOX: m")
NOTES = "bell notes C4 A3 euclid 5 8 impulse 0.1mNs..1mNs"


@pytest.mark.parametrize(
    ("score", "lines"),
    [
        (SCORE, ["set bell.s.f A3 over 2bar"]),
        # The pitch follows two. At the end of the timeline one is known further than the other.
        (SINGLE_PITCH, [NOTES, "lfo bell.f 0.9..1.1 period 1bar"]),
        (
            SINGLE_PITCH,
            [NOTES, "lfo bell.f 0.9..1.1 period 200bar", "lfo bell.b.K 0.5..1.5 period 3"],
        ),
    ],
)
def test_glide_independent_of_timeline_extension(score, lines, tmp_path, monkeypatch):
    """The session looks at its engine whenever it can, and extends its timeline when it looks."""
    sounds = []
    for look in (0.03, 0.06):
        monkeypatch.setattr(sessions, "_LOOK", look)
        folder = tmp_path / str(look)
        folder.mkdir()
        with closing(Stepped(score, folder)) as stepped:
            stepped.ok("play from 1|1")
            for line in lines:
                stepped.ok(line)
            stepped.run(12.0)
            sounds.append(stepped.sound)
    assert np.array_equal(*sounds)


def test_set_pitch_of_string_does_not_click(session):
    session.ok("play from 1|1")
    session.run(1.0)
    session.ok("set bell.s.f 116Hz now")
    position = session.sound.shape[0]
    session.run(1.0)
    third = np.abs(np.diff(session.sound[:, 0], 3))
    assert (
        third[position - 200 : position + 4000].max()
        < 2 * third[position - 9000 : position - 200].max()
    )
    assert played_pitch(session, 1.2, 2.0) == pytest.approx(116.0, rel=0.01)
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_set_factor_applies_to_reached_value(session):
    session.ok("play from 1|1")
    session.ok("set bell.m.f x2 over 1bar")
    session.run(6.0)
    session.ok("set bell.m.f x0.5 over 1bar")
    session.run(6.0)
    piece = session.session.schedule.head.piece
    beat = piece.tempo_map.beats(100.0)
    assert value_on_beat(piece, ("bell", "m"), "f", beat) == pytest.approx(220.0)
    session.ok("set bell.b.K x2 over 1bar")
    session.run(4.0)
    session.ok("undo")
    session.run(3.0)
    session.ok("set bell.m.f A4")
    session.run(4.5)
    piece = session.session.schedule.head.piece
    assert value_on_beat(piece, ("bell", "m"), "f", piece.tempo_map.beats(100.0)) == 440.0
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_set_of_typed_curve(session):
    session.ok("play from 1|1")
    session.ok("set bell.m.f A3@0 smooth C4@2 line A3@4")
    session.run(1.0)
    (entry,) = session.session.schedule.head.piece.automation
    assert [point.way for point in entry.points] == ["smooth", "smooth", "line"]


@pytest.mark.parametrize("goes", [False, True])
@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("set bell.b.gap 3mm over 1bar", "bell.b is a BUT, of which only K and Z change"),
        ("set bell.b.Z 1Ns/m over 1bar", "has no Z of its own"),
        ("set bell.s.masses 30 over 1bar", "bell.s"),
        ("set bell.s.hardening 1e6N/m3 over 1bar", "only f and t60"),
    ],
)
def test_glides_of_fixed_fields_are_refused(session, line, why, goes):
    if goes:
        session.ok("play from 1|1")
    before = session.session.schedule.head.texts
    reply = session.type(line)
    assert not reply.taken
    assert why in reply.text
    assert session.session.schedule.head.texts == before


def test_set_with_glide_while_piece_stopped(session):
    session.ok("set bell.m.f x2 over 1bar")
    piece = session.session.schedule.head.piece
    assert not piece.automation
    module = next(one for one in piece.instruments["bell"].modules if one.name == "m")
    assert module.fields["f"] == pytest.approx(440.0)
    (glide,) = session.session.schedule.running.glides
    assert glide.stop - glide.start == pytest.approx(2.0)


def test_keep_of_bars_within_a_glide(session, tmp_path):
    session.ok("play from 1|1")
    session.ok("ada plays knock every 1")
    session.ok("set bell.m.f A4 over 3bar")
    session.run(7.0)  # in the middle of the glide
    session.ok("keep 1bar as verse")
    saved = load(tmp_path / "verse.yaml").piece
    assert saved is not None
    assert [one.name for one in saved.automation] == ["bell.m.f"]
    # From 2|1 on for 12 beats; of these beats 4 to 8 are kept.
    for beat in (0.2, 2.0, 4.0):
        value = value_on_beat(saved, ("bell", "m"), "f", beat)
        assert math.log2(value / 220.0) == pytest.approx((beat + 4.0) / 12.0, abs=1e-3)
