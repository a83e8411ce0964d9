"""Boards of others by the open frame: a device that CHAI3D opens, and a rotary one with an arm."""

import math
import os
import shutil
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from emulators import crc
from patience import PATIENCE, until

from ergon import _core

ROOT = Path(__file__).parents[2]
BRIDGE = ROOT / "docs/firmware/chai3d_bridge/chai3d_bridge.cpp"
STUB = ROOT / "tests/data/chai3d"
PERIOD = 1e-3  # [s]
ENABLE, ASK = 1, 2
LET_GO = 8


@pytest.fixture(scope="module")
def bridge(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reference bridge, compiled against a stub of CHAI3D."""
    compiler = shutil.which(os.environ.get("CXX", "g++"))
    if compiler is None:
        pytest.skip("no C++ compiler")
    target = tmp_path_factory.mktemp("bridge") / "bridge"
    flags = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror", "-I", str(STUB)]
    subprocess.run([compiler, *flags, str(BRIDGE), "-o", str(target)], check=True)
    return target


@contextmanager
def bridged(program: Path, *options: str) -> Iterator[str]:
    """The address of a running bridge."""
    command = [str(program), "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().partition(" at ")[2].partition(",")[0]
        finally:
            process.terminate()
            assert process.wait(timeout=PATIENCE) == 0


def request(number: int, forces: list[int], flags: int) -> bytes:
    """A frame from docs/open-frame.md."""
    inner = struct.pack(f"<HB{len(forces)}hB", number, len(forces), *forces, flags)
    return b"\xa5\x5a" + inner + crc(inner)


class Host:
    """A host that speaks the open frame by hand."""

    def __init__(self, url: str, axes: int) -> None:
        name, _, port = url.removeprefix("frame+udp://").partition(":")
        self.to, self.axes, self.number = (name, int(port)), axes, 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.socket.close()

    def ask(self, forces: list[int], flags: int) -> tuple[list[float], int] | None:
        """Positions [m] and status; None if nobody answers."""
        self.number += 1
        self.socket.settimeout(0.3)
        self.socket.sendto(request(self.number, forces, flags), self.to)
        try:
            reply = self.socket.recv(256)
        except TimeoutError:
            return None
        assert reply[:2] == b"\xa5\x5a"
        assert reply[-2:] == crc(reply[2:-2])
        number, _, n = struct.unpack("<HIB", reply[2:9])
        assert (number, n) == (self.number, self.axes)
        positions = [1e-8 * x for x in struct.unpack(f"<{n}i", reply[9 : 9 + 4 * n])]
        return positions, reply[9 + 4 * n]


def test_bridge_describes_the_device_of_chai3d(bridge: Path):
    with bridged(bridge, "--axes", "zx", "--force-max", "5") as url:
        device = _core.Device(url)
        assert (device.axes, device.unit, device.lockstep) == (2, "m", False)
        assert tuple(device.range) == pytest.approx((-0.04, 0.04))
        assert device.force_max == 5.0
        assert device.direction(1, PERIOD) == 1.0
        device.close()


def test_bridge_moves_each_axis_by_its_force(bridge: Path):
    with bridged(bridge, "--axes", "zx") as url, Host(url, 2) as host:
        first = host.ask([0, 0], ENABLE)
        assert first is not None
        assert first[1] & LET_GO, "it had let go before the first force"

        def moved() -> bool:
            reply = host.ask([8192, -8192], ENABLE)  # 2 N and -2 N
            assert reply is not None
            assert not reply[1] & LET_GO
            z, x = reply[0]
            return z > 0.01 and x < -0.01

        until(moved, "both keys moved")


def test_bridge_releases_force_of_silent_host(bridge: Path):
    with bridged(bridge) as url, Host(url, 1) as owner, Host(url, 1) as other:
        assert owner.ask([3000], ENABLE) is not None
        # Who pushes owns the device, and nobody else is answered until it is silent for 50 ms.
        until(lambda: other.ask([0], ASK) is not None, "an answer after the silence")
        reply = other.ask([0], ASK)
        assert reply is not None
        assert reply[1] & LET_GO
        still = [other.ask([0], ASK) for _ in range(5)]
        places = [row[0][0] for row in still if row is not None]
        assert np.ptp(places) == 0.0, "no force acts any more"


@pytest.mark.parametrize(
    "spoilt", [b"", b"\xa5\x5a\x01", request(1, [1, 2, 3], 1), request(1, [1], 1)[:-1] + b"\x00"]
)
def test_bridge_ignores_invalid_frames(bridge: Path, spoilt: bytes):
    with bridged(bridge) as url, Host(url, 1) as host:
        host.socket.sendto(spoilt, host.to)
        reply = host.ask([0], ASK)
        assert reply is not None
        assert reply[0] == [0.0]


def test_bridge_refuses_wrong_options(bridge: Path):
    done = subprocess.run([str(bridge), "--axes", "zw"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("usage: chai3d_bridge")


class Rotary:
    """A knob that turns by 1 rad/s for 0.1 N·m, as a board of one axis in radians."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.url = f"frame+udp://127.0.0.1:{self.socket.getsockname()[1]}"
        self.angle, self.torques, self.clock = 0.0, [0.0], 0
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        self.socket.settimeout(0.05)
        while not self.over.is_set():
            try:
                data, sender = self.socket.recvfrom(256)
            except TimeoutError:
                continue
            number, n = struct.unpack("<HB", data[2:5])
            self.socket.sendto(self._info(number) if n == 0 else self._place(number, data), sender)

    def _info(self, number: int) -> bytes:
        # Torques of at most 0.1 and 0.2 N·m, from -π to π, 2e-5 kg·m², 1e-4 N·m·s.
        numbers = (0.1, 0.2, 1e-3, -math.pi, math.pi, 1000.0, 2e-5, 1e-4)
        inner = struct.pack("<HBB8f", number, 1, 1, *numbers)
        return b"\xa5\x5d" + inner + crc(inner)

    def _place(self, number: int, data: bytes) -> bytes:
        (steps,) = struct.unpack("<h", data[5:7])
        self.torques.append(0.2 * steps / 32767)
        self.angle += PERIOD * self.torques[-1] / 0.1
        self.clock += 1000
        place = round(self.angle * 1e8)
        inner = struct.pack("<HIBiB", number, self.clock, 1, place, 3)
        return b"\xa5\x5a" + inner + crc(inner)


@pytest.fixture
def knob() -> Iterator[Rotary]:
    board = Rotary()
    board.thread.start()
    yield board
    board.over.set()
    board.thread.join()
    board.socket.close()


def test_arm_option_of_rotary_device(knob: Rotary):
    """Held 5 cm from its axis, angles are ways along the arc, and 1 N is 0.05 N·m."""
    device = _core.Device(f"{knob.url}?arm=0.05")
    assert device.unit == "m"
    assert tuple(device.range) == pytest.approx((-0.05 * math.pi, 0.05 * math.pi))
    assert device.force_max == pytest.approx(0.2 / 0.05)
    assert device.resolution == pytest.approx(5e-5)
    assert device.direction(0, PERIOD) == 1.0
    knob.angle = 0.4
    _, high = device.ends(0.05, PERIOD)[0]
    assert high == pytest.approx(0.02, rel=1e-3)
    device.close()
    assert 0.0 < max(knob.torques) < 0.2


@pytest.mark.parametrize(
    ("options", "words"),
    [("?arm=0", "arm must be above 0 and at most 1 m"), ("?arm=long", "arm must be a number")],
)
def test_arm_option_refuses_impossible_values(knob: Rotary, options: str, words: str):
    with pytest.raises(_core.EngineError, match=words):
        _core.Device(knob.url + options)


def test_arm_option_of_linear_device_is_refused():
    with pytest.raises(_core.EngineError, match="its axes do not rotate"):
        _core.Device("emul:?arm=0.05")
