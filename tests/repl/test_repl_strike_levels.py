"""Mute, solo and gain of strikes: their impulses are scaled, and their patterns go on."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from sessions import Stepped

# Two bells that are silent after a tenth of a beat; a beat is half a second.
SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: [{at: 1|1, bpm: 120}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}}
instruments:
  low: {modules: {m: {CEL: {M: 20g, f: 220Hz, t60: 50ms}}}, out: {SOX: m}}
  high: {modules: {m: {CEL: {M: 20g, f: 880Hz, t60: 50ms}}}, out: {SOX: m}}
  bow:
    modules:
      m: {CEL: {M: 20g, f: 440Hz, t60: 50ms}}
      b: {BUT: {between: [k1, m], K: 900N/m, Z: 1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 6mm@60ms 0mm@160ms}
players: {ada: {key: k1}, leo: {key: k2}}
mix: {channels: 3, route: [{from: low, to: [1]}, {from: high, to: [2]}, {from: bow, to: [3]}]}
"""
LINES = (
    "d1 strikes low.m every 1 impulse 1mNs..2mNs chance 0.7",
    "d2 strikes high.m every 1/2 impulse 1mNs",
    "ada plays knock every 1",
)


@pytest.fixture
def stepped(tmp_path: Path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        for line in LINES:
            session.ok(line)
        session.ok("play")
        session.run(2.0)
        yield session


def beats(session: Stepped, channel: int, first: float, last: float) -> np.ndarray:
    """The highest level of each beat of a channel, from one beat of the session to another."""
    n_frames = int(session.rate / 2)
    part = session.sound[int(first) * n_frames : int(last) * n_frames, channel - 1]
    return np.abs(part).reshape(-1, n_frames).max(axis=1)


def same_again(session: Stepped) -> None:
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_mute_strikes_go_on_in_silence(stepped: Stepped, tmp_path: Path):
    stepped.ok("mute d1 at 3|1")
    stepped.ok("unmute d1 at 5|1")
    stepped.run(10.0)
    assert beats(stepped, 1, 9, 16).max() < 1e-6
    assert beats(stepped, 2, 9, 16).min() > 1e-6
    same_again(stepped)
    folder = tmp_path / "plain"
    folder.mkdir()
    with closing(Stepped(SCORE, folder)) as plain:
        for line in LINES:
            plain.ok(line)
        plain.ok("play")
        plain.run(12.0)
        # Behind the mute each stroke is the one that it would have been.
        assert np.allclose(
            beats(stepped, 1, 17, 24), beats(plain, 1, 17, 24), rtol=1e-6, atol=1e-12
        )
        assert beats(plain, 1, 9, 16).max() > 1e-6


def test_mute_strikes_acts_on_a_beat_and_is_undone(stepped: Stepped):
    stepped.ok("mute d2 now")
    stepped.run(1.0)
    assert "d2 (strikes): high.m from 1|1, muted" in stepped.ok("voices").lines
    first = len(stepped.sound) // int(stepped.rate / 2)
    stepped.run(2.0)
    assert beats(stepped, 2, first, first + 4).max() < 1e-6
    stepped.ok("undo now")
    stepped.run(2.0)
    assert beats(stepped, 2, first + 5, first + 8).min() > 1e-6
    same_again(stepped)


@pytest.mark.parametrize(("line", "ratio"), [("gain d2 x0.5", 0.5), ("gain d2 -20dB", 0.1)])
def test_gain_strikes_scales_impulses(stepped: Stepped, line: str, ratio: float):
    stepped.ok(f"{line} at 3|1")
    stepped.run(4.0)
    before, after = beats(stepped, 2, 2, 7), beats(stepped, 2, 9, 12)
    assert after.mean() == pytest.approx(ratio * before.mean(), rel=1e-3)
    same_again(stepped)


def test_gain_strikes_of_a_mass_and_a_rain(stepped: Stepped):
    stepped.ok("d1 strikes low.m every 1 mass 1g speed 1m/s at 3|1")
    stepped.ok("d2 strikes high.m rate 20Hz impulse 1mNs at 3|1")
    stepped.ok("gain d1 x0\ngain d2 x0\nmute ada at 5|1")
    stepped.run(8.0)
    assert beats(stepped, 1, 17, 20).max() < 1e-6
    assert beats(stepped, 2, 17, 20).max() < 1e-6
    assert beats(stepped, 1, 9, 16).max() > 1e-6
    same_again(stepped)


def test_mute_strikes_applies_to_redefined_strikes(stepped: Stepped):
    stepped.ok("mute d2 at 3|1")
    stepped.ok("d2 strikes high.m every 1 impulse 2mNs at 4|1")
    stepped.run(6.0)
    assert beats(stepped, 2, 13, 16).max() < 1e-6
    assert any(row.endswith(", muted") for row in stepped.ok("voices").lines)
    stepped.ok("unmute d2-2 now")
    stepped.run(2.0)
    assert np.abs(stepped.sound[-int(stepped.rate) :, 1]).max() > 1e-6
    same_again(stepped)


@pytest.mark.parametrize("ended", ["unmute", "unmute d1", "solo high"])
def test_solo_strikes_silences_strikes_and_players(stepped: Stepped, ended: str):
    stepped.ok("solo d1 at 3|1")
    stepped.ok(f"{ended} at 6|1")
    stepped.run(12.0)
    assert beats(stepped, 1, 9, 20).max() > 1e-6
    assert beats(stepped, 2, 9, 19).max() < 1e-6
    assert beats(stepped, 3, 9, 19).max() < 1e-9
    assert beats(stepped, 2, 21, 26).min() > 1e-6
    same_again(stepped)


def test_solo_strikes_is_resumed_and_undone(stepped: Stepped):
    stepped.ok("solo d1 now")
    stepped.ok("gain d2 x0.5 now")
    stepped.run(1.0)
    stepped.close()
    with closing(Stepped.resumed(stepped.journal)) as again:
        levels = again.session.schedule.head.strike_levels
        assert (dict(levels.gains), levels.solo) == ({"d2": 0.5}, {"d1"})
        again.ok("play")
        again.run(2.0)
        assert np.abs(again.sound[:, 1]).max() < 1e-6
        again.ok("back 2")
        again.run(2.0)
        assert not again.session.schedule.head.strike_levels
        again.close()
        assert np.array_equal(again.again(), again.sound)


def test_level_of_unknown_strikes(stepped: Stepped):
    stepped.ok("rain strikes low.m every 1 impulse 1mNs")
    for verb in ("mute", "solo", "unmute"):
        assert stepped.type(f"{verb} rian").try_ == f"{verb} rain"
    reply = stepped.type("mute xyz")
    assert "'xyz' is not an instrument, a player or the name of strikes" in reply.text
    assert "a level is missing" in stepped.type("gain d1").text
    stepped.ok("remove d1\nmute d2")
    assert not stepped.type("unmute d1").taken


def test_level_of_strikes_with_the_name_of_an_instrument(stepped: Stepped):
    stepped.ok("low notes A3 every 1 at 3|1")
    stepped.ok("mute low at 4|1")
    stepped.run(4.0)
    assert not stepped.session.schedule.head.strike_levels
    assert "low" in stepped.session.schedule.head.faders.muted
    stepped.ok("gain low -6dB")
    assert "low (instrument): muted, -6 dB" in stepped.ok("voices").lines
