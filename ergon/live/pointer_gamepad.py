"""Sticks and triggers of gamepads as positions of keys, by the events of Linux (evdev)."""

from __future__ import annotations

import contextlib
import os
import select
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .boards import BoardError
from .pointer_address import GAMEPAD_AXES
from .pointer_sources import key_position
from .rumble import Rumble

if TYPE_CHECKING:
    from ergon import _core

    from .pointer_address import PointerAddress

_EVENT_STRUCT = struct.Struct("llHHi")  # seconds, microseconds, type, code, value
_AXIS_INFO_STRUCT = struct.Struct("6i")  # value, least, greatest, fuzz, flat, resolution
_ABSOLUTE_TYPE = 3  # the type of events of sticks
_GET_RANGE = 0x80184540  # EVIOCGABS(0)
_SET_CLOCK = 0x400445A0  # EVIOCSCLOCKID
_EVENTS_AT_ONCE = 64
_POLL_SECONDS = 0.2  # [s] between two looks whether a thread is to end
_RUMBLE_SECONDS = 0.05  # [s] between two forces that the motors tell of
_USUAL_RANGE = (-32768, 32767)  # range for event files, which have no device
_PADS_FOLDER = Path("/dev/input/by-id")
_PAD_NAMES = "*-event-joystick"


class GamepadAxis:
    """Passes events of one axis on as positions of a key."""

    def __init__(self, address: PointerAddress, pointer: _core.Lead) -> None:
        """The ends of the axis are those of the key."""
        self._address, self._pointer = address, pointer
        self.code, self._sign = GAMEPAD_AXES[address.control]
        self.range = _USUAL_RANGE

    def receive(self, value: int, instant: float) -> None:
        """Take a value that came at an instant [s, time.monotonic; in lockstep, of the ticks]."""
        low_end, high_end = self.range
        signed_fraction = self._sign * (2.0 * (value - low_end) / (high_end - low_end) - 1.0)
        is_lockstep = self._address.lockstep
        report_instant = (
            instant if is_lockstep else self._pointer.now() - (time.monotonic() - instant)
        )
        self._pointer.place(report_instant, key_position(self._pointer, signed_fraction))

    @property
    def force(self) -> float:
        """The force of the pointer on its finger [N], without a sign."""
        return abs(self._pointer.force)

    def disconnect(self) -> None:
        """The gamepad is gone: the stand-in plays."""
        self._pointer.set_present(False)


def stick_events(event_bytes: bytes) -> Iterator[tuple[int, int, float]]:
    """(number of the axis, value, instant [s]) of each event of a stick; others are left out."""
    for seconds, microseconds, event_type, code, value in _EVENT_STRUCT.iter_unpack(event_bytes):
        if event_type == _ABSOLUTE_TYPE:
            yield code, value, seconds + 1e-6 * microseconds


def gamepads() -> list[Path]:
    """The gamepads of this machine, by names that stay."""
    return sorted(_PADS_FOLDER.glob(_PAD_NAMES)) if _PADS_FOLDER.is_dir() else []


def pad_path(pad_name: str) -> Path:
    """The device of a gamepad: the path `pad_name`, or the only one there is. Raises BoardError."""
    if pad_name:
        return Path(pad_name)
    pads = gamepads()
    if len(pads) == 1:
        return pads[0]
    pad_list = ", ".join(map(str, pads)) or "none"
    raise BoardError(f"which gamepad? ?in=PATH says so; there is {pad_list}")


def _open_pad(path: Path) -> int:
    """The file of a gamepad, for writing too where that is allowed: then it may rumble."""
    if path.is_char_device():  # a pipe of events that is open for writing would never end
        with contextlib.suppress(PermissionError):
            return os.open(path, os.O_RDWR | os.O_NONBLOCK)
    return os.open(path, os.O_RDONLY | os.O_NONBLOCK)


class GamepadPort:
    """An open gamepad, whose events are passed on by their axes."""

    def __init__(self, path: Path, axes: Sequence[GamepadAxis]) -> None:
        """Open a gamepad. Raises BoardError."""
        try:
            self._file = _open_pad(path)
        except OSError as error:
            raise BoardError(f"the gamepad {path} cannot be opened: {error.strerror}") from None
        self._axes = axes
        self._rumble = Rumble(self._file)
        self._end_event = threading.Event()
        self._rumble_instant = 0.0  # of the last force that the motors signalled [s]
        self._configure()
        self._thread = threading.Thread(target=self._run, name="ergon gamepad", daemon=True)
        self._thread.start()

    def _configure(self) -> None:
        """Learn the ranges of the axes, and let events bear the times of `time.monotonic`."""
        import fcntl

        with contextlib.suppress(OSError):  # a file or a pipe of events
            fcntl.ioctl(self._file, _SET_CLOCK, struct.pack("i", time.CLOCK_MONOTONIC))
        for axis in self._axes:
            with contextlib.suppress(OSError):
                range_bytes = fcntl.ioctl(
                    self._file, _GET_RANGE + axis.code, bytes(_AXIS_INFO_STRUCT.size)
                )
                _, low_end, high_end, *_ = _AXIS_INFO_STRUCT.unpack(range_bytes)
                if low_end < high_end:
                    axis.range = (low_end, high_end)

    def _run(self) -> None:
        while not self._end_event.is_set():
            wait_seconds = _RUMBLE_SECONDS if self._rumble.is_available else _POLL_SECONDS
            ready_files = select.select([self._file], [], [], wait_seconds)[0]
            self._update_rumble()
            if not ready_files:
                continue
            try:
                event_bytes = os.read(self._file, _EVENTS_AT_ONCE * _EVENT_STRUCT.size)
            except OSError:  # unplugged
                event_bytes = b""
            if not event_bytes:
                for axis in self._axes:
                    axis.disconnect()
                return
            for code, value, event_instant in stick_events(
                event_bytes[: len(event_bytes) // _EVENT_STRUCT.size * _EVENT_STRUCT.size]
            ):
                for axis in self._axes:
                    if axis.code == code:
                        axis.receive(value, event_instant)

    @property
    def has_rumble(self) -> bool:
        """Whether its motors signal forces."""
        return self._rumble.is_available

    def _update_rumble(self) -> None:
        """Let the motors tell of the greatest force on its fingers."""
        instant_now = time.monotonic()
        if self._rumble.is_available and instant_now >= self._rumble_instant + _RUMBLE_SECONDS:
            self._rumble_instant = instant_now
            self._rumble.set_force(max((axis.force for axis in self._axes), default=0.0))

    def close(self) -> None:
        """Pass on nothing any more."""
        self._end_event.set()
        self._thread.join()
        os.close(self._file)
