"""MPE at the prompt: the wheel, pressure and controllers of a channel move the note it plays."""

from __future__ import annotations

import math
from contextlib import closing

import numpy as np
import pytest
from sessions import Stepped

from ergon.live.midi_ports import ProcessPort

SCORE = """\
ergon: 1
rates: {audio: 8kHz}
instruments:
  bar:
    CEL: {M: 1g, f: A4, t60: 4s}
    notes: C4..C5
    play: {strike: {impulse: 1mNs..4mNs}}
    out: {SOX: bar}
mix: {channels: 2, route: [{from: bar.C4, to: 1}, {from: bar.G4, to: 2}]}
"""
MAPS = ("map note C4..C5 bar now", "map bend bar.transpose -2st..2st now")


def control(channel: int, number: int, value: int) -> bytes:
    return bytes([0xB0 | channel - 1, number, value])


def registered(channel: int, parameter: int, value: int) -> list[bytes]:
    pairs = (101, 0), (100, parameter), (6, value)
    return [control(channel, number, own) for number, own in pairs]


def zone(n_channels: int, master: int = 1) -> list[bytes]:
    return registered(master, 6, n_channels)


def note(channel: int, number: int, velocity: int = 100) -> bytes:
    return bytes([0x90 | channel - 1, number, velocity])


def wheel(channel: int, value: int) -> bytes:
    """From -8192 to 8191."""
    return bytes([0xE0 | channel - 1, value + 8192 & 0x7F, value + 8192 >> 7])


def pressure(channel: int, value: int) -> bytes:
    return bytes([0xD0 | channel - 1, value])


def played_cents(session: Stepped, side: int, number: int) -> float:
    """How far what sounded last on a channel lies from a note."""
    sound = session.sound[-4096:, side]
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)), 1 << 18))
    frequency = np.argmax(spectrum) * session.rate / (1 << 18)
    return 1200.0 * math.log2(frequency / 440.0) - 100.0 * (number - 69)


def value(session: Stepped, part: str, name: str) -> float:
    module = session.session.schedule.head.piece.instruments[part].modules[0]
    return module.fields[name]


@pytest.fixture
def keyboard(tmp_path):
    with closing(Stepped(SCORE, tmp_path)) as session:
        port = ProcessPort(lambda: 0.0)
        port.listen(session.session.midi.receive)
        for line in MAPS:
            session.ok(line)
        session.run(0.2)
        session.ok("play now")
        session.run(0.2)

        def send(*messages: bytes, seconds: float = 0.7) -> None:
            for message in messages:
                port.send(message)
                session.tick()
                session.run(0.12)  # its line has taken effect before the next one comes
            session.run(seconds)

        yield session, send


def check_journal(session: Stepped) -> None:
    session.close()
    again = session.again()
    assert session.sound[: len(again)].tobytes() == again.tobytes()


def test_zone_bends_each_note_by_itself(keyboard):
    session, send = keyboard
    send(*zone(5), note(2, 60), note(3, 67), wheel(2, 1024))  # an eighth of 48 semitones
    assert played_cents(session, 0, 60) == pytest.approx(600.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(0.0, abs=4.0)
    send(wheel(1, 4096))  # half of the master's two semitones, for both
    assert played_cents(session, 0, 60) == pytest.approx(700.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(100.0, abs=4.0)
    send(wheel(1, 0), wheel(3, -2048), seconds=0.7)
    assert played_cents(session, 0, 60) == pytest.approx(600.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(-1200.0, abs=4.0)
    check_journal(session)


def test_registered_parameter_says_the_range_of_a_zone(keyboard):
    session, send = keyboard
    send(*zone(5), *registered(2, 0, 24), note(2, 60), note(4, 67), wheel(4, 2048))
    assert played_cents(session, 1, 67) == pytest.approx(600.0, abs=4.0)
    assert played_cents(session, 0, 60) == pytest.approx(0.0, abs=4.0)


def test_next_note_of_a_channel_has_its_values(keyboard):
    session, send = keyboard
    session.ok("map pressure bar.t60 1s..3s now")
    session.run(0.2)
    send(*zone(5), wheel(2, 1024), pressure(2, 127), note(2, 60))
    assert played_cents(session, 0, 60) == pytest.approx(600.0, abs=4.0)
    assert value(session, "bar.C4", "t60") == pytest.approx(3.0)
    send(note(2, 67), wheel(2, 0))  # the channel has another note now
    assert played_cents(session, 0, 60) == pytest.approx(600.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(0.0, abs=4.0)
    send(note(3, 60))  # the note on another channel, whose wheel stands in the middle
    assert played_cents(session, 0, 60) == pytest.approx(0.0, abs=4.0)
    check_journal(session)


def test_pressure_and_controllers_act_on_the_note(keyboard):
    session, send = keyboard
    session.ok("map pressure bar.t60 1s..3s now")
    session.ok("map cc 74 bar.M 1g..2g now")
    session.run(0.2)
    send(*zone(5), note(2, 60), note(3, 67), pressure(2, 127), pressure(3, 0), control(2, 74, 127))
    assert value(session, "bar.C4", "t60") == pytest.approx(3.0)
    assert value(session, "bar.G4", "t60") == pytest.approx(1.0)
    assert value(session, "bar.C4", "M") == pytest.approx(2e-3)
    assert value(session, "bar.G4", "M") == pytest.approx(1e-3)
    check_journal(session)


def test_without_a_zone_a_channel_moves_all_notes(keyboard):
    session, send = keyboard
    send(note(2, 60), note(3, 67), wheel(2, 8191))
    assert played_cents(session, 0, 60) == pytest.approx(200.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(200.0, abs=4.0)
    send(*zone(5), *zone(0), wheel(2, 0))  # a zone that has ended
    assert played_cents(session, 0, 60) == pytest.approx(0.0, abs=4.0)
    assert played_cents(session, 1, 67) == pytest.approx(0.0, abs=4.0)


@pytest.mark.parametrize(
    "matter",
    [
        "CEL: {M: 1g, f: A4, t60: 4s}",
        "f: A4\n    modules: {a: {CEL: {M: 1g, f: A4, t60: 4s}}, b: {CEL: {M: 9g, f: 3kHz}}}",
    ],
)
def test_transpose_moves_all_notes_of_a_zone(tmp_path, matter):
    text = SCORE.replace("CEL: {M: 1g, f: A4, t60: 4s}", matter)
    if "modules" in matter:
        text = text.replace("{SOX: bar}", "{SOX: a}").replace("strike: {", "strike: {at: a, ")
    with closing(Stepped(text, tmp_path)) as session:
        session.ok("map note C4..C5 bar now")
        session.ok("set bar.G4.transpose 100cents now")
        session.ok("set bar.transpose -300cents now")
        session.run(0.2)
        for number in (60, 67):
            session.session.midi.receive(note(2, number), 0.0)
            session.run(0.6)
        assert played_cents(session, 0, 60) == pytest.approx(-300.0, abs=4.0)
        assert played_cents(session, 1, 67) == pytest.approx(-200.0, abs=4.0)
        session.ok("set bar.G4.transpose 0cents over 50ms now")
        session.run(0.8)
        assert played_cents(session, 1, 67) == pytest.approx(-300.0, abs=4.0)
        check_journal(session)


def test_map_pressure_to_gain_in_zone(keyboard):
    session, send = keyboard
    session.ok("map pressure gain bar -40dB..0dB now")
    session.run(0.2)
    send(*zone(5), note(2, 60), pressure(2, 0))
    assert any("gain bar -40dB" in line for line in session.ok("history").lines)
