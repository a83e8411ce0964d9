"""A MIDI keyboard with its pedal plays three tuned instruments of the library."""

from __future__ import annotations

import importlib.util
import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import mido
import numpy as np
import pytest
from sessions import Stepped
from sweep import few

from ergon.live.midi_ports import ProcessPort, SystemInput, SystemOutput

SCORE = """\
ergon: 1
use: [instruments/strings.yaml, instruments/bars.yaml, instruments/friction.yaml]
instruments:
  low: {from: strings/piano, notes: [C2, E2]}
  high: {from: bars/vibraphone, notes: [C5, E5]}
  middle: {from: friction/viol, notes: [D3, F3]}
mix:
  channels: 3
  route:
    - {from: low, to: 1, level: -20LUFS}
    - {from: high, to: 2, level: -20LUFS}
    - {from: middle, to: 3, level: -20LUFS}
"""
MAPS = ("map note C2..E2 low now", "map note C5..E5 high now", "map note D3..F3 middle now")
HERTZ = {36: 65.406, 40: 82.407, 72: 523.251, 76: 659.255, 50: 146.832, 53: 174.614}
CHANNELS = {"low": 0, "high": 1, "middle": 2}
PEDAL = 64


class Player:
    """Hands at a keyboard: what they play reaches a session as from hardware, by a virtual port
    of the system's sequencer where there is one, else by a port inside this process.
    """

    def __init__(self, session: Stepped) -> None:
        self._session = session
        self._n_sent = self._n_received = 0
        self._close: Callable[[], None]
        self._send: Callable[[bytes], None]
        if Path("/dev/snd/seq").exists() and importlib.util.find_spec("supriya_midi") is not None:
            self._open_virtual()
        else:
            port = ProcessPort()
            port.listen(self._receive)
            self._send, self._close = port.send, port.close

    def _open_virtual(self) -> None:
        source = SystemInput("virtual")
        source.listen(self._receive)
        keyboard = SystemOutput("ergon")
        self._send = keyboard.send

        def close() -> None:
            keyboard.close()
            source.close()

        self._close = close

    def _receive(self, data: bytes, at: float) -> None:
        self._n_received += 1
        self._session.session.midi.receive(data, at)

    def play(self, message: mido.Message, seconds: float) -> None:
        """Send a message, and let time pass."""
        self._send(bytes(message.bytes()))
        self._n_sent += 1
        while self._n_received < self._n_sent:
            time.sleep(0.001)
        self._session.run(seconds)

    def close(self) -> None:
        self._close()


def key(number: int, velocity: int) -> mido.Message:
    return mido.Message("note_on", note=number, velocity=velocity)


def pedal(value: int) -> mido.Message:
    return mido.Message("control_change", control=PEDAL, value=value)


@pytest.fixture
def session(tmp_path) -> Iterator[Stepped]:
    with closing(Stepped(SCORE, tmp_path)) as stepped:
        for line in MAPS:
            stepped.ok(line)
        stepped.run(0.3)
        yield stepped


@pytest.fixture
def player(session) -> Iterator[Player]:
    with closing(Player(session)) as hands:
        yield hands


def level(session: Stepped, channel: int) -> float:
    """Of the last twentieth of a second [dB]."""
    last = session.sound[-round(0.05 * session.rate) :, channel]
    return float(10.0 * np.log10((last**2).mean() + 1e-30))


def cents_off(session: Stepped, channel: int, hertz: float) -> float:
    """How far the partial nearest to a frequency is from it, in the last half second."""
    sound = session.sound[-round(0.5 * session.rate) :, channel]
    spectrum = np.abs(np.fft.rfft(sound * np.hanning(len(sound)), 1 << 19))
    first, last = (round(hertz * ratio * (1 << 19) / session.rate) for ratio in (0.96, 1.04))
    peak = (first + int(np.argmax(spectrum[first:last]))) * session.rate / (1 << 19)
    return 1200.0 * float(np.log2(peak / hertz))


def test_keyboard_plays_three_tuned_instruments_with_pedal(session, player):
    for name, low, high in (("low", 36, 40), ("high", 72, 76), ("middle", 50, 53)):
        channel = CHANNELS[name]
        for number in (low, high):
            player.play(key(number, 90), 0.6)
            assert abs(cents_off(session, channel, HERTZ[number])) < 12.0
            sounding = level(session, channel)
            player.play(key(number, 0), 0.6)
            assert level(session, channel) < sounding - 20.0  # its key is up
        player.play(pedal(127), 0.05)
        player.play(key(low, 90), 0.4)
        sounding = level(session, channel)
        player.play(key(low, 0), 0.4)
        assert level(session, channel) > sounding - 15.0  # the pedal holds it
        player.play(pedal(0), 0.6)
        assert level(session, channel) < sounding - 20.0
    session.close()
    assert np.array_equal(session.again(), session.sound)
    rows = [json.loads(line) for line in session.journal.read_text().splitlines()]
    struck = {row["part"].partition(".")[0] for row in rows if row["event"] == "strike"}
    assert struck == set(CHANNELS)


@pytest.mark.parametrize("name", few(CHANNELS, ["middle"]))
def test_harder_keys_are_louder(session, player, name):
    number = {"low": 36, "high": 72, "middle": 50}[name]
    levels = []
    for velocity in (18, 73, 109):  # pp, mf and ff
        player.play(key(number, velocity), 0.5)
        levels.append(level(session, CHANNELS[name]))
        player.play(key(number, 0), 0.8)
    assert levels[0] + 5.0 < levels[1]
    assert levels[1] + 2.0 < levels[2]
    session.close()
    assert np.array_equal(session.again(), session.sound)
