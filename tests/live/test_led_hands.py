"""Keys that are played without a device: by OSC and MIDI, through a finger, into takes."""

import os
import socket
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from duets import command_output, recorded, rendered, sound
from patience import until
from scipy.integrate import solve_ivp

from ergon import _core
from ergon.api.errors import OptionError
from ergon.api.open_session import open_session
from ergon.api.options import PlayOptions, SessionOptions
from ergon.api.play import PreparedPlay, begin, prepare
from ergon.common.report import Report
from ergon.live.boards import BoardError, boards
from ergon.live.datagrams import encode_message
from ergon.live.midi_ports import ProcessPort
from ergon.live.pointer_address import Finger, parse_pointer_address
from ergon.live.pointer_gamepad import GamepadAxis, GamepadPort, stick_events
from ergon.live.pointer_sources import MidiPositionReceiver, OscPositionReceiver

SCORE = """\
ergon: 1
accuracy: {method: ca}
keys:
  k: {M: 50g, K: 0N/m, Z: 1Ns/m}
  l: {M: 50g, K: 0N/m, Z: 1Ns/m}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}}
      b: {BUT: {between: [k, m], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}
      c: {BUT: {between: [l, m], K: 200N/m, Z: 0.1Ns/m, gap: 1mm}}
    out: {SOX: m}
gestures: {knock: 0mm@0 smooth 4mm@1/8 0mm@1/2}
players: {remi: {hand: live, key: k}, ada: {hand: live, key: l}}
parts: {remi: [{at: 3.5s, play: knock}]}
mix: {master: {gain: 60dB}, route: [{from: bell, to: 1, highpass: 20Hz}]}
render: {tail: 500ms}
"""
TICK = 44 / 44100  # [s]
TRAVEL = 0.1  # [m]
KEY = (0.05, 1.0)  # mass [kg] and damping [N·s/m] of the key
PULP = (2000.0, 2.0)  # spring [N/m] and damper [N·s/m] of the fingertip
DELAY = 0.02  # [s]

# Shares of the travel that 14 bits can say, and when.
TIMES = np.arange(0.0, 3.4, 0.008)
VALUES = np.round(0x2000 + 0x2000 * 0.12 * np.sin(2 * np.pi * 1.7 * TIMES) ** 3).astype(int)
SHARES = np.where(VALUES < 0x2000, VALUES / 0x4000, 0.5 + 0.5 * (VALUES - 0x2000) / 0x1FFF)


class NotedLead:
    """A lead that notes where a pointer was."""

    range = (-0.5 * TRAVEL, 0.5 * TRAVEL)

    def __init__(self) -> None:
        self.placed: list[float] = []
        self.is_present = True

    def now(self) -> float:
        return 0.0

    def place(self, _time: float, x: float, _firmness: float = 1.0) -> bool:
        self.placed.append(x)
        return True

    def set_present(self, present: bool) -> None:
        self.is_present = present


@dataclass
class Played:
    positions: np.ndarray
    forces: np.ndarray  # sent to the key
    sound: np.ndarray
    take: Path
    sentences: list[str]


def led(
    url: str, feed: Callable[[PreparedPlay], None], name: str = "h", score: str = SCORE
) -> Played:
    """What a piece is if a hand plays it by a source in lockstep."""
    Path("s.yaml").write_text(score)
    take, target = Path(f"{name}.take"), Path(f"{name}.wav")
    options = PlayOptions(
        live=[f"remi={url}"], record=str(take), gain="0dB", audio=f"file:{target}"
    )
    ready = prepare("s.yaml", options, Report())
    feed(ready)
    performance = begin(ready.stage, ready.config, Report())
    while not performance.wait(0.05):
        pass
    performance.close(10.0)
    sentences = list(ready.hands.summaries())
    ready.close()
    recording = recorded(take)
    return Played(
        recording.positions()[:, 0],
        recording.sent()[:, 0].astype(float),
        sound(target),
        take,
        sentences,
    )


