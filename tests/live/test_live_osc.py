"""OSC beside a performance: what is asked by it, what is told by it, and garbage."""

import contextlib
import json
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from commands import ERGON
from hypothesis import given
from hypothesis import strategies as st
from patience import PATIENCE, until
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder
from sweep import few

from ergon import _core
from ergon.cli import app
from ergon.common.extras import install_command
from ergon.live.datagrams import (
    DATAGRAM_BYTES_MAX,
    MalformedDatagramError,
    encode_message,
    parse_messages,
)
from ergon.live.osc import OscError, OscServer, parse_address
from ergon.live.osc_in import exclusive_instruments
from ergon.live.osc_out import HearingClock, OscSender
from ergon.live.perform import PlaybackConfig, perform
from ergon.scores.reading.load import load
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.stage import Stage, stage

SCORE = """\
ergon: 1
tempo: [{at: 1|1, bpm: 240, meter: 3/4}, {at: 3|1, bpm: 240, meter: 7/8}]
keys:
  k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
  l: {M: 400g, K: 60N/m, Z: 1.2Ns/m}
instruments:
  bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 2.5s}},
    b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}}}, out: {SOX: m}}
  cup: {modules: {m: {CEL: {M: 2g, f: 330Hz, t60: 2.5s}},
    b: {REF: {between: [bell.m, m], Z: 0.01Ns/m}}}, out: {SOX: m}}
  pot: {modules: {m: {CEL: {M: 2g, f: 440Hz, t60: 2.5s}},
    b: {BUT: {between: [k, m], K: 900N/m, gap: 1mm}},
    c: {BUT: {between: [l, m], K: 900N/m, gap: 1mm}}}, out: {SOX: m}}
gestures: {knock: 0mm@0 smooth 6mm@1/2 0mm@1, tap: 0mm@0 smooth 3mm@1/4 0mm@1/2}
players: {ada: {key: k}, bo: {key: l}}
parts:
  ada: [{at: 1|2, play: knock, every: 2, times: 6}]
  bo: [{at: 2|1.5, play: tap, every: 3, times: 3}]
render: {tail: 500ms}
"""


