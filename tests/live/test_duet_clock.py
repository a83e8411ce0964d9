"""Duets by the wall clock: keys that die and come back, hosts that are killed, Ctrl-C."""

import json
import signal
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from duets import STAND_IN, duet, recorded, rendered, sound
from emulators import crc, emulator, free_port
from patience import until

from ergon import _core
from ergon.cli import app

TICK = 44
SCORE = """\
ergon: 1
accuracy: {method: ca}
tempo: [{at: 1|1, bpm: 120, meter: 2/4}]
keys: {k1: {M: 400g, K: 60N/m, Z: 1.2Ns/m}, k2: {like: k1}}
instruments:
  bells:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}
      n: {CEL: {M: 2g, f: 331Hz, t60: 1s}}
      b: {BUT: {between: [k1, m], K: 300N/m, gap: 1mm}}
      c: {BUT: {between: [k2, n], K: 300N/m, gap: 1mm}}
    out: {SOX: [m, n]}
gestures: {lean: 0mm@0 smooth 6mm@1 0mm@2}
players: {ada: {hand: live, key: k1}, remi: {hand: live, key: k2}}
duet: [{couple: [k1, k2], REF: {K: 20N/m, Z: 0.1Ns/m}}]
parts:
  remi: [{at: 1|1, play: lean, times: 60}]
render: {tail: 500ms}
"""
BAR = 44100  # frames: two beats at 120


@pytest.fixture
def score(tmp_path: Path) -> Path:
    path = tmp_path / "duet.yaml"
    path.write_text(SCORE)
    return path


@pytest.mark.slow
def test_reconnected_key_in_duet_recording(score: Path, tmp_path: Path):
    take, listened = tmp_path / "two.take", tmp_path / "two.wav"
    port = free_port()
    hand = ("--gesture", "0mm@0 (smooth 7mm@1 0mm@2)*30", "--hand", "900N/m")
    key = ("frame", "--udp", str(port))
    # A ring of seconds: what a busy disk does not take at once waits there.
    how = ("--record", take, "--audio", f"file:{listened}", "--ahead", 65536, "--gain", "0dB")
    with emulator("frame", "--udp", "0", *hand) as ada, emulator(*key, *hand) as remi:
        live = ("--live", f"ada={ada.url}", "--live", f"remi={remi.url}")
        with duet(score, *live, *how) as playing:
            for _ in range(3):
                playing.until("load")
            remi.process.kill()
            assert "its stand-in plays on" in playing.until(f"{remi.url} is disconnected")
            with emulator(*key):
                playing.until(f"{remi.url} is back: its hand takes over at the next bar")
                playing.until("remi plays")
                playing.until("load")
                playing.process.send_signal(signal.SIGINT)
                assert playing.end() == 130
    assert "Traceback" not in "".join(playing.lines)
    both = recorded(take)
    _stood_in(both)
    played, expected = sound(listened), rendered(score, take)
    # The last of it faded, and what was still in the ring is not heard: Ctrl-C.
    upto = len(played) - 1024
    assert upto > 3 * BAR
    assert np.abs(played[:upto]).max() > 1e-5
    assert np.array_equal(played[:upto], expected[:upto])


def _stood_in(both: _core.Recording) -> None:
    """The second key once had a stand-in, up to a bar; nowhere there it jumped."""
    ticks, x = both.ticks(), both.positions()
    flags = both.flags() & STAND_IN
    assert not flags[:, 0].any()
    stood = np.flatnonzero(flags[:, 1])
    assert len(stood) > 2
    assert np.array_equal(stood, np.arange(stood[0], stood[-1] + 1))
    assert stood[0] > 0
    back = int(ticks[stood[-1] + 1]) * TICK
    assert back % BAR < TICK, "a hand that comes back waits for a bar"
    # Stand-in and hand move less than half of this in a tick, and so does the change of hands.
    changes = np.abs(np.diff(x[stood[0] - 1 : stood[-1] + 1000, 1]))
    n_stood = len(stood) + 1
    assert changes[:n_stood].max() < 1e-4
    # Where a busy machine stalls, a device moves farther from one tick to the next.
    assert np.quantile(changes[n_stood:], 0.99) < 1e-4


def test_killed_duet_host_releases_and_leaves_recording(score: Path, tmp_path: Path):
    take = tmp_path / "killed.take"
    with emulator("frame", "--udp", "0", "--gesture", "0mm@0 7mm@60") as device:
        live = ("--live", f"ada={device.url}", "--record", take)
        with duet(score, *live, "--audio", "null", "--json") as playing:
            frames = 0
            while frames < 44100:
                frames = json.loads(playing.until('"playing"'))["frame"]
            # It comes to the disk as it is played, twice a second; the hand moves by its own clock.
            until(lambda: _played(take) >= frames and _reach(take) > 1e-5, "the recording")
            playing.process.kill()
        device.until("let-go")
    left = _core.read_recording(take)
    assert not left.finished
    assert _played(take) >= frames
    assert left.positions()[:, 0].max() > 1e-5
    assert len(rendered(score, take, doubted=True)) > frames


