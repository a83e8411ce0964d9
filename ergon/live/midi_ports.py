"""MIDI ports: those of the system, by supriya-midi, and one inside the process for tests."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command

if TYPE_CHECKING:
    from collections.abc import Sequence

VIRTUAL = "virtual"  # a port that other programs connect to
CLIENT_NAME = "ergon"
_DELAYS_KEPT = 48  # messages
_PAUSE_MAX = 1.0  # [s] between two messages, after which the estimate begins anew

# Called with the bytes of each message and the instant at which it came [s, time.monotonic].
MessageReceiver = Callable[[bytes, float], None]


class MidiError(ErgonError):
    """A MIDI port cannot be opened, or supriya-midi is missing: one sentence says why."""


class InputPort(Protocol):
    """Where messages come from."""

    @property
    def name(self) -> str:
        """The name that the system gives it."""

    def listen(self, receive: MessageReceiver) -> None:
        """Pass every message to `receive`, from any thread."""

    def close(self) -> None:
        """Pass on nothing any more."""


class ProcessPort:
    """Both ends of a port inside this process: a sent message is kept and passed on at once."""

    name = "in-process"

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Stamp messages by `clock` [s]."""
        self._clock = clock
        self._receive: MessageReceiver | None = None
        self.sent: list[tuple[float, bytes]] = []

    def listen(self, receive: MessageReceiver) -> None:
        """Pass every message to `receive`."""
        self._receive = receive

    def send(self, data: bytes) -> None:
        """Keep a message, and pass it to the listener."""
        self.deliver(data, self._clock())

    def deliver(self, message_bytes: bytes, message_instant: float) -> None:
        """Like `send`, with the message stamped by the instant `message_instant` [s]."""
        self.sent.append((message_instant, message_bytes))
        if self._receive is not None:
            self._receive(message_bytes, message_instant)

    def close(self) -> None:
        """Pass on nothing any more."""
        self._receive = None


class ArrivalStamps:
    """Finds when messages really came, from the intervals between them that the system reports.

    Python receives a message with a varying delay, never early: the smallest delay among the
    latest messages is taken as true.
    """

    def __init__(self) -> None:
        """Begin before the first message."""
        self._elapsed_seconds = 0.0  # the system clock at the first message [s]
        self._delays: deque[float] = deque(maxlen=_DELAYS_KEPT)

    def stamp(self, seconds_since: float, instant_now: float) -> float:
        """The instant [s] of a message that came `seconds_since` seconds after the last one and was
        received at `instant_now`.
        """
        self._elapsed_seconds += seconds_since if 0.0 <= seconds_since < _PAUSE_MAX else 0.0
        delay = instant_now - self._elapsed_seconds
        if self._delays and abs(delay - min(self._delays)) > _PAUSE_MAX:
            self._delays.clear()
        self._delays.append(delay)
        return self._elapsed_seconds + min(self._delays)


class SystemInput:
    """An input port of ALSA, JACK, CoreMIDI or Windows."""

    def __init__(self, port_name: str) -> None:
        """Open the input whose name contains `port_name`, or for `virtual` a new one named ergon.

        Raises MidiError.
        """
        rtmidi = _rtmidi()
        self._port, self.name = _open_port(rtmidi, rtmidi.MidiIn, port_name, "input")
        self._port.ignore_types(sysex=True, timing=False, active_sense=True)

    def listen(self, receive: MessageReceiver) -> None:
        """Pass every message to `receive`, from a thread of RtMidi."""

        stamps = ArrivalStamps()

        def forward(data: Sequence[int], seconds_since: float, _context: object) -> None:
            receive(bytes(data), stamps.stamp(float(seconds_since), time.monotonic()))

        self._port.set_callback(forward)

    def close(self) -> None:
        """Pass on nothing any more."""
        self._port.cancel_callback()
        _close(self._port)


