"""OSC for a performance: sockets, a thread of its own, and bounds on the number of answers."""

from __future__ import annotations

import contextlib
import hmac
import re
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.scores.staging.drives import input_id

from .datagrams import (
    DATAGRAM_BYTES_MAX,
    MalformedDatagramError,
    encode_message,
    parse_messages,
    require_python_osc,
)
from .osc_in import OscRequestError, is_harmless, refuse_command, request_handlers
from .osc_out import OscSender
from .osc_senders import SenderAccess, SenderCheck
from .osc_values import InputValues

if TYPE_CHECKING:
    from ergon.scores.staging.stage import Stage

    from .osc_in import Command, HandlerTable
    from .osc_out import Send

    HostPort = tuple[str, int]

LOOPBACK = "127.0.0.1"
_CHECK_PERIOD = 0.005  # [s] between two looks at the performance
_DATAGRAMS_AT_ONCE = 64  # datagrams read before the next look at the performance
_ANSWERS_PER_SECOND = 10  # a second: a flood of mistakes gets no flood of answers
_REFUSALS_PER_SECOND = 2  # to strangers; other senders keep their answers
KEY_PATTERN = re.compile(r"[A-Za-z0-9_-]{16,64}")
KEY_VARIABLE = "ERGON_OSC_KEY"
_UNKNOWN_ADDRESSES_MAX = 1000  # unknown addresses that are remembered, each reported once
_ADDRESS_SHOWN_MAX = 80  # characters of an unknown address in a report


class OscError(ErgonError):
    """An address that OSC cannot use, or a socket that does not open."""


def parse_address(address_text: str) -> HostPort:
    """`[HOST:]PORT` as (host, port); without a host, only this machine. Raises OscError."""
    host, _, port = address_text.rpartition(":")
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise OscError(
            f"{address_text}: an OSC address is PORT or HOST:PORT, such as {LOOPBACK}:9000"
        )
    return host.removeprefix("[").removesuffix("]") or LOOPBACK, int(port)


