"""Boards that are wired wrongly, freeze, or are played by two: what a hand on them feels."""

import socket
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ERGON
from duets import command_output
from emulators import crc, emulator
from patience import PATIENCE
from simulated_board import Simulated, simulated
from sweep import few

from ergon import _core

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="locks of files")
SCORE = """\
ergon: 1
keys: {k: {M: 400g, K: 60N/m, Z: 1.2Ns/m}}
instruments:
  bell:
    modules:
      m: {CEL: {M: 2g, f: 220Hz, t60: 0.5s}}
      b: {BUT: {between: [k, m], K: 100N/m, gap: 40mm}}
    out: {SOX: m}
gestures: {swing: 0mm@0 (smooth 8mm@1/2 -4mm@1 0mm@3/2)*3}
players: {remi: {hand: live, key: k, standin: swing}}
render: {tail: 1500ms}
"""
FAULT = 2.5  # [s] of the board


@pytest.fixture(autouse=True)
def private_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "score.yaml").write_text(SCORE)


def shorten(folder: Path) -> None:
    """A score of two swings instead of six."""
    (folder / "score.yaml").write_text(SCORE.replace(")*3", ")*1").replace("1500ms", "500ms"))


def duet(folder: Path, board: Simulated, *more: str) -> tuple[int, str]:
    live = ("--live", f"remi={board.url}?lockstep", "--audio", "null", "--gain", "0dB", "--plain")
    return command_output("duet", folder / "score.yaml", *live, *more)


def harm(log: np.ndarray, complete: np.ndarray) -> tuple[float, float]:
    """How long after the fault there was a force [s], and how far the key went beyond [m]."""
    after = log[log["t"] >= FAULT]
    lasted = after["t"][np.flatnonzero(after["force"])[-1]] - FAULT
    n = min(len(after), int((complete["t"] >= FAULT).sum()))
    # The hand holds still at 0; without a fault the scene takes the key so far.
    sound = complete[complete["t"] >= FAULT]["x"][:n]
    x = after["x"][:n]
    low, high = np.minimum(sound, 0.0), np.maximum(sound, 0.0)
    return float(lasted), float(np.maximum(x - high, low - x).max())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "why"),
    few(
        [
            ({"motor": -1.0}, "its motor pushes in the wrong direction"),
            ({"frozen": True}, "its position does not change"),
        ],
        [({"motor": -1.0}, "its motor pushes in the wrong direction")],
    ),
)
def test_duet_force_ends_after_device_fault(
    tmp_path: Path, fault: dict[str, float | bool], why: str
):
    logs = []
    for ways in ({}, {**fault, "since": FAULT}):
        with simulated(tmp_path / "log.npy", lockstep=True, **ways) as board:
            code, output = duet(tmp_path, board, "--unchecked", "--guide", "remi=500N/m")
            assert code == 0, output
            assert (why in output) == bool(ways), output
            logs.append(board.log())
    complete, log = logs
    assert np.abs(complete["force"][complete["t"] > FAULT]).max() > 1.0
    lasted, travel = harm(log, complete)
    print(f"{fault}: force for {1e3 * lasted:.0f} ms, {1e3 * travel:.1f} mm beyond")
    assert lasted < 0.3
    assert travel < 5e-3


def test_duet_refuses_reversed_motor_in_lockstep(tmp_path: Path):
    shorten(tmp_path)
    with simulated(tmp_path / "log.npy", lockstep=True, motor=-1.0) as board:
        code, output = duet(tmp_path, board)
        assert code == 2, output
        assert "the motor pushes the wrong way" in output
        # As it is known to be, it plays.
        assert (
            command_output("devices", "calibrate", f"{board.url}?lockstep", "--seconds", "0")[0]
            == 0
        )
        code, output = duet(tmp_path, board, "--guide", "remi=500N/m")
        assert code == 0, output
        assert "tripped" not in output
        log = board.log()
    pulses = (
        log[: np.flatnonzero(np.abs(log["asked"]) > 4.01)[0]] if log["asked"].max() > 4.01 else log
    )
    assert np.abs(pulses["x"]).max() < 8e-3


def test_duet_with_correct_motor_plays(tmp_path: Path):
    shorten(tmp_path)
    with simulated(tmp_path / "log.npy", lockstep=True) as board:
        code, output = duet(tmp_path, board, "--guide", "remi=200N/m")
        assert code == 0, output
        assert "let go of the key" in output
        assert "tripped" not in output
        assert not (tmp_path / "config").exists(), "an address is no board that one remembers"


