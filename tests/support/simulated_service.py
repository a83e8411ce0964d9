"""Haply's Inverse Service as a thread: plain sockets, a WebSocket by RFC 6455, states in JSON.

It records every force that it receives, with its instant. It replies with its state, with `{}`,
or not at all. A hand holds its cursor 10 mm from the middle and moves it to and fro by a
millimetre. The service has no watchdog: a force stays until another one arrives.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import math
import socket
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

from patience import PATIENCE
from real_time import real_time

_GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
_TEXT, _CLOSE, _PING, _PONG = 1, 8, 9, 10
_ID = "SIM"
_PRIORITY = 60  # below the threads of the performance

Reply = Literal["state", "empty", "silent"]


@dataclass
class ReceivedForce:
    """A force [N] and the instant at which it arrived [s of time.monotonic]."""

    time: float
    force: tuple[float, float, float]

    @property
    def is_zero(self) -> bool:
        return self.force == (0.0, 0.0, 0.0)


@dataclass
class Service:
    """`with Service() as service:` listens at `service.url`."""

    reply: Reply = "state"
    prompt: bool = False  # real-time priority where it is granted: a clock that is not late itself
    url: str = ""
    received: list[ReceivedForce] = field(default_factory=list)
    left: int = 0  # hosts that went

    def __enter__(self) -> Service:
        self._news = threading.Condition()
        self._over = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.05)
        self.url = f"haply:ws://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._listener.close()

    def until(self, holds: Callable[[Service], bool], seconds: float = PATIENCE) -> None:
        """Wait until a condition holds; the limit is long, because a busy machine is slow."""
        with self._news:
            assert self._news.wait_for(lambda: holds(self), seconds), f"never: {self.received[-3:]}"

    def first_zero(self, after: float) -> ReceivedForce | None:
        """The first zero that came after a moment."""
        result: ReceivedForce | None = None
        for output in reversed(self.received):
            if output.time < after:
                break
            if output.is_zero:
                result = output
        return result

    def _run(self) -> None:
        if self.prompt:
            real_time(priority=_PRIORITY)
        while not self._over.is_set():
            try:
                host, _ = self._listener.accept()
            except TimeoutError:
                continue
            with host:
                host.settimeout(0.05)
                host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with contextlib.suppress(ConnectionError):
                    self._serve(host)
            with self._news:
                self.left += 1
                self._news.notify_all()

    def _serve(self, host: socket.socket) -> None:
        stream = _Stream(host, self._over)
        head = stream.until(b"\r\n\r\n").decode()
        named = (line.split(":", 1) for line in head.splitlines() if ":" in line)
        key = {name.lower(): value.strip() for name, value in named}["sec-websocket-key"]
        accept = base64.b64encode(hashlib.sha1(key.encode() + _GUID).digest()).decode()
        switch = "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade"
        host.sendall(f"{switch}\r\nSec-WebSocket-Accept: {accept}\r\n\r\n".encode())
        host.sendall(_framed(_TEXT, self._state()))
        while True:
            kind, body = stream.frame()
            if kind == _CLOSE:
                host.sendall(_framed(_CLOSE, body))
                return
            if kind == _PING:
                host.sendall(_framed(_PONG, body))
            elif kind == _TEXT:
                self._hear(body)
                if self.reply != "silent":
                    text = self._state() if self.reply == "state" else b"{}"
                    host.sendall(_framed(_TEXT, text))

    def _hear(self, body: bytes) -> None:
        now = time.monotonic()
        (device,) = json.loads(body)["inverse3"]
        assert device["device_id"] == _ID
        vector = device["commands"]["set_cursor_force"]["vector"]
        with self._news:
            self.received.append(ReceivedForce(now, (vector["x"], vector["y"], vector["z"])))
            self._news.notify_all()

    def _state(self) -> bytes:
        x = 0.01 + 0.001 * math.sin(math.tau * time.monotonic())
        position = {"x": x, "y": 0.0, "z": 0.0}
        state = {"cursor_position": position, "current_cursor_force": {"x": 0, "y": 0, "z": 0}}
        return json.dumps({"inverse3": [{"device_id": _ID, "state": state}]}).encode()


class _Stream:
    """The bytes from a host, until it has gone or the service ends."""

    def __init__(self, host: socket.socket, over: threading.Event) -> None:
        self._host, self._over, self._bytes = host, over, b""

    def _more(self) -> None:
        while not self._over.is_set():
            try:
                got = self._host.recv(65536)
            except TimeoutError:
                continue
            if not got:
                break
            self._bytes += got
            return
        raise ConnectionResetError

    def take(self, n: int) -> bytes:
        while len(self._bytes) < n:
            self._more()
        taken, self._bytes = self._bytes[:n], self._bytes[n:]
        return taken

    def until(self, end: bytes) -> bytes:
        while end not in self._bytes:
            self._more()
        return self.take(self._bytes.index(end) + len(end))

    def frame(self) -> tuple[int, bytes]:
        """Kind and body of a whole frame from a client, which masks them."""
        first, second = self.take(2)
        n = second & 127
        if n == 126:
            (n,) = struct.unpack(">H", self.take(2))
        assert first & 128, "one frame a message"
        assert second & 128, "a client masks"
        assert n < 65536, "a command is short"
        mask, body = self.take(4), self.take(n)
        return first & 15, bytes(byte ^ mask[i % 4] for i, byte in enumerate(body))


def _framed(kind: int, body: bytes) -> bytes:
    n = len(body)
    size = struct.pack("B", n) if n < 126 else struct.pack(">BH", 126, n)
    return bytes([128 | kind]) + size + body