class OscServer:
    """Receives requests at one address and sends events to another; either may be None."""

    def __init__(
        self,
        receive_address: HostPort | None,
        send_address: HostPort | None,
        run_command: Command = refuse_command,
        key: str = "",
    ) -> None:
        """Open the sockets; a sender that writes the `key` before an address is the user.

        Raises OscError, or PythonOscMissingError without python-osc.
        """
        require_python_osc()
        if key and not KEY_PATTERN.fullmatch(key):
            raise OscError(f"{KEY_VARIABLE} must be 16 to 64 letters, digits, _ or -")
        self._key = key
        self._sender_check = SenderCheck()
        self._has_hands: Callable[[], bool] = lambda: False
        self._run_command = run_command
        self._inbound = (
            None if receive_address is None else _open_socket(receive_address, is_bound=True)
        )
        self._outbound = (
            None if send_address is None else _open_socket(send_address, is_bound=False)
        )
        self.address = None if self._inbound is None else self._inbound[0].getsockname()[:2]
        self.is_stop_requested = False  # somebody asked for the end
        self.n_malformed = 0  # datagrams that were no OSC
        self.n_unsent = 0  # datagrams that did not leave
        self._remarks: deque[str] = deque(maxlen=100)
        self._unknown_addresses: set[str] = set()
        self._reported_refusals: set[str] = set()
        self._answer_limit = _RateLimit(_ANSWERS_PER_SECOND)
        self._refusal_limit = _RateLimit(_REFUSALS_PER_SECOND)
        self._current_sender: tuple[object, ...] = ()
        self._handlers: HandlerTable = {}
        self._event_sender: OscSender | None = None
        self._input_values: InputValues | None = None
        self._end_event = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(
        self, performance: _core.Performance, stage: Stage, gain: float, start_frame: int = 0
    ) -> None:
        """Serve a performance that began at frame `start_frame` with a `gain` (ratio)."""

        def stop() -> None:
            self.is_stop_requested = True
            performance.stop()

        def set_input(name: str, value: float) -> bool:
            return performance.tell(input_id(name), value) is not None

        input_values = InputValues(set_input)
        handlers = request_handlers(
            performance, stage, gain, stop, input_values.handler_of, self._run_command
        )
        self.serve(
            handlers,
            lambda send: OscSender(performance, stage, start_frame, send),
            input_values,
            lambda: bool(performance.status().hands),
        )

    def serve(
        self,
        handlers: HandlerTable,
        make_sender: Callable[[Send], OscSender],
        input_values: InputValues,
        has_hands: Callable[[], bool],
    ) -> None:
        """Serve requests by a table of addresses, pass values to inputs, and send the messages of
        the sender that `make_sender` makes. `has_hands`: whether forces act on live hands.
        """
        self._handlers, self._input_values, self._has_hands = handlers, input_values, has_hands
        self._event_sender = make_sender(self._send) if self._outbound else None
        self._end_event.clear()
        self._thread = threading.Thread(target=self._run, name="ergon osc", daemon=True)
        self._thread.start()

    def answerer(self) -> Callable[[str, str], None]:
        """A function that answers the present request, now or later, with an address and a
        sentence.
        """
        return partial(self._answer, self._current_sender)

    def stop_serving(self) -> None:
        """End serving a performance; events that wait are still sent."""
        if self._thread is None:
            return
        self._end_event.set()
        self._thread.join()
        self._thread = None
        self._send_messages()

    def close(self) -> None:
        """Close the sockets."""
        self.stop_serving()
        for socket_and_address in (self._inbound, self._outbound):
            if socket_and_address is not None:
                socket_and_address[0].close()

    def remarks(self) -> list[str]:
        """Remarks since the last call, one sentence each."""
        remarks = []
        with contextlib.suppress(IndexError):
            while True:
                remarks.append(self._remarks.popleft())
        return remarks

    def _run(self) -> None:
        next_check = time.monotonic()
        while not self._end_event.is_set():
            self._receive(next_check - time.monotonic())
            if time.monotonic() >= next_check:
                next_check = max(next_check + _CHECK_PERIOD, time.monotonic())
                self._send_messages()
                if self._input_values is not None:
                    with contextlib.suppress(_core.EngineError):
                        self._input_values.send_due_values()

    def _send_messages(self) -> None:
        if self._event_sender is not None:
            with contextlib.suppress(_core.EngineError):  # the performance is closed already
                self._event_sender.send_new(time.time)

    def _send(
        self, address: str, arguments: Sequence[object], instant: float | None = None
    ) -> None:
        if self._outbound is not None:
            self._send_datagram(*self._outbound, encode_message(address, arguments, instant))

    def _send_datagram(
        self, sending_socket: socket.socket, target_address: tuple[object, ...], datagram: bytes
    ) -> None:
        try:
            sending_socket.sendto(datagram, target_address)
        except OSError:
            self.n_unsent += 1

    def _receive(self, timeout_seconds: float) -> None:
        """Handle the requests that have come; wait up to `timeout_seconds` [s] for one."""
        if self._inbound is None:
            self._end_event.wait(max(0.0, timeout_seconds))
            return
        listening_socket = self._inbound[0]
        if not select.select([listening_socket], [], [], max(0.0, timeout_seconds))[0]:
            return
        datagrams = []
        is_empty = False
        for _ in range(_DATAGRAMS_AT_ONCE):
            try:
                datagrams.append(listening_socket.recvfrom(DATAGRAM_BYTES_MAX + 1))
            except BlockingIOError:
                is_empty = True
                break
            except OSError:
                self.n_malformed += 1  # too long, where the system says so
        self._sender_check.look_up_senders(sender for _, sender in datagrams)
        for datagram, sender in datagrams:
            self._handle(datagram, sender)
        if is_empty:
            self._sender_check.count_empty_queue()

    def _handle(self, datagram: bytes, sender: tuple[object, ...]) -> None:
        try:
            if len(datagram) > DATAGRAM_BYTES_MAX:
                raise MalformedDatagramError
            messages = parse_messages(datagram)
        except MalformedDatagramError:
            self.n_malformed += 1
            return
        self._current_sender = sender
        sender_access = self._sender_check.access(sender)
        for written_address, message_arguments in messages:
            address = self._without_key(written_address)
            if address is None:
                address = written_address
                if refusal := self._refusal_reason(sender_access, address):
                    self._refuse(sender, refusal)
                    continue
            handler = self._handlers.get(address)
            try:
                if handler is None:
                    self._report_unknown(address)
                else:
                    handler(message_arguments)
            except OscRequestError as error:
                self._answer(sender, "/ergon/error", str(error))
            except _core.EngineError:
                return  # the server has ended

    def _without_key(self, address: str) -> str | None:
        """An address without the key before it; None if it has no key, or another one."""
        key, slash, address_rest = address.removeprefix("/").partition("/")
        is_same_key = self._key and hmac.compare_digest(key.encode(), self._key.encode())
        return slash + address_rest if is_same_key else None

    def _refusal_reason(self, sender_access: SenderAccess, address: str) -> str:
        """Why a request without the key is refused; empty if it is heard."""
        if sender_access.is_user:
            return ""
        hint = f"write the key before the address, /KEY/ergon/… ({KEY_VARIABLE})"
        if sender_access.is_identified:
            return f"the sender is not heard: {sender_access.reason}; {hint}"
        if self._key:
            return f"the sender is not heard without the key; {hint}"
        if self._has_hands() and not is_harmless(address):
            return f"this needs the key, for it can change a force on a hand; {hint}"
        return ""

    def _refuse(self, sender: tuple[object, ...], refusal: str) -> None:
        """Answer a stranger, and report each kind of refusal once."""
        if refusal not in self._reported_refusals:
            self._reported_refusals.add(refusal)
            self._remarks.append(f"osc: {refusal}")
        if self._inbound is not None and self._refusal_limit.may_send():
            self._send_datagram(self._inbound[0], sender, encode_message("/ergon/error", [refusal]))

    def _report_unknown(self, address: str) -> None:
        """Report an unknown address once; the number of reports a second is limited."""
        if (
            address in self._unknown_addresses
            or len(self._unknown_addresses) >= _UNKNOWN_ADDRESSES_MAX
            or not self._answer_limit.may_send()
        ):
            return
        self._unknown_addresses.add(address)
        self._remarks.append(f"osc: no address {_printable(address)}")

    def _answer(self, sender: tuple[object, ...], address: str, sentence: str) -> None:
        if self._inbound is not None and self._answer_limit.may_send():
            self._send_datagram(self._inbound[0], sender, encode_message(address, [sentence]))