@pytest.mark.slow
def test_duet_unchecked_reversed_motor_trips_at_motion(tmp_path: Path):
    with simulated(tmp_path / "log.npy", lockstep=True, motor=-1.0) as board:
        code, output = duet(tmp_path, board, "--unchecked", "--guide", "remi=800N/m")
        assert code == 0, output
        assert "its motor pushes in the wrong direction" in output
        log = board.log()
    assert np.abs(log["x"]).max() < 5e-3
    assert not log["force"][-1000:].any(), "it stays off"


def request(number: int, n: int, newtons: float = 0.0, flags: int = 1) -> bytes:
    body = struct.pack("<HB", number, n)
    body += struct.pack("<h", round(newtons / 20 * 32767)) * n + bytes([flags])
    return b"\xa5\x5a" + body + crc(body)


def test_board_replies_only_to_owner():
    with emulator("frame", "--udp", "0", "--lockstep") as device:
        host, port = device.url.partition("?")[0].removeprefix("frame+udp:").split(":")
        kinds = socket.AF_INET, socket.SOCK_DGRAM
        with socket.socket(*kinds) as first, socket.socket(*kinds) as other:
            for wire in (first, other):
                wire.connect((host, int(port)))
                wire.settimeout(PATIENCE)
            first.send(request(1, 0))
            assert first.recv(512)
            other.send(request(1, 0))
            assert other.recv(512), "nobody has it yet"
            first.send(request(2, 1, 1.0))
            assert first.recv(512)
            # Datagrams come in their order: once `first` has its reply, `other` has been passed
            # over.
            other.send(request(2, 1, -1.0))
            other.send(request(3, 0))
            first.send(request(3, 1, 1.0))
            reply = first.recv(512)
            assert struct.unpack_from("<H", reply, 2)[0] == 3
            other.setblocking(False)
            with pytest.raises(BlockingIOError):
                other.recv(512)
            first.send(request(4, 1, flags=0))
            assert first.recv(512)
            other.settimeout(PATIENCE)
            other.send(request(4, 1, -1.0))
            assert struct.unpack_from("<H", other.recv(512), 2)[0] == 4, "it was let go of"


def test_device_open_in_second_program_is_refused():
    with emulator("frame", "--udp", "0", "--lockstep") as device:
        single = _core.Device(device.url)
        with pytest.raises(_core.EngineError, match="this program has the device open already"):
            _core.Device(device.url)
        asked = ["take", "record", "--live", f"remi={device.url}", "-o", "never.take"]
        done = subprocess.run([*ERGON, *asked], capture_output=True, text=True)
        assert done.returncode == 3, done.stderr
        import os

        assert f"process {os.getpid()} has the device open" in done.stderr
        single.close()
        _core.Device(device.url).close()


def test_device_with_foreign_replies_reports_them(tmp_path: Path):
    """A board that answers whoever spoke last: every other reply is to a request of another."""
    code = (
        "import socket, struct, json\n"
        "from simulated_board import Board, Ways, crc\n"
        "wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
        "wire.bind(('127.0.0.1', 0))\n"
        "print(wire.getsockname()[1], flush=True)\n"
        "board = Board(Ways(), True)\n"
        "while True:\n"
        "    packet, host = wire.recvfrom(512)\n"
        "    reply = board.answer(packet, 0.0)\n"
        "    if packet[4]:\n"
        "        number = struct.unpack_from('<H', reply, 2)[0] + 30000 & 0xFFFF\n"
        "        body = struct.pack('<H', number) + reply[4:-2]\n"
        "        wire.sendto(b'\\xa5\\x5a' + body + crc(body), host)\n"
        "    wire.sendto(reply, host)\n"
    )
    here = Path(__file__).parents[1] / "support"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=here
    ) as process:
        try:
            assert process.stdout is not None
            url = f"frame+udp:127.0.0.1:{int(process.stdout.readline())}?lockstep&patience=60"
            device = _core.Device(url)
            with pytest.raises(_core.EngineError, match="another program sends forces"):
                device.direction(0, 1e-3)
        finally:
            process.kill()


def test_trip_sentences_of_all_reasons():
    from ergon.live.display import event_sentence

    reasons = (
        "not finite",
        "speed",
        "wrong way",
        "at stop",
        "frozen",
        "unanswered",
        "late",
        "outside travel",
        "jump",
    )
    sentences = {event_sentence((0, f"tripped: {why}", 0.0), ["remi"], []) for why in reasons}
    assert len(sentences) == len(reasons)
    assert all(sentence.startswith("remi's key tripped: ") for sentence in sentences)
    assert all("until `release`" in sentence for sentence in sentences)