def lead_of(ready: PreparedPlay) -> _core.Lead:
    (board,) = ready.hands.boards
    assert board.pointer is not None
    return board.pointer


def by_osc(
    ready: PreparedPlay, shares: np.ndarray = SHARES, times: Iterable[float] = TIMES
) -> None:
    values = OscPositionReceiver(parse_pointer_address("osc:/x?lockstep"), lead_of(ready))
    for time, share in zip(times, shares, strict=True):
        values.receive([2.0 * (share - 0.5)], time)


def by_bend(
    ready: PreparedPlay, wheel: np.ndarray = VALUES, times: Iterable[float] = TIMES
) -> None:
    values = MidiPositionReceiver(parse_pointer_address("midi:bend?lockstep"), lead_of(ready))
    port = ProcessPort()
    port.listen(values.receive)
    for time, value in zip(times, wheel, strict=True):
        port.deliver(bytes([0xE0, value & 0x7F, value >> 7]), time)


def by_pad(ready: PreparedPlay, data: bytes, steps: int) -> None:
    """Through the port of a gamepad, from a pipe of its events; its stick has so many steps."""
    os.mkfifo("pad")
    values = GamepadAxis(parse_pointer_address("gamepad:ly?lockstep"), lead_of(ready))
    writer = os.open("pad", os.O_RDWR)
    port = GamepadPort(Path("pad"), [values])
    values.range = (0, steps)
    os.write(writer, data)
    n_rows = len(list(stick_events(data)))
    until(lambda: lead_of(ready).tally["taken"] == n_rows, "all positions of the pad")
    port.close()
    os.close(writer)


def test_led_take_by_osc_midi_and_evdev(work_folder: Path):
    """In the lower half of a wheel, its steps are those of a stick with 16,384 steps."""
    wheel = np.minimum(VALUES, 0x4000 - VALUES)
    data = b"".join(
        struct.pack("llHHi", int(t), round(1e6 * (t % 1.0)), 3, 1, 0x4000 - value)
        for t, value in zip(TIMES, wheel, strict=True)
    )
    instants = [instant for *_, instant in stick_events(data)]
    score = SCORE.replace("[k, m]", "[m, k]").replace("[l, m]", "[m, l]")
    pad = led("gamepad:ly?lockstep", lambda it: by_pad(it, data, 0x4000), "pad-hand", score)
    osc = led("osc:/x?lockstep", lambda it: by_osc(it, wheel / 0x4000, instants), "osc", score)
    midi = led("midi:bend?lockstep", lambda it: by_bend(it, wheel, instants), "midi", score)
    assert np.ptp(pad.positions) > 3e-3
    assert np.abs(pad.forces).max() > 0.02
    for by_other in (osc, midi):
        assert np.array_equal(pad.positions, by_other.positions)
        assert np.array_equal(pad.forces, by_other.forces)
        assert np.array_equal(pad.sound, by_other.sound)


def test_led_hand_same_take_by_osc_and_midi(work_folder: Path):
    osc, midi = led("osc:/x?lockstep", by_osc, "osc"), led("midi:bend?lockstep", by_bend, "midi")
    assert np.ptp(osc.positions) > 5e-3
    assert osc.forces.min() < -0.02
    assert np.array_equal(osc.positions, midi.positions)
    assert np.array_equal(osc.forces, midi.forces)
    assert np.array_equal(osc.sound, midi.sound)


def test_led_take_renders_to_same_samples(work_folder: Path):
    played = led("osc:/x?lockstep", by_osc)
    assert np.max(np.abs(played.sound)) > 1e-4
    assert np.array_equal(rendered(Path("s.yaml"), played.take), played.sound)