def _reach(take: Path) -> float:
    """How far the first hand has moved by now [m]."""
    positions = _core.read_recording(take).positions()
    return float(positions[:, 0].max()) if len(positions) else 0.0


def _played(take: Path) -> int:
    """Frames that a recording holds by now."""
    ticks = _core.read_recording(take).ticks()
    return (int(ticks[-1]) + 1) * TICK if len(ticks) else 0


# --- a device written here: what really reaches a motor ------------------------------------------


class Pressed:
    """One axis of the open frame whose key is held at 5 mm; keeps every (force, flags)."""

    def __init__(self, wire: socket.socket) -> None:
        self.wire, self.heard = wire, [(0, 0)]
        self.is_over = threading.Event()

    def serve(self) -> None:
        while not self.is_over.is_set():
            try:
                packet, host = self.wire.recvfrom(512)
            except TimeoutError:
                continue
            assert packet[:2] == b"\xa5\x5a"
            assert crc(packet[2:-2]) == packet[-2:]
            number, n = struct.unpack_from("<HB", packet, 2)
            if n == 0:
                about = (5, 5, 1e-6, -0.05, 0.05, 1000, 0.05, 1)
                sync, body = b"\xa5\x5d", struct.pack("<HBB8f", number, 1, 0, *about)
            else:
                self.heard.append(struct.unpack_from("<hB", packet, 5))
                sync, body = b"\xa5\x5a", struct.pack("<HIBiB", number, 0, 1, round(5e-3 / 1e-8), 3)
            self.wire.sendto(sync + body + crc(body), host)


@contextmanager
def pressed() -> Iterator[tuple[Pressed, str]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        wire.settimeout(0.1)
        device = Pressed(wire)
        thread = threading.Thread(target=device.serve, daemon=True)
        thread.start()
        try:
            yield device, f"frame+udp:127.0.0.1:{wire.getsockname()[1]}"
        finally:
            device.is_over.set()
            thread.join()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_duet_with_zero_force(score: Path, tmp_path: Path, number: signal.Signals):
    with pressed() as (device, url):
        with duet(score, "--live", f"ada={url}", "--audio", "null") as playing:
            until(lambda: abs(device.heard[-1][0]) > 200, "a force")
            playing.process.send_signal(number)
            assert playing.end() == 128 + number
        # Told three times: one packet may be lost.
        until(lambda: [force for force, _ in device.heard[-3:]] == [0, 0, 0], "farewells")
    assert "Traceback" not in "".join(playing.lines)


# --- what cannot be -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--live", "reni=emul:"], 2, "no player 'reni'; did you mean 'remi'?"),
        (["--live", "remi=mykey"], 2, "no device is called mykey"),
        (["--live", "remi"], 2, "a hand is PLAYER=DEVICE"),
        (["--live", "remi=frame:/dev/not-there"], 3, "/dev/not-there"),
        (["--live", "remi=emul:#3"], 3, "no such axis"),
        (["--live", "remi=emul:#99"], 3, "no such axis"),
        (["--live", "remi=falcon:usb"], 3, "not a kind of device"),
        (["--live", "remi=emul:", "--record", "there.take"], 2, "overwrites no file"),
        (["--record", "new.take"], 2, "this score has no live hands to record"),
        (["--guide", "remi"], 2, "remi has no device; --live remi=DEVICE gives one"),
        (["--live", "remi=emul:", "--guide", "remi=200kg"], 2, "--guide remi=200kg"),
        (["--standin", "remi=nothing"], 2, "no take or gesture is called 'nothing'"),
        (["--audio", "file:/nowhere/x.wav"], 2, "/nowhere/x.wav"),
        (["--from", "99|1"], 2, "the piece ends at"),
    ],
)
def test_wrong_live_arguments_are_refused(
    arguments: list[str],
    code: int,
    sentence: str,
    score: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(tmp_path)
    Path("there.take").write_bytes(b"mine")
    score.write_text(SCORE.replace("times: 60", "times: 1"))
    audio = [] if "--audio" in arguments else ["--audio", "null:fast"]
    assert app.run(["duet", str(score), *arguments, *audio, "--unchecked"]) == code
    output = capsys.readouterr().err
    assert sentence in output
    assert "Traceback" not in output
    assert Path("there.take").read_bytes() == b"mine"
    assert not Path("new.take").exists()