class _RateLimit:
    """A bound on datagrams a second."""

    def __init__(self, n_per_second: int) -> None:
        self._instants: deque[float] = deque(maxlen=n_per_second)

    def may_send(self) -> bool:
        """Whether another one may be sent now."""
        now = time.monotonic()
        if len(self._instants) == self._instants.maxlen and now - self._instants[0] < 1.0:
            return False
        self._instants.append(now)
        return True


def _printable(address: str) -> str:
    """An address in a form that is safe to print in a terminal."""
    return ascii(address[:_ADDRESS_SHOWN_MAX])[1:-1]


def _open_socket(
    osc_address: HostPort, *, is_bound: bool
) -> tuple[socket.socket, tuple[object, ...]]:
    """A datagram socket, and the address that `osc_address` names."""
    open_socket = None
    try:
        family, socket_kind, protocol, _, address = socket.getaddrinfo(
            *osc_address, type=socket.SOCK_DGRAM
        )[0]
        open_socket = socket.socket(family, socket_kind, protocol)
        open_socket.setblocking(False)
        if is_bound:
            open_socket.bind(address)
    except (OSError, UnicodeError) as error:
        if open_socket is not None:
            open_socket.close()
        failure_text = "cannot listen at" if is_bound else "cannot send to"
        raise OscError(f"{failure_text} {osc_address[0]}:{osc_address[1]}: {error}") from None
    return open_socket, address