def test_led_finger_motion_against_dop853(work_folder: Path):
    """Two masses, their springs and dampers, and the force of the piece, tick by tick by DOP853."""
    played = led("osc:/x?lockstep", by_osc)
    n = 3000
    instants = np.arange(n + 1) * TICK - DELAY
    pointer = np.interp(instants, TIMES, TRAVEL * (SHARES - 0.5))
    finger, (pulp_k, pulp_z), (mass, damping) = Finger(), PULP, KEY
    # The finger lands on the resting key in the tick at whose end its first position is read, and
    # goes from there to its pointer in 0.1 s.
    first = int(np.argmax(instants >= 0.0))
    since = np.clip((np.arange(n + 1) - (first - 1)) * TICK / 0.1, 0.0, 1.0)
    pointer[first - 1] = pointer[first]
    pointer -= pointer[first] * (1.0 - since**2 * (3.0 - 2.0 * since))
    state, moved = np.zeros(4), [0.0] * first
    for tick in range(first, n):
        force, start = played.forces[tick], pointer[tick - 1]
        speed = (pointer[tick] - start) / TICK

        def rates(t: float, y: np.ndarray, start=start, speed=speed, force=force) -> list[float]:
            x, v, key, key_v = y
            pulp = pulp_k * (x - key) + pulp_z * (v - key_v)
            pull = finger.stiffness * (start + speed * t - x) + finger.damping * (speed - v)
            return [v, (pull - pulp) / finger.mass, key_v, (force + pulp - damping * key_v) / mass]

        solution = solve_ivp(rates, (0.0, TICK), state, "DOP853", rtol=1e-9, atol=1e-12)
        state = solution.y[:, -1]
        moved.append(state[2])
    wanted = np.array(moved)
    error = np.sqrt(np.mean((played.positions[:n] - wanted) ** 2) / np.mean(wanted**2))
    assert 20 * np.log10(error) < -60.0
    assert played.forces[:n].min() < -0.2


def test_lifted_finger_leaves_key_in_place(work_folder: Path):
    def feed(ready: PreparedPlay) -> None:
        values = OscPositionReceiver(parse_pointer_address("osc:/x?lockstep"), lead_of(ready))
        for time in np.arange(0.0, 0.6, 0.01):
            values.receive([-0.3 * min(1.0, time / 0.3)], time)
        values.receive([], 0.61)
        values.receive(["nonsense"], 0.62)
        values.receive([float("nan")], 0.63)

    played = led("osc:/x?lockstep", feed)
    away = played.positions[int(1.0 / TICK) :]
    assert away[0] == pytest.approx(-0.015, abs=2e-4)
    assert np.ptp(away) < 1e-5
    assert "; 2 refused" in played.sentences[0]


SPRUNG = SCORE.replace(
    "k: {M: 50g, K: 0N/m, Z: 1Ns/m}",
    "k: {M: 50g, K: 60N/m, Z: 1Ns/m, rest: 1mm, X0: 1mm, travel: -10mm..15mm}",
)


def test_led_key_thrown_and_lifted_swings_free(work_folder: Path):
    """It swings back by the spring of the score's key, and never passes that key's travel."""

    def feed(ready: PreparedPlay) -> None:
        lead = lead_of(ready)
        for time in np.arange(0.0, 1.0, 0.004):
            lead.place(time, 1e-3 - 2.0 * max(0.0, time - 0.98))
        lead.lift(1.0)

    played = led("osc:/x?lockstep", feed, score=SPRUNG)
    x = played.positions
    assert x[0] == pytest.approx(1e-3)
    assert x.min() >= -0.01
    assert x[: int(1.1 / TICK)].min() < -0.009
    assert np.max(np.abs(x[int(2.0 / TICK) : int(3.0 / TICK)] - 1e-3)) < 1e-5


