"""MIDI clock of a session, told and followed; all of it in virtual time."""

import json
import random
import subprocess
import sys
import time

import numpy as np
import pytest
from sessions import Stepped
from sweep import few

from ergon.live.clock_follower import ClockFollower
from ergon.live.midi_messages import Transport, encode_song_position, parse_message
from ergon.live.midi_ports import ArrivalStamps, MidiError, choose_port
from ergon.live.midi_sender import ECHO, TimedSender
from ergon.repl.session.midi_clock import ClockEvents, ClockIn
from tests.repl.test_repl_session import SCORE

STEP = 0.01  # [s] between two looks
SCORE = SCORE.replace("rates: {audio: 8kHz}\n", "")  # ticks of 1.5 ms, as where one plays


def test_clock_output_of_24_pulses_per_beat(tmp_path):
    player_session = Stepped(SCORE, tmp_path)
    events = ClockEvents(player_session.session.schedule)
    output: list[tuple[int, bytes]] = []

    def go(seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            player_session.run(STEP)
            output.extend(events.pop_before(player_session.engine.frame))

    go(0.1)
    player_session.ok("play")
    go(2.0)
    player_session.ok("tempo 240 now")
    go(0.7)
    player_session.ok("tempo 90 -> 200 over 4 now")
    go(2.0)
    running = player_session.session.schedule.running
    clock, tempo = running.clock, running.version.piece.tempo_map
    wanted = [round(clock.seconds(tempo, n / 24) * player_session.rate) for n in range(200)]
    assert output[0][1] == bytes([0xFA])
    clocks = [frame for frame, data in output if data == bytes([0xF8])]
    assert len(clocks) > 150
    assert max(abs(a - b) for a, b in zip(clocks, wanted, strict=False)) <= 1  # frames
    player_session.ok("stop")
    go(0.2)
    n = len(output)
    assert output[-1][1] == bytes([0xFC])
    player_session.ok("play from 9|2.1")
    go(1.0)
    assert output[n][1] == encode_song_position(33.25)  # the next sixteenth
    assert output[n + 1][1] == bytes([0xFB])
    running = player_session.session.schedule.running
    first = running.clock.seconds(running.version.piece.tempo_map, 33.25)
    assert output[n + 2] == (pytest.approx(first * player_session.rate, abs=1), bytes([0xF8]))
    player_session.close()


class Master:
    """Another program that plays: its tempo may wander, and its messages come late."""

    def __init__(self, bpm, *, jitter=0.0, stall=0.0, seed=1):
        self._chance = random.Random(seed)
        self._bpm, self._jitter, self._stall = bpm, jitter, stall
        self._stalls_until = 0.0
        self.beats: list[float] = []  # the true instants of its beats
        self._beat_time, self._number = 0.0, 0
        self.messages: list[tuple[float, bytes]] = []

    def begin(self, time, *, start=True):
        self._beat_time = time
        if start:
            self.messages.append((time - 0.001, bytes([0xFA])))

    def until(self, now):
        """The messages that have come by an instant."""
        while self._beat_time <= now + 0.1:
            if self._number % 24 == 0:
                self.beats.append(self._beat_time)
            come = self._beat_time + abs(self._chance.gauss(0.0, self._jitter))
            if self._chance.random() < 0.02:  # nothing comes for a while, then all at once
                self._stalls_until = come + self._chance.uniform(0.0, self._stall)
            self.messages.append((max(come, self._stalls_until), bytes([0xF8])))
            bpm = self._bpm(self._number / 24) if callable(self._bpm) else self._bpm
            self._beat_time += 60.0 / bpm / 24
            self._number += 1
        self.messages.sort(key=lambda one: one[0])
        come = [one for one in self.messages if one[0] <= now]
        self.messages = self.messages[len(come) :]
        return come


def followed(stepped, master, seconds, *, latency=0.03, since=0.2, start=True):
    """Let a session follow a master; (errors of each beat [s], number of tempo lines)."""
    began = 50.0  # of the clock that both go by

    def when(frame):
        return began + latency + frame / stepped.rate

    clock = ClockIn(stepped.session, when)
    master.begin(began + since, start=start)
    for step in range(round(seconds / STEP)):
        now = began + step * STEP
        for position, data in master.until(now):
            clock.receive(data, position)
        clock.follow(now)
        stepped.run(STEP)
    running = stepped.session.schedule.running
    tempo = running.version.piece.tempo_map
    by = running.clock
    errors = np.array(
        [
            when(by.seconds(tempo, n) * stepped.rate) - position
            for n, position in enumerate(master.beats)
        ]
    )
    rows = map(json.loads, stepped.journal.read_text().splitlines())
    lines = [row["line"] for row in rows if row["event"] == "line"]
    return errors, [line for line in lines if line.startswith("tempo ")]


@pytest.mark.parametrize(
    ("bpm", "jitter"),
    few(
        [(120.0, 0.0), (97.3, 0.0), (174.0, 0.001), (120.003, 0.0005)],
        [(97.3, 0.0)],
    ),
)
def test_clock_follower_error_within_a_millisecond(tmp_path, bpm, jitter):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    errors, lines = followed(player_session, Master(bpm, jitter=jitter), 30.0)
    assert player_session.session.schedule.running.clock.is_running
    settled = errors[16 : round(28.0 * bpm / 60)]
    assert len(settled) > 20
    # Messages that come late by chance are late on average, too.
    assert np.abs(settled - 0.8 * jitter).max() < 1e-3
    assert len(lines) < (16 if jitter == 0.0 else 70)
    numbers = player_session.ok("history").lines
    assert len(numbers) <= 3  # play, and all corrections as one
    player_session.close()
    assert player_session.hash_again() == player_session.hash.hexdigest()


@pytest.mark.parametrize("seed", few(range(4), [0]))
def test_clock_follower_with_late_bursts(tmp_path, seed):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    master = Master(123.4, jitter=0.0003, stall=0.08, seed=seed)
    errors, _ = followed(player_session, master, 30.0)
    settled = errors[16 : round(28.0 * 123.4 / 60)]
    assert len(settled) > 20
    assert np.abs(settled).max() < 1e-3
    player_session.close()


def test_clock_follower_after_tempo_jump(tmp_path):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    errors, _ = followed(player_session, Master(lambda beat: 120.0 if beat < 24 else 131.0), 24.0)
    assert np.abs(errors[12:24]).max() < 1e-3
    assert np.abs(errors[34:46]).max() < 1e-3
    player_session.close()


def test_clock_follower_during_tempo_ramp(tmp_path):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    errors, _ = followed(player_session, Master(lambda beat: 110.0 + min(beat, 40.0) * 0.25), 36.0)
    assert np.abs(errors[16:40]).max() < 0.02
    assert np.abs(errors[56:60]).max() < 1e-3
    player_session.close()


def test_clock_follower_without_start_takes_tempo_only(tmp_path):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    player_session.ok("play")
    player_session.run(0.5)
    _, lines = followed(player_session, Master(150.0), 8.0, start=False)
    assert lines
    assert player_session.session.state().tempo == pytest.approx(150.0, abs=0.01)
    player_session.close()


def test_clock_follower_with_stop_and_continue(tmp_path):
    player_session = Stepped(SCORE, tmp_path, keeps=False)
    clock = ClockIn(player_session.session, lambda frame: frame / player_session.rate)
    for data, wanted in (
        ([0xFA], True),
        ([0xFC], False),
        ([0xFC], False),
        ([*encode_song_position(9.0)], False),
        ([0xFB], True),
    ):
        clock.receive(bytes(data), 0.0)
        clock.follow(0.0)
        player_session.run(0.1)
        assert player_session.session.schedule.running.clock.is_running is wanted
    assert player_session.where.startswith("3|2")
    assert player_session.session.messages() == []
    player_session.close()


def test_clock_follower_estimate_without_valid_clock():
    follower = ClockFollower()
    assert follower.estimate() is None
    for n in range(30):
        follower.receive(Transport.CLOCK, 1e-4 * n)  # 25,000 bpm
    assert follower.estimate() is None
    assert not follower.is_receiving(2.0)
    for n in range(30):
        follower.receive(Transport.CLOCK, 5.0 + n / 48)
    result = follower.estimate()
    assert result is not None
    assert result.beat_length == pytest.approx(0.5)
    assert follower.is_receiving(5.9)
    follower.receive(Transport.CLOCK, 4.0)  # a clock that goes back
    assert follower.estimate() is None


def test_parse_message_of_every_length():
    assert parse_message(b"") is None
    assert parse_message(bytes([0xF8])) is Transport.CLOCK
    assert parse_message(bytes([0xF8, 0])) is None
    assert parse_message(bytes([0xF2, 8, 1])).clocks == (8 + 128) * 6
    assert parse_message(encode_song_position(1e9)).clocks == 0x3FFF * 6


def test_timed_sender_order_and_times():
    sender = TimedSender(ECHO)
    now = time.monotonic()
    for after, data in (
        (0.06, b"\xf8"),
        (-5.0, b"\xfa"),
        (0.03, b"\xf2\x08\x00"),
        (3600.0, b"\xfb"),
    ):
        sender.send_at(data, now + after)
    output = [sender.next_echo().split() for _ in range(3)]
    assert [data for _, data in output] == [b"fa", b"f20800", b"f8"]
    assert int(output[1][0]) / 1e9 >= now + 0.03 - 1e-6
    assert int(output[2][0]) / 1e9 >= now + 0.06 - 1e-6
    sender.close()
    assert sender.next_echo() == b""


def test_midi_sender_sends_stop_at_end_of_input():
    sender = subprocess.Popen(
        [sys.executable, "-m", "ergon.live.midi_sender", ECHO],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    out, _ = sender.communicate(b"0 f8\n")  # the session is gone
    assert [line.split()[1] for line in out.splitlines()[1:]] == [b"f8", b"fc"]


def test_timed_sender_with_unknown_port():
    with pytest.raises(MidiError, match="MIDI"):
        TimedSender("no such port")


def test_midi_stamps_of_system_despite_late_thread():
    chance, stamps = random.Random(3), ArrivalStamps()
    result = []
    for n in range(200):
        true = 100.0 + n * 0.0208
        late = 0.0 if n % 20 == 0 else chance.uniform(0.0, 0.015)
        result.append(stamps.stamp(0.0 if n == 0 else 0.0208, true + late) - true)
    assert max(map(abs, result[20:])) < 1e-9
    assert stamps.stamp(0.0208, 500.0) == 500.0  # after a pause of minutes


def test_choose_port_by_part_of_name():
    names = ["Midi Through:Port-0", "nanoKONTROL2 MIDI 1", "nanoKEY2 MIDI 1"]
    assert choose_port("kontrol", names, "input") == 1
    assert choose_port("Midi Through:Port-0", names, "input") == 0
    with pytest.raises(MidiError, match="2 MIDI inputs are called so"):
        choose_port("nano", names, "input")
    with pytest.raises(MidiError, match="no MIDI output is called 'x'; there are 'Midi"):
        choose_port("x", names, "output")
    with pytest.raises(MidiError, match="there is none; `virtual`"):
        choose_port("x", [], "output")
