"""OSC for a performance: sockets, a thread of its own, and bounds on the number of answers."""

from __future__ import annotations

import contextlib
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
from ergon.scores.staging.drives import input_number

from .datagrams import (
    DATAGRAM_BYTES_MAX,
    MalformedDatagramError,
    encode_message,
    parse_messages,
    require_python_osc,
)
from .osc_in import OscRequestError, refuse_command, request_handlers
from .osc_out import OscSender
from .osc_values import InputValues

if TYPE_CHECKING:
    from ergon.scores.staging.stage import Stage

    from .osc_in import Command, HandlerTable
    from .osc_out import Send

    Place = tuple[str, int]

LOOPBACK = "127.0.0.1"
_CHECK_PERIOD = 0.005  # [s] between two looks at the performance
_DATAGRAMS_AT_ONCE = 64  # datagrams read before the next look at the performance
_ANSWERS_PER_SECOND = 10  # a second: a flood of mistakes gets no flood of answers
_UNKNOWN_MAX = 1000  # unknown addresses that are remembered, each reported once
_ADDRESS_SHOWN_MAX = 80  # characters of an unknown address in a report


class OscError(ErgonError):
    """An address that OSC cannot use, or a socket that does not open."""


def parse_address(text: str) -> Place:
    """`[HOST:]PORT` as (host, port); without a host, only this machine. Raises OscError."""
    host, _, port = text.rpartition(":")
    if not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise OscError(f"{text}: an OSC address is PORT or HOST:PORT, such as {LOOPBACK}:9000")
    return host.removeprefix("[").removesuffix("]") or LOOPBACK, int(port)