def test_led_key_pulled_against_its_spring(work_folder: Path):
    """A finger of 400 N/m on a key of 60 N/m: it stands where both springs balance."""

    def feed(ready: PreparedPlay) -> None:
        for time in np.arange(0.0, 3.0, 0.01):
            lead_of(ready).place(time, -8e-3)

    played = led("osc:/x?lockstep", feed, score=SPRUNG)
    chain = 1.0 / (1.0 / 400.0 + 1.0 / PULP[0])
    wanted = (chain * -8e-3 + 60.0 * 1e-3) / (chain + 60.0)
    assert played.positions[int(2.5 / TICK)] == pytest.approx(wanted, abs=1e-7)
    assert played.forces.min() == 0.0, "nothing else acts there"


def test_led_key_limited_to_its_travel(work_folder: Path):
    def feed(ready: PreparedPlay) -> None:
        lead = lead_of(ready)
        for step, time in enumerate(np.arange(0.0, 3.0, 0.005)):
            lead.place(time, 1e9 if step % 100 < 50 else -1e9, 2.0)

    played = led("osc:/x?lockstep&travel=20mm", feed)
    assert np.max(np.abs(played.positions)) <= 0.01 + 1e-12
    assert np.ptp(played.positions) > 0.019


def test_led_summary_of_rate_latency_and_error(work_folder: Path):
    played = led("osc:/x?lockstep&delay=30ms", by_osc)
    assert played.sentences == [
        "remi by osc:/x: 425 positions, one each 8.0 ms ± 0.0 ms; path 30 ms late and within "
        "0.08 mm where the hand accelerates by 10 m/s²"
    ]


@pytest.mark.parametrize(
    ("messages", "shares"),
    [
        (["b0 02 00", "b0 02 7f", "b0 03 10"], [0.0, 1.0]),
        (
            ["b0 02 40", "b0 22 7f", "b0 02 7f", "b0 22 7f"],
            [64 / 127, 0x207F / 0x3FFF, 0x3F80 / 0x3FFF, 1.0],
        ),
    ],
)
def test_midi_controller_of_7_or_14_bits(messages: list[str], shares: list[float]):
    lead = NotedLead()
    values = MidiPositionReceiver(parse_pointer_address("midi:cc2?lockstep"), lead)  # type: ignore[arg-type]
    for message in messages:
        values.receive(bytes.fromhex(message), 0.0)
    assert lead.placed == pytest.approx([TRAVEL * (share - 0.5) for share in shares])


def test_midi_channel_filter_of_address():
    lead = NotedLead()
    address = parse_pointer_address("midi:pressure?channel=3&lockstep")
    values = MidiPositionReceiver(address, lead)  # type: ignore[arg-type]
    values.receive(bytes([0xD1, 127]), 0.0)
    values.receive(bytes([0xD2, 127]), 0.0)
    assert lead.placed == [0.05]


# A stick (axis 1) pushed away to its end, a button, and the other stick: as Linux writes events.
EVENTS = b"".join(
    struct.pack("llHHi", 12, micro, kind, code, value)
    for micro, kind, code, value in [
        (0, 3, 1, 0),
        (500, 0, 0, 0),
        (1000, 1, 304, 1),
        (2000, 3, 3, 777),
        (8000, 3, 1, -32768),
        (9000, 3, 1, 32767),
    ]
)


def test_gamepad_stick_values_to_positions():
    lead = NotedLead()
    values = GamepadAxis(parse_pointer_address("gamepad:ly?lockstep"), lead)  # type: ignore[arg-type]
    rows = [row for row in stick_events(EVENTS) if row[0] == values.code]
    for _, value, instant in rows:
        values.receive(value, instant)
    assert [instant for *_, instant in rows] == pytest.approx([12.0, 12.008, 12.009])
    assert lead.placed == pytest.approx([0.0, 0.05, -0.05], abs=1e-6)


def test_unplugged_gamepad_leaves_key(tmp_path: Path):
    pipe = tmp_path / "pad"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR)
    lead = NotedLead()
    values = GamepadAxis(parse_pointer_address("gamepad:ly"), lead)  # type: ignore[arg-type]
    port = GamepadPort(pipe, [values])
    os.write(writer, EVENTS)
    until(lambda: len(lead.placed) == 3, "three places")
    assert lead.is_present
    os.close(writer)
    until(lambda: not lead.is_present, "nobody there")
    port.close()


