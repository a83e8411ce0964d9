"""One connection to a session: it sends requests and assigns answers to them by their ids."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import struct
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import IO, Any

from ergon.common.errors import ErgonError

from . import local_socket
from .protocol import MAX_LINE, PROTOCOL_VERSION, ProtocolError, decode_message, encode

_IS_WINDOWS = os.name == "nt"
_SO_SNDTIMEO = getattr(socket, "SO_SNDTIMEO", 0x1005)  # the number in Windows' own header
_TIMEOUT_SECONDS = 5  # [s] to wait for the greeting, and for a session that does not read


class ConnectionLostError(ErgonError):
    """The connection ended before the answer came."""


class RequestRefusedError(ErgonError):
    """The session refused a request: one sentence says why."""


class Connection:
    """A connection; `is_closed` is True once it has ended, and `end_reason` is the reason if the
    session ended.
    """

    def __init__(self, path: Path) -> None:
        """Connect. Raises NoSessionError, SocketError, ProtocolError."""
        self._socket, self._expected_answer = local_socket.connect(path)
        self._file: IO[bytes] = self._socket.makefile("rb")
        self._request_ids = itertools.count(1)
        self._waiting_answers: dict[int, Future[Any]] = {}
        self._lock = threading.Lock()
        self._send_lock = threading.Lock()
        self.is_closed = False
        self.end_reason = ""
        try:
            self.about = self._read_greeting()
        except BaseException:
            self._file.close()
            self._socket.close()
            raise
        self._thread = threading.Thread(target=self._listen, name="ergon answers", daemon=True)
        self._thread.start()

    def _read_greeting(self) -> Mapping[str, Any]:
        self._socket.settimeout(_TIMEOUT_SECONDS)
        try:
            greeting_line = self._file.readline(MAX_LINE)
        except OSError:
            raise ProtocolError("the process at the socket does not answer") from None
        self._socket.settimeout(None)
        # Windows has a limit in milliseconds, others a struct timeval.
        timeout_option = (
            struct.pack("L", 1000 * _TIMEOUT_SECONDS)
            if _IS_WINDOWS
            else struct.pack("ll", _TIMEOUT_SECONDS, 0)
        )
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_SNDTIMEO, timeout_option)
        greeting = decode_message(greeting_line)
        if "error" in greeting:
            raise ProtocolError(str(greeting["error"]))
        if self._expected_answer and greeting.get("answer") != self._expected_answer:
            raise ProtocolError("another program has taken the port of the session")
        if greeting.get("ergon") != PROTOCOL_VERSION:
            raise ProtocolError(
                f"the session speaks version {greeting.get('ergon')} of the "
                f"protocol, this prompt version {PROTOCOL_VERSION}"
            )
        return greeting

    def ask(self, request_name: str, **request_fields: Any) -> Future[Any]:
        """Send a request; the future has its answer, or ConnectionLostError or
        RequestRefusedError."""
        answer: Future[Any] = Future()
        request_id = next(self._request_ids)
        with self._lock:
            if self.is_closed:
                answer.set_exception(ConnectionLostError())
                return answer
            self._waiting_answers[request_id] = answer
        try:
            line = encode(id=request_id, do=request_name, **request_fields)
            with self._send_lock:
                self._socket.sendall(line)
        except OSError:  # also a timeout, after which a part of the line may be sent
            self.close()
        return answer

    def close(self) -> None:
        """Close the connection."""
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._mark_closed()
        self._thread.join(_TIMEOUT_SECONDS)

    def _listen(self) -> None:
        with contextlib.suppress(OSError, ProtocolError, ValueError):
            while (line := self._file.readline(MAX_LINE)).endswith(b"\n"):
                message_fields = decode_message(line)
                if "ended" in message_fields:
                    self.end_reason = str(message_fields["ended"])
                    break
                self._resolve_answer(message_fields)
        self._mark_closed()
        self._file.close()
        self._socket.close()

    def _resolve_answer(self, answer_fields: Mapping[str, Any]) -> None:
        request_id = answer_fields.get("id")
        with self._lock:
            answer = (
                self._waiting_answers.pop(request_id, None) if isinstance(request_id, int) else None
            )
        if answer is None:
            return
        if "error" in answer_fields:
            answer.set_exception(RequestRefusedError(str(answer_fields["error"])))
        else:
            answer.set_result(answer_fields.get("is"))

    def _mark_closed(self) -> None:
        with self._lock:
            self.is_closed = True
            unanswered, self._waiting_answers = self._waiting_answers, {}
        for answer in unanswered.values():
            answer.set_exception(ConnectionLostError())