class OscServer:
    """Receives requests at the address `here` and sends events to `there`; either may be None."""

    def __init__(
        self, here: Place | None, there: Place | None, command: Command = refuse_command
    ) -> None:
        """Open the sockets. Raises OscError, or PythonOscMissingError without python-osc."""
        require_python_osc()
        self._command = command
        self._here = None if here is None else _open_socket(here, bound=True)
        self._there = None if there is None else _open_socket(there, bound=False)
        self.place = None if self._here is None else self._here[0].getsockname()[:2]
        self.stopped = False  # somebody asked for the end
        self.malformed = 0  # datagrams that were no OSC
        self.unsent = 0  # datagrams that did not leave
        self._remarks: deque[str] = deque(maxlen=100)
        self._unknown: set[str] = set()
        self._answers: deque[float] = deque(maxlen=_ANSWERS_PER_SECOND)
        self._sender: tuple[object, ...] = ()
        self._handlers: HandlerTable = {}
        self._teller: OscSender | None = None
        self._told: InputValues | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(
        self, performance: _core.Performance, stage: Stage, gain: float, start: int = 0
    ) -> None:
        """Serve a performance that began at frame `start` with a `gain` (ratio)."""

        def stop() -> None:
            self.stopped = True
            performance.stop()

        def tell(name: str, value: float) -> bool:
            return performance.tell(input_number(name), value) is not None

        told = InputValues(tell)
        handlers = request_handlers(performance, stage, gain, stop, told.handler_of, self._command)
        self.serve(handlers, lambda send: OscSender(performance, stage, start, send), told)

    def serve(
        self, handlers: HandlerTable, teller: Callable[[Send], OscSender], told: InputValues
    ) -> None:
        """Serve requests by a table of addresses, pass values to inputs, and send a teller's
        messages.
        """
        self._handlers, self._told = handlers, told
        self._teller = teller(self._send) if self._there else None
        self._over.clear()
        self._thread = threading.Thread(target=self._run, name="ergon osc", daemon=True)
        self._thread.start()

    def answerer(self) -> Callable[[str, str], None]:
        """A function that answers the present request, now or later, with an address and a
        sentence.
        """
        return partial(self._answer, self._sender)

    def stop_serving(self) -> None:
        """End serving a performance; events that wait are still sent."""
        if self._thread is None:
            return
        self._over.set()
        self._thread.join()
        self._thread = None
        self._send_messages()

    def close(self) -> None:
        """Close the sockets."""
        self.stop_serving()
        for opened in (self._here, self._there):
            if opened is not None:
                opened[0].close()

    def remarks(self) -> list[str]:
        """Remarks since the last call, one sentence each."""
        found = []
        with contextlib.suppress(IndexError):
            while True:
                found.append(self._remarks.popleft())
        return found

    def _run(self) -> None:
        due = time.monotonic()
        while not self._over.is_set():
            self._receive(due - time.monotonic())
            if time.monotonic() >= due:
                due = max(due + _CHECK_PERIOD, time.monotonic())
                self._send_messages()
                if self._told is not None:
                    with contextlib.suppress(_core.EngineError):
                        self._told.send_due()

    def _send_messages(self) -> None:
        if self._teller is not None:
            with contextlib.suppress(_core.EngineError):  # it is closed already
                self._teller.send_new(time.time)

    def _send(self, address: str, arguments: Sequence[object], when: float | None = None) -> None:
        if self._there is not None:
            self._send_datagram(*self._there, encode_message(address, arguments, when))

    def _send_datagram(
        self, sender: socket.socket, to: tuple[object, ...], datagram: bytes
    ) -> None:
        try:
            sender.sendto(datagram, to)
        except OSError:
            self.unsent += 1

    def _receive(self, patience: float) -> None:
        """Handle the requests that have come; wait up to `patience` [s] for one."""
        if self._here is None:
            self._over.wait(max(0.0, patience))
            return
        own = self._here[0]
        if not select.select([own], [], [], max(0.0, patience))[0]:
            return
        for _ in range(_DATAGRAMS_AT_ONCE):
            try:
                datagram, sender = own.recvfrom(DATAGRAM_BYTES_MAX + 1)
            except BlockingIOError:
                return
            except OSError:
                self.malformed += 1  # too long, where the system says so
                continue
            self._handle(datagram, sender)

    def _handle(self, datagram: bytes, sender: tuple[object, ...]) -> None:
        try:
            if len(datagram) > DATAGRAM_BYTES_MAX:
                raise MalformedDatagramError
            asked = parse_messages(datagram)
        except MalformedDatagramError:
            self.malformed += 1
            return
        self._sender = sender
        for address, arguments in asked:
            ask = self._handlers.get(address)
            try:
                if ask is None:
                    self._report_unknown(address)
                else:
                    ask(arguments)
            except OscRequestError as error:
                self._answer(sender, "/ergon/error", str(error))
            except _core.EngineError:
                return  # it is over

    def _report_unknown(self, address: str) -> None:
        """Report an unknown address, each only once, and only so many a second."""
        if address in self._unknown or len(self._unknown) >= _UNKNOWN_MAX or not self._may_answer():
            return
        self._unknown.add(address)
        self._remarks.append(f"osc: no address {_printable(address)}")

    def _answer(self, sender: tuple[object, ...], address: str, sentence: str) -> None:
        if self._here is not None and self._may_answer():
            self._send_datagram(self._here[0], sender, encode_message(address, [sentence]))

    def _may_answer(self) -> bool:
        now = time.monotonic()
        if len(self._answers) == _ANSWERS_PER_SECOND and now - self._answers[0] < 1.0:
            return False
        self._answers.append(now)
        return True


def _printable(address: str) -> str:
    """An address in a form that is safe to print in a terminal."""
    return ascii(address[:_ADDRESS_SHOWN_MAX])[1:-1]


def _open_socket(where: Place, *, bound: bool) -> tuple[socket.socket, tuple[object, ...]]:
    """A datagram socket, and the address that `where` stands for."""
    made = None
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(*where, type=socket.SOCK_DGRAM)[0]
        made = socket.socket(family, kind, protocol)
        made.setblocking(False)
        if bound:
            made.bind(address)
    except (OSError, UnicodeError) as error:
        if made is not None:
            made.close()
        what = "cannot listen at" if bound else "cannot send to"
        raise OscError(f"{what} {where[0]}:{where[1]}: {error}") from None
    return made, address