def test_parse_led_address_with_options():
    address = parse_pointer_address("page:ada?K=1kN/m&Z=3Ns/m&M=10g&delay=5ms&travel=30mm")
    assert address.finger == Finger(1000.0, 3.0, 0.01)
    assert (address.delay, address.travel) == (0.005, 0.03)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("midi:cc120", "controllers have the numbers 0 to 119"),
        ("gamepad:lz", "after gamepad: comes one of lx, ly, lt, rx, ry, rt"),
        ("midi:wheel", "cc and a number (cc2), bend or pressure"),
        ("osc:x", "such as osc:/x"),
        ("osc:/x?K=0N/m", "without a spring nothing leads the finger"),
        ("osc:/x?K=400g", "K: "),
        ("osc:/x?M=1mg", "M has to be at least 0.02 g for K = 400 N/m"),
        ("osc:/x?delay=2s", "a delay is at most 500 ms"),
        ("osc:/x?channel=3", "unknown option 'channel=3'; the options are K, Z, M, travel"),
        ("midi:bend?channel=17", "'17' is not a number from 1 to 16"),
    ],
)
def test_parse_led_address_refuses_wrong_urls(url: str, words: str):
    with pytest.raises(BoardError) as error:
        parse_pointer_address(url)
    assert words in str(error.value)


def test_page_boards_named_by_player():
    opened = boards({"ada": "page:", "remi": "page:?K=800N/m"}, {})
    assert [board.url for board in opened] == ["page:ada", "page:remi?K=800N/m"]
    assert not any(board.has_motor for board in opened)


def test_osc_port_in_use_is_refused(work_folder: Path):
    Path("s.yaml").write_text(SCORE)
    live = ["remi=osc:/x?port=39271", "ada=osc:/y?port=39271"]
    ready = prepare("s.yaml", PlayOptions(live=live, audio="null", gain="0dB"), Report())
    other = PlayOptions(live=["remi=osc:/z?port=39271"], audio="null", gain="0dB")
    with pytest.raises(OptionError, match="OSC port 39271 cannot be opened"):
        prepare("s.yaml", other, Report())
    ready.close()
    prepare("s.yaml", other, Report()).close()


def test_session_played_by_osc_twice_at_same_port(work_folder: Path):
    """In a session the hand is in the take beside the journal, twice by the same address."""
    Path("s.yaml").write_text(SCORE.replace("tail: 500ms", "tail: 900s"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        free = probe.getsockname()[1]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pointer:
        live = [f"remi=osc:/x?port={free}"]

        def span(take: Path) -> float:
            pointer.sendto(encode_message("/x", [0.3]), ("127.0.0.1", free))
            if not take.exists() or not len(_core.read_recording(take).ticks()):
                return 0.0
            return float(np.ptp(_core.read_recording(take).positions()[:, 0]))

        for name in ("first", "second"):
            options = SessionOptions(live=live, audio="null", gain="0dB", journal=f"{name}.jsonl")
            report = NotedReport()
            with open_session("s.yaml", options, report=report) as session:
                session.play()
                until(lambda take=Path(f"{name}.take"): span(take) > 0.01, "a hand in the take")
            assert f"positions of /x are taken from OSC at 127.0.0.1:{free}" in report.sentences
            assert any("remi by osc:/x: " in sentence for sentence in report.sentences)
    code, words = command_output("render", "second.jsonl", "--bits", "float", "-o", "j.wav")
    assert code == 0, words


class NotedReport(Report):
    """A report that keeps what is said."""

    def __init__(self) -> None:
        self.sentences: list[str] = []

    def say(self, message: str) -> None:
        self.sentences.append(message)
