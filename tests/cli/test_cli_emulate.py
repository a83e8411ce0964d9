"""Emulated devices as processes of their own, driven by bytes written here by hand."""

import os
import select
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from emulators import crc, emulator, pulled
from numpy.typing import NDArray
from patience import PATIENCE, until

from ergon import _core
from ergon.cli import app
from ergon.scores.gesture import notation
from ergon.scores.gesture.sampled import sampled_positions

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")


@contextmanager
def serial(url: str) -> Iterator[int]:
    path = url.removeprefix("firefader:").partition("?")[0]
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        yield port
    finally:
        os.close(port)


def exchange(port: int, force: bytes) -> bytes:
    """Send a packet and read seven bytes."""
    os.write(port, force)
    reply = b""
    while len(reply) < 7:
        assert select.select([port], [], [], 5)[0], reply
        reply += os.read(port, 7 - len(reply))
    return reply


TICK = 44100 / 44
GESTURE = ("--gesture", "0mm@0 12mm@1/10 0mm@1/4")


def followed(hand: NDArray[np.float64], n: int) -> list[int]:
    """Bytes of the positions of the key."""
    return [round(x / 0.00039) + 128 for x in pulled(hand, TICK, n)]


def positions(pause: float) -> tuple[list[int], str]:
    with emulator("firefader", "--lockstep", *GESTURE) as device, serial(device.url) as port:
        assert device.url.endswith("?lockstep")
        path = []
        for _ in range(300):
            time.sleep(pause)
            reply = exchange(port, bytes([0x7F, 0, 0]))
            assert reply[0] == 0xFF
            path.append(reply[1])
        return path, device.end()


def test_emulated_firefader_path_independent_of_pace():
    path, hashed = positions(0.0)
    # 12 mm are 31 steps of 0.39 mm; a hand that brakes late goes beyond.
    assert 128 + 31 <= max(path) < 128 + 40
    assert path == followed(
        sampled_positions(notation.parse(GESTURE[1]).points, 1.0, TICK), len(path)
    )
    assert positions(0.001) == (path, hashed)


PLANT = (
    *("--lockstep", "--no-gate", "--free", "--mass", "380g", "--stiffness", "60N/m"),
    *("--damping", "1.2Ns/m", "--weight", "0.15N", "--dry", "50mN", "--static", "80mN 4mm/s"),
    *("--presliding", "5kN/m", "--mode", "20g 180Hz 0.02", "--delay", "1.5ms"),
)


def pushed(*arguments: str) -> tuple[list[int], str]:
    """Bytes of the positions of a plant under a random force, and the hash of its positions."""
    with emulator("firefader", *PLANT, *arguments) as device, serial(device.url) as port:
        path = [exchange(port, bytes([0x7F, force & 0xFF, 0]))[1] for force in FORCES]
        return path, device.end()


FORCES = [int(x) for x in np.random.default_rng(1).integers(-20, 60, 300)]


def test_emulated_key_follows_key_path_model():
    row = [0.38, 60, 1.2, 0.15, 0.05, -2.5e-3, 1.5e-3, 5e3, 0.08, 4e-3, 0.02, 180, 0.02]
    lsb = 1.56 / 127
    force = np.array([*FORCES, 0]) * lsb
    x = _core.key_path(np.array(row), force, TICK, columns=())[0]
    expected = [round(at / 0.00039) + 128 for at in x[1:]]
    path, hashed = pushed()
    assert path == expected
    assert max(path) > 135
    assert pushed() == (path, hashed)


def test_emulated_sensor_noise_seed_and_motor_step():
    noisy = pushed("--noise", "0.5mm", "--seed", "3")
    assert noisy == pushed("--noise", "0.5mm", "--seed", "3")
    other, still = pushed("--noise", "0.5mm", "--seed", "4"), pushed()
    assert other[0] != noisy[0] != still[0]
    assert other[1] == noisy[1] == still[1]  # the keys themselves go the same way
    assert pushed("--force-step", "0.2N")[1] != still[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mode", "20g 180Hz"], "such as '20g 180Hz 0.02'"),
        (["--static", "80mN 4s"], "--static"),
        (["--presliding", "5kN/m"], "give --dry too"),
        (["--noise", "-1mm"], "must not be negative"),
        (["--mode", "20g 9kHz 0.02"], "too fast"),
        (["--delay", "2s"], "from 0 to 1 s"),
    ],
)
def test_emulate_refuses_wrong_key_options(
    capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
):
    assert app.run(["emulate", "frame", "--udp", "0", "--seconds", "0.1", *arguments]) != 0
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "more", "message"),
    [
        ("ergon: 1\nM: 400g\nK: 60N/m\nZ: 1Ns/m\n", ["--dry", "1mN"], "--calib says what"),
        ("ergon: 1\nM: 400g\n", [], "'K'"),
        ("ergon: 1\nM: 4N\nK: 60N/m\nZ: 1Ns/m\n", [], "M of calibration"),
        ("ergon: 1\nM: 1mg\nK: 900kN/m\nZ: 0Ns/m\n", [], "above half the rate"),
    ],
)
def test_emulate_refuses_wrong_calibrations(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, more: list[str], message: str
):
    (tmp_path / "key.yaml").write_text(text)
    calib = ["--calib", str(tmp_path / "key.yaml"), *more]
    assert app.run(["emulate", "frame", "--udp", "0", "--seconds", "0.1", *calib]) in (1, 2)
    assert message in capsys.readouterr().err


