"""A page that is no page: a WebSocket by RFC 6455 over a plain socket, which may send anything."""

from __future__ import annotations

import contextlib
import os
import socket
import struct
from urllib.parse import urlsplit

from patience import PATIENCE

_TEXT, _BINARY, _CLOSE = 1, 2, 8
_KEY = "dGhlIHNhbXBsZSBub25jZQ=="


class RawPage:
    """A connection to the keys of a piece at `url`."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        assert parts.hostname is not None
        self._socket = socket.create_connection((parts.hostname, parts.port or 80), PATIENCE)
        head = (
            f"GET {parts.path}hands HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nOrigin: http://{parts.netloc}\r\n"
            f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {_KEY}\r\n\r\n"
        )
        self._socket.sendall(head.encode())
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self._socket.recv(1)
        assert b" 101 " in answer.splitlines()[0], answer
        self._socket.settimeout(0.0)

    def __enter__(self) -> RawPage:
        """Stay connected."""
        return self

    def __exit__(self, *_: object) -> None:
        """Hang up."""
        self._socket.close()

    def text(self, words: str) -> bool:
        """Send a text; False once the server has hung up."""
        return self._send(_TEXT, words.encode())

    def positions(self, key: int, rows: list[tuple[float, float, float]]) -> bool:
        """Send (when [s of the server], where [m], pressure) of a key; False as for `text`."""
        body = struct.pack("<BBH", key, 0, len(rows))
        body += b"".join(struct.pack("<dff", *row) for row in rows)
        return self._send(_BINARY, body)

    def _send(self, kind: int, body: bytes) -> bool:
        mask = os.urandom(4)
        size = len(body)
        length = bytes([0x80 | size]) if size < 126 else struct.pack(">BH", 0x80 | 126, size)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(body))
        try:
            with contextlib.suppress(BlockingIOError):
                while self._socket.recv(1 << 16):  # what the server draws is not looked at
                    pass
                return False
            self._socket.settimeout(PATIENCE)
            self._socket.sendall(bytes([0x80 | kind]) + length + mask + masked)
            self._socket.settimeout(0.0)
        except (ConnectionError, TimeoutError):
            return False
        return True
