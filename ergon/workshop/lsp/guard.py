"""What stands between an editor and the library of the protocol: whole messages of bounded size.

pygls waits for as many bytes as a header promises, leaves requests with wrong fields without an
answer, and reads documents that are not open from the disk. So messages are checked here first; one
that is refused gets its answer here (JSON-RPC 2.0, section 5.1; LSP 3.17, `ErrorCodes`).
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Set
from typing import Any, BinaryIO
from urllib.parse import unquote

from cattrs import transform_error
from lsprotocol import converters
from lsprotocol import types as t

from ergon.common.errors import ErgonError
from ergon.common.structured import MalformedTextError, parse_json
from ergon.common.terminal import printable

BODY_MAX = 64 << 20  # bytes: as large as a score may be
_LINE_MAX, _LINES_MAX = 4096, 32  # bytes and lines of a header
_REASON_MAX = 300  # characters of what is wrong with a message
_DEPTH_MAX = 64  # levels of nesting; the protocol needs about ten
_INTEGER_MAX = 1 << 53
_CONTENT_LENGTH = re.compile(rb"Content-Length: *([0-9]{1,20}) *\r?\n", re.IGNORECASE)
_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")  # half of a character, which UTF-8 cannot say
_LIFECYCLE = (t.INITIALIZE, t.INITIALIZED, t.SHUTDOWN, t.EXIT, t.CANCEL_REQUEST, t.SET_TRACE)


class ProtocolError(ErgonError):
    """What comes is not the Language Server Protocol, so that nothing after it can be read."""


class _RefusedError(Exception):
    """A message that is not handed on; `id` is that of the request, if it is known to be one."""

    def __init__(self, code: int, message: str, id: int | str | None = None) -> None:
        super().__init__(message)
        self.code, self.message, self.id = code, message, id


class GuardedInput:
    """The input of a server: the messages that may be handled.

    `failure` says why it ended; `exits_early`: by `exit` without `shutdown` before it.
    """

    def __init__(self, source: BinaryIO, target: BinaryIO, methods: Set[str]) -> None:
        """Read from an editor's `source` and answer to `target`; `methods` have handlers."""
        self.failure: ProtocolError | None = None
        self.exits_early = False
        self._source, self._target = source, target
        self._handled_methods = methods | {*_LIFECYCLE}
        self._converter = converters.get_converter()
        self._message = io.BytesIO()
        self._open_uris: set[str] = set()
        self._is_initialised = self._is_shut_down = False

    def readline(self) -> bytes:
        """The next line of a header; nothing at the end."""
        line = self._message.readline()
        return self._message.readline() if not line and self._take_next() else line

    def read(self, n_bytes: int) -> bytes:
        """The body that the header announced."""
        return self._message.read(n_bytes)

    def _take_next(self) -> bool:
        """Take the next message that may be handled; False at the end."""
        while True:
            try:
                message_body = self._read_body()
                if message_body is None:
                    return False
                if not self._is_handled(self._parse(message_body)):
                    continue
            except _RefusedError as error:
                self._answer(error)
            except ProtocolError as error:
                self._answer(_RefusedError(t.ErrorCodes.InvalidRequest, str(error)))
                self.failure = error
                return False
            else:
                header = f"Content-Length: {len(message_body)}\r\n\r\n".encode()
                self._message = io.BytesIO(header + message_body)
                return True

    def _read_body(self) -> bytes | None:
        """The body of a message; None at the end. Raises ProtocolError."""
        n_bytes = None
        for line_number in range(_LINES_MAX):
            header_line = self._source.readline(_LINE_MAX)
            if not header_line and not line_number:
                return None
            if match := _CONTENT_LENGTH.fullmatch(header_line):
                n_bytes = int(match[1])
            elif not header_line.strip():
                break
            elif b":" not in header_line or not header_line.endswith(b"\n"):
                raise ProtocolError("a header must have lines such as Content-Length: 120")
        if n_bytes is None:
            raise ProtocolError("a message must begin with a line such as Content-Length: 120")
        if n_bytes > BODY_MAX:
            problem = f"a message of {n_bytes:,} bytes is announced; at most {BODY_MAX:,} are read"
            raise ProtocolError(problem)
        body = self._source.read(n_bytes)
        if len(body) < n_bytes:
            raise ProtocolError(f"the input ends within a message of {n_bytes:,} bytes")
        return body

    def _parse(self, body: bytes) -> dict[str, Any]:
        """A message as a mapping. Raises _RefusedError."""
        try:
            message = parse_json(body)
            if _SURROGATE.search(body):
                json.dumps(message, ensure_ascii=False).encode()
        except MalformedTextError as error:
            raise _RefusedError(t.ErrorCodes.ParseError, str(error)) from None
        except (UnicodeEncodeError, RecursionError):
            reason = "a text has half of a character"
            raise _RefusedError(t.ErrorCodes.ParseError, reason) from None
        if not isinstance(message, dict) or message.get("jsonrpc") != "2.0":
            reason = 'a message must be a JSON object with "jsonrpc": "2.0"'
            raise _RefusedError(t.ErrorCodes.InvalidRequest, reason)
        if any(depth > _DEPTH_MAX for depth in _depths(message)):
            reason = f"the message is nested more than {_DEPTH_MAX} deep"
            raise _RefusedError(t.ErrorCodes.InvalidRequest, reason)
        return message

    def _is_handled(self, message: dict[str, Any]) -> bool:
        """Whether there is something to do for a message. Raises _RefusedError for a request."""
        method_name, id = message.get("method"), message.get("id")
        if method_name is None:  # a reply, though the server asks nothing
            return False
        if "id" in message and not _is_id(id):
            raise _RefusedError(t.ErrorCodes.InvalidRequest, "an id is a whole number or a text")
        is_request = "id" in message
        try:
            self._check(method_name, message)
        except _RefusedError as error:
            if is_request:
                raise _RefusedError(error.code, error.message, id) from None
            return False  # a notification has no answer
        return True

    def _check(self, method: Any, message: dict[str, Any]) -> None:
        if not isinstance(method, str) or method not in self._handled_methods:
            reason = f"{printable(str(method)[:80])} is not done by this server"
            raise _RefusedError(t.ErrorCodes.MethodNotFound, reason)
        message_type = t.METHOD_TO_TYPES[method][0]
        if hasattr(message_type, "id") != ("id" in message):
            reason = f"{method} has an id if, and only if, it is a request"
            raise _RefusedError(t.ErrorCodes.InvalidRequest, reason)
        if self._is_shut_down and method != t.EXIT:
            raise _RefusedError(t.ErrorCodes.InvalidRequest, "the server was shut down")
        if not self._is_initialised and method not in (t.INITIALIZE, t.EXIT):
            raise _RefusedError(t.ErrorCodes.ServerNotInitialized, "initialize comes first")
        if self._is_initialised and method == t.INITIALIZE:
            raise _RefusedError(t.ErrorCodes.InvalidRequest, "initialize comes once")
        try:
            request: Any = self._converter.structure(message, message_type)
        except Exception as error:  # cattrs and the validators raise errors of many types
            why = printable("; ".join(transform_error(error)))[:_REASON_MAX]
            reason = f"the fields of {method} are not those of the protocol: {why}"
            raise _RefusedError(t.ErrorCodes.InvalidParams, reason) from error
        self.exits_early = method == t.EXIT and not self._is_shut_down
        self._is_initialised = True
        self._is_shut_down |= method == t.SHUTDOWN
        document = getattr(request.params, "text_document", None)
        if document is not None:
            self._check_open(method, unquote(document.uri))

    def _check_open(self, method_name: str, uri: str) -> None:
        if method_name == t.TEXT_DOCUMENT_DID_OPEN:
            self._open_uris.add(uri)
        elif uri not in self._open_uris:
            reason = f"{printable(uri[:200])} is not open"
            raise _RefusedError(t.ErrorCodes.InvalidParams, reason)
        elif method_name == t.TEXT_DOCUMENT_DID_CLOSE:
            self._open_uris.remove(uri)

    def _answer(self, error: _RefusedError) -> None:
        fields = {"code": int(error.code), "message": error.message}
        body = json.dumps({"jsonrpc": "2.0", "id": error.id, "error": fields}).encode()
        # One write, so that it is never within an answer of the server.
        self._target.write(f"Content-Length: {len(body)}\r\n\r\n".encode() + body)
        self._target.flush()


def _is_id(id: object) -> bool:
    if isinstance(id, str):
        return len(id) <= _LINE_MAX
    return type(id) is int and abs(id) < _INTEGER_MAX


def _depths(part: object) -> Iterator[int]:
    """How deep each part of a value lies, without recursion."""
    open_parts = [(part, 1)]
    while open_parts:
        part, depth = open_parts.pop()
        yield depth
        if isinstance(part, dict):
            open_parts += ((inner_part, depth + 1) for inner_part in part.values())
        elif isinstance(part, list):
            open_parts += ((inner_part, depth + 1) for inner_part in part)
