"""Rumble of a gamepad: what is asked of its motors for a force."""

import os
import struct
from pathlib import Path

import pytest
from patience import until

from ergon.live.pointer_address import parse_pointer_address
from ergon.live.pointer_gamepad import GamepadAxis, GamepadPort
from ergon.live.rumble import FULL_FORCE, Rumble, RumbleEnvelope
from tests.live.test_led_hands import NotedLead

UPLOAD = 0x40304580  # EVIOCSFF: _IOW('E', 0x80, struct ff_effect), which has 48 bytes


def test_rumble_envelope_of_constant_force():
    envelope = RumbleEnvelope()
    first = envelope.step(0.5 * FULL_FORCE)
    assert first == (0.5, 1.0), "the weak motor tells that something begins"
    for _ in range(40):
        last = envelope.step(-0.5 * FULL_FORCE)
    assert last[0] == 0.5
    assert last[1] < 1e-3
    assert envelope.step(3.0 * FULL_FORCE)[0] == 1.0


class Pad:
    """The kernel's side of a gamepad with motors."""

    def __init__(self) -> None:
        self.effects: list[tuple[int, int, int, int]] = []

    def ioctl(self, _file: int, request: int, data: bytes) -> bytes:
        """Answer as the driver of a gamepad with rumble does."""
        if request != UPLOAD:
            raise OSError
        assert len(data) == 48
        kind, number = struct.unpack_from("Hh", data)
        length, delay = struct.unpack_from("HH", data, 10)
        strong, weak = struct.unpack_from("HH", data, 16)
        assert (kind, delay) == (0x50, 0)
        self.effects.append((number, length, strong, weak))
        return data[:2] + struct.pack("h", 3) + data[4:]  # the kernel says the effect's number


@pytest.fixture
def pad(monkeypatch: pytest.MonkeyPatch) -> Pad:
    result = Pad()
    monkeypatch.setattr("fcntl.ioctl", result.ioctl)
    return result


def test_rumble_uploads_one_effect_and_plays_it(pad: Pad):
    read, write = os.pipe()
    rumble = Rumble(write)
    assert rumble.is_available
    rumble.set_force(0.0)
    rumble.set_force(FULL_FORCE)
    assert pad.effects == [(-1, 200, 0, 0), (3, 200, 0xFFFF, 0xFFFF)]
    *_, kind, number, value = struct.unpack("llHHi", os.read(read, 100))
    assert (kind, number, value) == (0x15, 3, 1)
    os.close(read)
    os.close(write)


def test_rumble_of_gamepad_without_motors():
    read, write = os.pipe()
    rumble = Rumble(write)
    assert not rumble.is_available
    rumble.set_force(FULL_FORCE)
    os.close(write)
    assert os.read(read, 1) == b""
    os.close(read)


class PulledLead(NotedLead):
    """A lead whose finger is pulled."""

    force = -0.4 * FULL_FORCE


def test_gamepad_port_rumbles_with_finger_force(pad: Pad, tmp_path: Path):
    pipe = tmp_path / "pad"
    os.mkfifo(pipe)
    writer = os.open(pipe, os.O_RDWR)
    values = GamepadAxis(parse_pointer_address("gamepad:ly"), PulledLead())  # type: ignore[arg-type]
    port = GamepadPort(pipe, [values])
    assert port.has_rumble
    until(lambda: len(pad.effects) > 20, "an effect that is renewed")
    port.close()
    os.close(writer)
    assert {strong for *_, strong, _ in pad.effects[1:]} == {round(0.4 * 0xFFFF)}
    assert pad.effects[1][3] > 10 * pad.effects[20][3], "the buzz of the beginning dies away"