def piece(text: str = SCORE) -> Piece:
    loaded = load("s.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return loaded.piece


class Listener:
    """A program that hears OSC, and says some."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port: int = self.socket.getsockname()[1]
        self.messages: list[tuple[float, float | None, str, list[Any]]] = []

    def next(self, patience: float = PATIENCE) -> tuple[float, float | None, str, list[Any]]:
        """(instant it came, time tag, address, arguments)."""
        self.socket.settimeout(patience)
        datagram = self.socket.recv(65536)
        now, tag = time.time(), None
        if OscBundle.dgram_is_bundle(datagram):
            bundle = OscBundle(datagram)
            tag, message = bundle.timestamp, bundle.content(0)
        else:
            message = OscMessage(datagram)
        self.messages.append((now, tag, message.address, list(message.params)))
        return self.messages[-1]

    def until(self, *addresses: str) -> tuple[float, float | None, str, list[Any]]:
        while (result := self.next())[2] not in addresses:
            pass
        return result

    def drain(self, patience: float = 0.2) -> None:
        with contextlib.suppress(TimeoutError):
            while True:
                self.next(patience)

    def messages_to(self, address: str) -> list[tuple[float, float | None, list[Any]]]:
        return [(now, tag, said) for now, tag, where, said in self.messages if where == address]

    def say(self, port: int, address: str, *arguments: Any) -> None:
        self.socket.sendto(encode_message(address, arguments), ("127.0.0.1", port))


@pytest.fixture
def listener() -> Iterator[Listener]:
    built = Listener()
    yield built
    built.socket.close()


@contextlib.contextmanager
def played(
    staged: Stage, order: PlaybackConfig, there: int | None = None
) -> Iterator[tuple[_core.Performance, OscServer]]:
    """A performance with OSC, ended afterwards."""
    osc = OscServer(("127.0.0.1", 0), None if there is None else ("127.0.0.1", there))
    performance = perform(staged, order)
    try:
        osc.begin(performance, staged, order.gain, order.start_frame)
        yield performance, osc
    finally:
        osc.stop_serving()
        osc.close()
        performance.stop()
        performance.close(1.0)


# --- a whole command ------------------------------------------------------------------------------


@contextlib.contextmanager
def command(folder: Path, *options: str, text: str = SCORE) -> Iterator[subprocess.Popen[str]]:
    (folder / "s.yaml").write_text(text, encoding="utf-8")
    line = [*ERGON, "play", "s.yaml", "--json", *options]
    pipe = subprocess.PIPE
    with subprocess.Popen(line, stdout=pipe, stderr=pipe, text=True, cwd=folder) as process:
        try:
            yield process
        finally:
            process.kill()


def next_event(process: subprocess.Popen[str], event: str) -> dict[str, Any]:
    assert process.stdout is not None
    for line in process.stdout:
        if (result := json.loads(line))["event"] == event:
            return dict(result)
    raise AssertionError(f"no {event}: {process.stderr.read() if process.stderr else ''}")


def test_osc_commands_and_beats_of_play(tmp_path: Path, listener: Listener):
    to = f"127.0.0.1:{listener.port}"
    options = ["--audio", "null", "--gain", "0dB", "--osc", "0", "--osc-to", to, "--loop"]
    with command(tmp_path, *options) as process:
        where = next_event(process, "osc")
        assert where["host"] == "127.0.0.1"
        port = where["port"]
        assert listener.until("/ergon/beat")[3][:2] == [1, 1]
        listener.say(port, "/ergon/cmd", "rest ada")
        assert listener.until("/ergon/error")[3] == [
            "commands need a session: ergon repl takes them, ergon play does not"
        ]
        listener.say(port, "/ergon/nothing\x1b[2J")
        listener.say(port, "/ergon/nothing\x1b[2J")
        listener.socket.sendto(b"\0\xff/ergon", ("127.0.0.1", port))
        listener.say(port, "/ergon/instrument/bell/gain", -6.0)
        listener.say(port, "/ergon/player/bo/gain", -6.0)
        assert "shared with other keys" in listener.until("/ergon/error")[3][0]
        listener.say(port, "/ergon/stop", 0)  # a button that is let go
        listener.say(port, "/ergon/gain", "loud")
        assert listener.until("/ergon/error")[3] == [
            "the argument has to be one number, a level in dB"
        ]
        listener.say(port, "/ergon/stop")
        assert next_event(process, "warning")["message"] == "osc: no address /ergon/nothing\\x1b[2J"
        assert (
            next_event(process, "warning")["message"]
            == "1 datagrams were not valid OSC and were ignored"
        )
        next_event(process, "played")
        assert process.wait(timeout=PATIENCE) == 0


# --- what is told ---------------------------------------------------------------------------------


def test_osc_beats_and_strikes_with_positions(listener: Listener):
    staged = stage(piece(), planned=True)
    with played(staged, PlaybackConfig(audio="null:fast"), listener.port) as (performance, osc):
        while not performance.wait(1.0):
            pass
        osc.stop_serving()
        listener.drain()
    beats = [tuple(said) for *_, said in listener.messages_to("/ergon/beat")]
    # Two bars of three quarters, then bars of seven eighths, each beat an eighth long or a quarter.
    assert beats[:7] == [(1, 1, 240), (1, 2, 240), (1, 3, 240), *beats[3:7]]
    tempo = staged.piece.tempo_map
    for bar, beat, bpm in beats:
        position = tempo.bars.start(bar) + beat - 1
        assert (tempo.bar_beat(position), tempo.bpm(position)) == ((bar, beat), bpm)
    assert beats == sorted(set(beats))
    assert len(beats) > 12
    strikes = [said for *_, said in listener.messages_to("/ergon/strike")]
    expected = sorted((g.start, g.player, g.key, g.name) for g in staged.gestures)
    assert [(player, key, name) for player, key, name, _ in strikes] == [
        (player, key, name) for _, player, key, name in expected
    ]
    assert [position for *_, position in strikes] == pytest.approx(
        [one[0] for one in expected], abs=1e-6
    )
    assert {tag for _, tag, _ in listener.messages_to("/ergon/strike")} == {
        0
    }  # nowhere to be heard
    assert len(listener.messages_to("/ergon/level")[0][2]) == staged.n_channels
    assert listener.messages_to("/ergon/late")[0][2] == [0, 0]


class Card:
    """A performance by a card of its own: blocks of 256 frames, heard after 10 ms; time is told."""

    BLOCK, LATENCY, AHEAD = 256, 0.01, 8192

    def __init__(self, staged: Stage) -> None:
        self.rate, self.began, self.now = staged.rate, 1000.0, 1000.0

    def recording_trouble(self) -> None:
        """Nothing is recorded."""

    def status(self) -> Any:
        frames = int((self.now - self.began) * self.rate) // self.BLOCK * self.BLOCK
        return SimpleNamespace(
            frame=frames + self.AHEAD,
            sounding=frames / self.rate,
            latency=self.LATENCY,
            paced=True,
            **{
                "underruns": 0,
                "input_gaps": 0,
                "xruns": 0,
                "dropped": 0,
                "alive": True,
                "late": 0,
                "done": False,
                "panicked": False,
                "lost": 0,
                "ticks": 1,
                "hands": [],
                "peaks": [],
            },
        )


def test_osc_time_tags_match_sounding_instant():
    """Seen late, never early, and by less than a block; told in time to be done then."""
    staged = stage(piece(), planned=True)
    card = Card(staged)
    strikes: list[tuple[float, float, float]] = []

    def send(address: str, arguments: Any, when: float | None = None) -> None:
        if address == "/ergon/strike":
            assert when is not None
            strikes.append((card.now, when, card.began + card.LATENCY + arguments[3]))

    teller = OscSender(card, staged, 0, send)  # type: ignore[arg-type]
    turns = int(staged.n_frames / staged.rate / 0.0101)
    for turn in range(turns):
        card.now = card.began + 0.0101 * turn
        teller.send_new(lambda: card.now)
    assert len(strikes) == len(staged.gestures) >= 4
    block, frame = card.BLOCK / staged.rate, 1 / staged.rate
    assert all(-frame <= tag - true < block + frame for _, tag, true in strikes)
    # Those that begin before the first block went out are the exception.
    assert all(tag > now for now, tag, true in strikes if true > card.began + 0.5)


def test_hearing_clock_uses_earliest_late_block():
    class StatusPerformance:
        def __init__(self, sounding: float, underruns: int = 0) -> None:
            self.sounding, self.underruns = sounding, underruns
            self.latency, self.paced, self.dropped, self.alive = 0.01, True, 0, True

    ear = HearingClock(1000.0, 500)
    assert ear.instant_of(500) is None
    for i, late in enumerate((0.004, 0.0, 0.007, 0.002)):
        ear.update(StatusPerformance(0.1 * i - late), 50.0 + 0.1 * i)  # type: ignore[arg-type]
    assert ear.instant_of(1500) == pytest.approx(51.01)
    # An underrun puts silence in: what was known is no longer true.
    ear.update(StatusPerformance(0.395, underruns=1), 50.4)  # type: ignore[arg-type]
    assert ear.instant_of(1500) == pytest.approx(51.015)


# --- what is asked --------------------------------------------------------------------------------


def test_exclusive_instruments_of_players():
    assert exclusive_instruments(piece(), ["bell", "cup", "pot"]) == {
        "ada": ["bell", "cup"],
        "bo": [],
    }


@pytest.fixture(scope="module")
def ringing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Stage, np.ndarray]:
    """A stage whose channels all sound for half a minute, and what is heard of it.

    No clock holds a file: a request may come late.
    """
    score = SCORE
    for short, long in {"500ms": "30s", "2.5s": "900s", "0.01Ns/m": "0.0001Ns/m"}.items():
        assert short in score
        score = score.replace(short, long)
    staged = stage(piece(score), planned=True)
    return staged, sound(staged, tmp_path_factory.mktemp("ringing") / "before.wav", None)


@pytest.mark.parametrize(
    ("address", "moved"),
    few(
        [
            ("/ergon/instrument/bell/gain", [True, False, False]),
            ("/ergon/player/ada/gain", [True, True, False]),
            ("/ergon/gain", [True, True, True]),
        ],
        1,
    ),
)
def test_osc_gain_silences_named_instruments(
    ringing: tuple[Stage, np.ndarray], tmp_path: Path, address: str, moved: list[bool]
):
    """Each instrument has a channel of its own: what is silenced is silent, the rest keeps bits."""
    staged, before = ringing
    after = sound(staged, tmp_path / "after.wav", address)
    begins = [np.flatnonzero(before[:, i] != after[:, i]) for i in range(3)]
    assert [len(result) > 0 for result in begins] == moved
    for channel, result in enumerate(begins):
        if len(result):
            assert before[result[0] + 960 :, channel].any()
            assert not after[result[0] + 960 :, channel].any()


def sound(staged: Stage, path: Path, address: str | None) -> np.ndarray:
    """What is heard when a gain falls to nothing at once, computed as fast as it goes."""
    import soundfile

    osc = OscServer(("127.0.0.1", 0), None)
    performance = perform(staged, PlaybackConfig(audio=f"file:{path}", gain=0.1, frames_ahead=256))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:  # open until it is heard
        if address is not None:
            osc.begin(performance, staged, 0.1)
            assert osc.address is not None
            asking.sendto(encode_message(address, [float("-inf")]), osc.address)
        while not performance.wait(1.0):
            pass
        osc.close()
    performance.close(PATIENCE)
    return np.asarray(soundfile.read(path)[0])


def test_osc_panic_and_release(listener: Listener):
    staged = stage(piece(), planned=True)
    with played(staged, PlaybackConfig(audio="null"), listener.port) as (performance, osc):
        assert osc.address is not None
        listener.until("/ergon/strike")
        listener.say(osc.address[1], "/ergon/panic", 1.0)
        until(lambda: performance.status().played > 0 and not _moves(performance), "silence")
        listener.say(osc.address[1], "/ergon/release")
        until(lambda: _moves(performance), "sound again")


def _moves(performance: _core.Performance) -> bool:
    before = performance.status().played
    time.sleep(0.05)
    return performance.status().played > before


# --- what anybody may send ------------------------------------------------------------------------


def _message(address: str, *arguments: object) -> bytes:
    builder = OscMessageBuilder(address)
    for argument in arguments:
        builder.add_arg(argument)  # type: ignore[arg-type]
    return builder.build().dgram


@given(st.binary(max_size=200))
def test_osc_parser_with_random_datagrams(datagram: bytes):
    for bytes_ in (datagram, b"#bundle\0" + datagram, b"/a\0\0," + datagram):
        with contextlib.suppress(MalformedDatagramError):
            for address, _ in parse_messages(bytes_):
                assert address.startswith("/")


@given(
    st.recursive(
        st.just(_message("/a", 1, 0.5, "x")),
        lambda inner: st.lists(inner, max_size=3).map(
            lambda parts: (
                b"#bundle\0" + bytes(8) + b"".join(struct.pack(">i", len(p)) + p for p in parts)
            )
        ),
        max_leaves=8,
    ),
    st.integers(0, 400),
    st.binary(min_size=1, max_size=4),
)
def test_osc_damaged_datagrams_raise_malformed_errors(datagram: bytes, offset: int, spoil: bytes):
    with contextlib.suppress(MalformedDatagramError):
        assert all(one == ("/a", [1, 0.5, "x"]) for one in parse_messages(datagram))
    offset %= len(datagram)
    with contextlib.suppress(MalformedDatagramError):
        parse_messages(datagram[:offset] + spoil + datagram[offset + len(spoil) :])


def test_osc_bundle_with_bad_size_or_depth_malformed():
    for size in (-4, 0, 3, 1 << 20):
        with pytest.raises(MalformedDatagramError):
            parse_messages(b"#bundle\0" + bytes(8) + struct.pack(">i", size) + _message("/a"))
    deep = _message("/a")
    for _ in range(9):
        deep = b"#bundle\0" + bytes(8) + struct.pack(">i", len(deep)) + deep
    with pytest.raises(MalformedDatagramError):
        parse_messages(deep)


def test_osc_flood_of_errors_rate_limited(listener: Listener):
    with played(stage(piece(), planned=True), PlaybackConfig(audio="null")) as (_, osc):
        assert osc.address is not None
        began = time.monotonic()
        for i in range(100):
            listener.say(osc.address[1], "/ergon/cmd", "a" * 2000)
            listener.say(osc.address[1], f"/x{i}")
            listener.socket.sendto(bytes(DATAGRAM_BYTES_MAX + 1), ("127.0.0.1", osc.address[1]))
        until(lambda: osc.n_malformed > 0, "what is no OSC is counted")
        listener.until("/ergon/error")
        listener.drain()
        text = len(listener.messages_to("/ergon/error")) + len(osc.remarks())
        assert 0 < text <= 10 * (time.monotonic() - began + 1.0)
        assert osc.n_malformed > 0


# --- places ---------------------------------------------------------------------------------------


def test_osc_parse_address_default_host():
    assert parse_address("9000") == ("127.0.0.1", 9000)
    assert parse_address("0.0.0.0:9000") == ("0.0.0.0", 9000)
    assert parse_address("[::1]:9000") == ("::1", 9000)
    for text in ("", "host", "host:", "1:-1", "70000", "host:9o"):
        with pytest.raises(OscError, match="HOST:PORT"):
            parse_address(text)


def test_occupied_osc_port_is_refused(listener: Listener):
    with pytest.raises(OscError, match=f"cannot listen at 127.0.0.1:{listener.port}"):
        OscServer(("127.0.0.1", listener.port), None)


def test_osc_without_python_osc_suggests_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "s.yaml"
    path.write_text(SCORE, encoding="utf-8")
    for module in [name for name in sys.modules if name.startswith("pythonosc")]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "pythonosc", None)
    assert app.run(["play", str(path), "--osc", "0"]) == 2
    output = capsys.readouterr().err
    assert install_command("osc") in output
    # What was said is typed in a clone: its folder has the extra.
    assert (Path(__file__).parents[2] / "pyproject.toml").is_file()
    assert f"pip install -e '{Path(__file__).parents[2]}[osc]'" in output
