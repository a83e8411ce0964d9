"""Bowed notes in a session: a bow stops wherever its note ends, however that comes."""

from contextlib import closing

import numpy as np
import pytest
from sessions import Stepped

from ergon.live.midi_ports import ProcessPort

# The weight is pushed by F alone: its place says how hard it is pressed.
SCORE = """\
ergon: 1
rates: {audio: 8kHz}
tempo: {bpm: 240}
instruments:
  scales:
    modules: {m: {CEL: {M: 100g, K: 100N/m, Z: 8Ns/m}}}
    out: {SOX: m}
    play:
      lean:
        press: weight 0.2N..2N
        with: {floor: {SOL: {}}, weight: {LNL: {between: [floor, m], law: 0*d - F}}}
      press: {press: weight 0.1N..1N}
mix: {channels: 1, route: [{from: scales, to: 1}], master: {reference: SI}}
"""
K = 100.0  # N/m


def pressed(session: Stepped, seconds: float = 0.5) -> float:
    """How hard the weight is pressed after some seconds [N]."""
    session.run(seconds)
    return float(session.sound[-1, 0]) * K


@pytest.fixture
def session(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        stepped.ok("play")
        stepped.ok('d1 = "scales:1/8"')  # two bars of eight sound, each a second
        yield stepped


def check_replay(session: Stepped) -> None:
    session.close()
    assert np.array_equal(session.again(), session.sound)


def test_note_lasts_and_ends(session):
    assert pressed(session, 2.5) == pytest.approx(2.0, rel=2e-2)
    assert pressed(session, 5.0) == pytest.approx(2.0, rel=2e-2)
    session.ok("rest d1")
    assert pressed(session, 3.0) == pytest.approx(0.0, abs=2e-2)
    check_replay(session)


@pytest.mark.parametrize("line", ["mute d1 now", "stop now", "hush now", "undo", "remove d1 now"])
def test_note_in_flight_ends_with_line(session, line):
    assert pressed(session, 2.5) == pytest.approx(2.0, rel=2e-2)
    session.ok(line)
    assert pressed(session, 2.2) == pytest.approx(0.0, abs=2e-2)
    check_replay(session)


def test_gain_acts_on_note_in_flight(session):
    pressed(session, 2.5)
    session.ok("gain d1 x0.5 now")
    assert pressed(session) == pytest.approx(1.0, rel=2e-2)
    session.ok("gain d1 x0.25 now")
    session.ok('d2 = "~ scales.press:0"')
    session.ok("unmute d1")
    assert pressed(session) == pytest.approx(0.5, rel=2e-2)
    session.ok("rest d1")
    session.ok("rest d2")
    assert pressed(session, 6.0) == pytest.approx(0.0, abs=2e-2)
    check_replay(session)


def test_panic_leaves_nothing_pressed(session):
    pressed(session, 2.5)
    session.ok("panic")
    session.run(0.3)
    session.ok("release")
    assert pressed(session) == pytest.approx(0.0, abs=2e-2)
    session.ok("play")
    session.ok('d1 = "scales:1/8"')
    assert pressed(session, 3.0) == pytest.approx(2.0, rel=2e-2)
    check_replay(session)


def test_keyboard_holds_and_presses(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        port = ProcessPort(lambda: 0.0)
        port.listen(stepped.session.midi.receive)
        stepped.ok("map note C4..C5 scales now")
        stepped.run(0.5)
        expected = [
            ([0x90, 60, 127], 2.0),
            ([0xD0, 127], 3.0),  # of the channel
            ([0xA0, 60, 1], 2.0 + 0.1 * 10.0 ** (1 / 127)),  # of the key
            ([0xD1, 127], 2.0 + 0.1 * 10.0 ** (1 / 127)),  # of another channel
            ([0xD0, 0], 2.0),
            ([0xD0, 64], 2.0 + 0.1 * 10.0 ** (64 / 127)),
            ([0x80, 60, 0], 0.0),
            ([0xD0, 127], 0.0),  # nothing sounds
        ]
        for data, force in expected:
            port.send(bytes(data))
            assert pressed(stepped) == pytest.approx(force, rel=2e-2, abs=2e-2)
        check_replay(stepped)


def test_note_off_after_panic_leaves_nothing_pressed(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        port = ProcessPort(lambda: 0.0)
        port.listen(stepped.session.midi.receive)
        stepped.ok("map note C4..C5 scales now")
        stepped.run(0.5)
        port.send(bytes([0x90, 60, 127]))
        assert pressed(stepped) == pytest.approx(2.0, rel=2e-2)
        stepped.ok("panic")
        stepped.run(0.3)
        port.send(bytes([0x80, 60, 0]))
        stepped.ok("release")
        assert pressed(stepped) == pytest.approx(0.0, abs=2e-2)
        port.send(bytes([0x90, 60, 127]))
        assert pressed(stepped) == pytest.approx(2.0, rel=2e-2)
        check_replay(stepped)


@pytest.mark.parametrize("line", ["panic", ""])
def test_hear_of_drawn_note_lasts_a_second(tmp_path, line):
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        stepped.ok("hear scales 1")
        assert pressed(stepped, 0.8) == pytest.approx(2.0, rel=2e-2)
        if line:
            stepped.ok(line)
            stepped.run(0.1)
            stepped.ok("release")
        assert pressed(stepped, 1.0) == pytest.approx(0.0, abs=2e-2)
        check_replay(stepped)