def test_watchdog_releases_a_silent_emulator():
    # A busy machine may take the test away for a while: the watchdog waits longer.
    key = ("--no-gate", "--stiffness", "100N/m", "--watchdog", "2s")
    with emulator("firefader", *key) as device:
        with serial(device.url) as port:
            # 64 of 127 steps of 1.56 N on 100 N/m: 7.9 mm, 20 steps.
            until(lambda: exchange(port, bytes([0x7F, 64, 0]))[1] == 128 + 20, "7.9 mm")
        device.until("let-go")
        with serial(device.url) as port:
            until(lambda: exchange(port, bytes([0x7F, 0, 0]))[1] == 128, "a key let go")
        device.end(signal.SIGTERM)


def test_emulated_frame_replies_by_udp():
    with emulator("frame", "--udp", "0", "--axes", "2", "--lockstep") as device:
        host, _, port = device.url.removeprefix("frame+udp:").partition("?")[0].rpartition(":")
        assert host == "127.0.0.1"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            wire.settimeout(PATIENCE)
            wire.connect((host, int(port)))

            def ask(body: bytes) -> bytes:
                wire.send(b"\xa5\x5a" + body + crc(body))
                reply = wire.recv(512)
                assert crc(reply[2:-2]) == reply[-2:]
                return reply

            who = ask(struct.pack("<HBB", 7, 0, 0))
            assert struct.unpack_from("<HBB", who, 2) == (7, 2, 4 | 8)
            # Wide, motors may push, 1 N on the first: F T²/m after one period.
            reply = ask(struct.pack("<HBddB", 8, 0x82, 1.0, 0.0, 1))
            number, t, n, first, second, status = struct.unpack_from("<HIBddB", reply, 2)
            assert (number, n, second, status) == (8, 0x82, 0.0, 1 | 2)
            assert first == pytest.approx((44 / 44100) ** 2 / 0.05, rel=1e-12)
            assert t == int(44 / 44100 * 1e6)
        device.end()


def test_emulate_ends_after_its_seconds():
    with emulator("frame", "--seconds", "0.2") as device:
        over = device.next()
        assert over["event"] == "over"
        assert isinstance(over["periods"], int)
        assert over["periods"] >= 200
        assert device.process.wait(timeout=PATIENCE) == 0


@pytest.mark.parametrize(
    ("arguments", "output"),
    [
        (["firefader", "--udp", "9999"], "a firefader is emulated by --pty"),
        (["frame", "--udp", "1", "--ws", "2"], "--pty, --udp and --ws exclude each other"),
        (["haply", "--axes", "2"], "a haply has 3 axes"),
        (["frame", "--gesture", "0mm@0 6@nowhere"], "--gesture"),
        (["frame", "--mass", "0g"], "--mass"),
        (["frame", "--stiffness", "1e9N/m", "--seconds", "1"], "faster than half its rate"),
    ],
)
def test_emulate_refuses_contradicting_options(
    arguments: list[str], output: str, capsys: pytest.CaptureFixture[str]
):
    assert app.run(["emulate", *arguments]) in (1, 2)
    assert output in capsys.readouterr().err


def test_sampled_gesture_positions():
    points = notation.parse("1mm@0 smooth 6mm@1/2 line 2mm@1").points
    path = sampled_positions(points, 0.5, 1000.0)
    assert path.shape == (501,)
    assert path[[0, 250, 500]] == pytest.approx([1e-3, 6e-3, 2e-3], abs=1e-12)
    assert path[375] == pytest.approx(4e-3, abs=1e-9)
    assert np.all(np.diff(path[:251]) > -1e-9)