class SystemOutput:
    """An output port of ALSA, JACK, CoreMIDI or Windows."""

    def __init__(self, port_name: str) -> None:
        """Open the output whose name contains `port_name`, or for `virtual` a new one named ergon.

        Raises MidiError.
        """
        rtmidi = _rtmidi()
        self._error_types = _error_types(rtmidi)
        self._lock = threading.Lock()
        self._port, self.name = _open_port(rtmidi, rtmidi.MidiOut, port_name, "output")

    def send(self, data: bytes) -> None:
        """Send a message now; one that cannot be sent is lost."""
        with self._lock:
            try:
                self._port.send_message(data)
            except self._error_types:
                return

    def close(self) -> None:
        """Send nothing any more."""
        with self._lock:
            _close(self._port)


def _rtmidi() -> Any:
    try:
        import supriya_midi
    except ImportError as error:
        # The library of ALSA is the system's, and may be missing where supriya-midi is not.
        reason = "" if isinstance(error, ModuleNotFoundError) else f" ({error})"
        command = install_command("midi")
        raise MidiError(f"MIDI needs supriya-midi{reason}; install it by: {command}") from None
    return supriya_midi


def _error_types(rtmidi: Any) -> tuple[type[Exception], ...]:
    # RtMidi's errors come as RuntimeError where they are raised before a port has its callback.
    return (rtmidi.RtMidiError, RuntimeError, NotImplementedError, ValueError)


def _close(port: Any) -> None:
    port.close_port()
    port.delete()  # only this closes a virtual port


def input_names() -> list[str]:
    """The names of this machine's MIDI inputs; opens none. Raises MidiError."""
    rtmidi = _rtmidi()
    port_names: list[str] = []
    for midi_api in rtmidi.get_compiled_api():
        with contextlib.suppress(rtmidi.RtMidiError, NotImplementedError):
            port = rtmidi.MidiIn(midi_api)
            port_names += [str(name) for name in port.get_ports()]
            port.delete()
    return port_names


def _open_port(rtmidi: Any, make_client: Any, port_name: str, direction: str) -> tuple[Any, str]:
    """An open port of one of this machine's MIDI systems, and its name.

    Raises MidiError.
    """
    numbered_ports: list[tuple[Any, int, str]] = []
    port_error = "this machine has no MIDI"
    for midi_api in rtmidi.get_compiled_apis():
        if midi_api == rtmidi.RtMidiAPI.RTMIDI_DUMMY:
            continue
        try:
            port = make_client(midi_api, CLIENT_NAME)
            if port_name == VIRTUAL:
                port.open_virtual_port(CLIENT_NAME)
                return port, f"{CLIENT_NAME} (virtual)"
            numbered_ports += [
                (port, number, str(name)) for number, name in enumerate(port.get_ports())
            ]
        except _error_types(rtmidi) as error:
            port_error = str(error)
    if port_name == VIRTUAL:
        raise MidiError(f"no MIDI {direction} of ergon's own can be opened: {port_error}")
    port, port_number, opened_name = numbered_ports[
        choose_port(port_name, [name for *_, name in numbered_ports], direction)
    ]
    try:
        port.open_port(port_number, CLIENT_NAME)
    except _error_types(rtmidi) as error:
        raise MidiError(f"the MIDI {direction} {opened_name} cannot be opened: {error}") from None
    return port, opened_name


def choose_port(port_name: str, port_names: Sequence[str], direction: str) -> int:
    """The number of the port called `port_name`, or of the only one that contains it. Raises
    MidiError.
    """
    exact_matches = [number for number, name in enumerate(port_names) if name == port_name]
    partial_matches = [
        port_number
        for port_number, name in enumerate(port_names)
        if port_name and port_name.lower() in name.lower()
    ]
    candidates = exact_matches or partial_matches
    if len(candidates) == 1:
        return candidates[0]
    mismatch_text = (
        f"{len(candidates)} MIDI {direction}s are called so: "
        if candidates
        else f"no MIDI {direction} is called"
    )
    shown_names = ", ".join(
        f"'{port_names[port_number]}'" for port_number in (candidates or range(len(port_names)))
    )
    if candidates:
        raise MidiError(f"{mismatch_text}{shown_names}; write more of the name")
    existing_ports = f"there are {shown_names}" if port_names else "there is none"
    raise MidiError(
        f"{mismatch_text} '{port_name}'; {existing_ports}; `{VIRTUAL}` opens one of ergon's own"
    )
