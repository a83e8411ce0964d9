"""Where positions of keys without a device come from: messages of MIDI and OSC, from threads of
their own.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from .boards import BoardError
from .datagrams import (
    DATAGRAM_BYTES_MAX,
    MalformedDatagramError,
    PythonOscMissingError,
    parse_messages,
    require_python_osc,
)
from .midi_messages import ControlChange, Message, PitchWheel, Pressure, parse_message
from .midi_ports import InputPort, MidiError, SystemInput

if TYPE_CHECKING:
    from ergon import _core

    from .pointer_address import PointerAddress

_LOOPBACK = "127.0.0.1"
_POLL_SECONDS = 0.2  # [s] between two looks whether a thread is to end
_FINE_OFFSET = 32  # a controller below this has its finer bits in the one that is 32 higher
_PITCH_BEND_CENTRE = 0x2000  # middle of 14 bits
_FOURTEEN_BIT_MAX = 0x3FFF
_SEVEN_BIT_MAX = 127


class MidiPositionReceiver:
    """Passes a MIDI controller, wheel or pressure on as positions of a key."""

    def __init__(self, address: PointerAddress, pointer: _core.Lead) -> None:
        """The lowest value is the lower end of the key, the highest the upper."""
        self._address, self._pointer = address, pointer
        self._coarse = 0
        self._has_fine = False

    def receive(self, message_bytes: bytes, instant: float) -> None:
        """Take a message that came at an instant [s, time.monotonic; in lockstep, of the ticks]."""
        channel = self._address.channel
        if channel is not None and message_bytes and message_bytes[0] & 0x0F != channel - 1:
            return
        fraction = self._range_fraction(parse_message(message_bytes))
        if fraction is not None:
            pointer_position = key_position(self._pointer, 2.0 * (fraction - 0.5))
            self._pointer.place(
                _pointer_time(self._address, self._pointer, instant), pointer_position
            )

    def _range_fraction(self, message: Message | None) -> float | None:
        """Where in its range a value is, 0 to 1; None for other messages."""
        controller = self._address.controller
        if isinstance(message, ControlChange) and controller is not None:
            return self._controller_fraction(message, controller)
        if isinstance(message, PitchWheel) and self._address.control == "bend":
            # The middle is exactly the middle, though there are more values below it than above.
            value_from_middle = message.value - _PITCH_BEND_CENTRE
            return 0.5 + 0.5 * value_from_middle / (
                _PITCH_BEND_CENTRE
                if value_from_middle < 0
                else _FOURTEEN_BIT_MAX - _PITCH_BEND_CENTRE
            )
        if isinstance(message, Pressure) and self._address.control == "pressure":
            return message.value / _SEVEN_BIT_MAX
        return None

    def _controller_fraction(self, message: ControlChange, controller: int) -> float | None:
        if message.number == controller:
            self._coarse = message.value
            return (
                (message.value << 7) / _FOURTEEN_BIT_MAX
                if self._has_fine
                else message.value / _SEVEN_BIT_MAX
            )
        if message.number == controller + _FINE_OFFSET and controller < _FINE_OFFSET:
            self._has_fine = True
            return (self._coarse << 7 | message.value) / _FOURTEEN_BIT_MAX
        return None


class OscPositionReceiver:
    """Passes messages of an OSC address on as positions of a key.

    The first argument is the position, -1 to 1; a second one the pressure, 0 to 1. A message
    without arguments lifts the finger.
    """

    def __init__(self, address: PointerAddress, pointer: _core.Lead) -> None:
        """Full scale is the whole travel of the key."""
        self._address, self._pointer = address, pointer

    @property
    def path(self) -> str:
        """The address of the messages."""
        return self._address.control

    def receive(self, arguments: Sequence[object], instant: float) -> None:
        """Take the arguments of a message that came at an instant [s], as `MidiPositionReceiver`
        does.
        """
        pointer_time = _pointer_time(self._address, self._pointer, instant)
        if not arguments:
            self._pointer.lift(pointer_time)
            return
        numbers = [_number_or_nan(argument) for argument in arguments[:2]]
        signed_fraction, pressure = numbers[0], numbers[1] if len(numbers) > 1 else 0.5
        self._pointer.place(
            pointer_time, key_position(self._pointer, signed_fraction), 2.0 * pressure
        )


def key_position(pointer: _core.Lead, signed_fraction: float) -> float:
    """A position [m] of a key, -1 at the lower end of its travel and 1 at the upper."""
    low_end, high_end = pointer.range
    return 0.5 * (low_end + high_end) + 0.5 * (high_end - low_end) * signed_fraction


def _number_or_nan(argument: object) -> float:
    """A number; what is not one becomes NaN, which a pointer refuses and counts."""
    is_number = isinstance(argument, int | float) and not isinstance(argument, bool)
    try:
        return float(argument) if is_number else math.nan  # type: ignore[arg-type]
    except OverflowError:
        return math.nan


def _pointer_time(address: PointerAddress, pointer: _core.Lead, instant: float) -> float:
    return instant if address.lockstep else pointer.now() - (time.monotonic() - instant)


class OscPort:
    """A socket on this machine whose messages are passed on by their addresses."""

    def __init__(self, port: int) -> None:
        """Open the port. Raises BoardError."""
        try:
            require_python_osc()
        except PythonOscMissingError as error:
            raise BoardError(str(error)) from None
        self._handlers: dict[str, OscPositionReceiver] = {}
        self._end_event = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((_LOOPBACK, port))
        except OSError as error:
            self._socket.close()
            raise BoardError(
                f"OSC port {port} cannot be opened ({error.strerror}); ?port=NUMBER takes another"
            ) from None
        self._socket.settimeout(_POLL_SECONDS)
        self._thread = threading.Thread(target=self._run, name="ergon hands osc", daemon=True)

    @property
    def port(self) -> int:
        """Its number."""
        return int(self._socket.getsockname()[1])

    def add(self, receiver: OscPositionReceiver) -> None:
        """Pass the messages of an address on; before `begin`."""
        self._handlers[receiver.path] = receiver

    def begin(self) -> None:
        """Receive messages."""
        self._thread.start()

    def _run(self) -> None:
        while not self._end_event.is_set():
            try:
                datagram = self._socket.recv(DATAGRAM_BYTES_MAX)
            except TimeoutError:
                continue
            except OSError:
                return
            message_instant = time.monotonic()
            try:
                messages = parse_messages(datagram)
            except MalformedDatagramError:
                continue
            for path, arguments in messages:
                if path in self._handlers:
                    self._handlers[path].receive(arguments, message_instant)

    def close(self) -> None:
        """Receive nothing any more."""
        self._end_event.set()
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()


def open_midi_input(
    port_name: str,
    receivers: Sequence[MidiPositionReceiver],
    open_port: Callable[[str], InputPort] = SystemInput,
) -> InputPort:
    """An open MIDI input that passes its messages to all listeners. Raises BoardError."""
    try:
        port = open_port(port_name)
    except MidiError as error:
        raise BoardError(str(error)) from None

    def receive(data: bytes, instant: float) -> None:
        for receiver in receivers:
            receiver.receive(data, instant)

    port.listen(receive)
    return port
