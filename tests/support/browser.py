"""A real browser for tests: headless Chromium without a graphics card, by its DevTools protocol.

Nothing waits for a length of time: a page is asked to draw an instant, and answers when it has.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from patience import PATIENCE, until

_FLAGS = [
    "--headless=new",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-extensions",
    "--mute-audio",
    "--remote-debugging-port=0",
]


def chromium() -> str:
    """Its path. Where it is missing CI fails; elsewhere the test says what to install."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        why = "chromium is missing: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(why)
        pytest.skip(why)
    return found


class WebSocket:
    """A client by RFC 6455 of one connection: text out, text in."""

    def __init__(self, port: int, path: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), PATIENCE)
        key = base64.b64encode(bytes(16)).decode()
        head = (
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        self._socket.sendall(head.encode())
        self._file = self._socket.makefile("rb")
        assert b" 101 " in self._file.readline()
        while self._file.readline() != b"\r\n":
            pass

    def send(self, text: str) -> None:
        data = text.encode()
        n = len(data)
        length = struct.pack("!BH", 0x80 | 126, n) if n < 1 << 16 else b"\xff" + n.to_bytes(8)
        # A mask of zeros leaves the bytes as they are.
        self._socket.sendall(b"\x81" + length + bytes(4) + data)

    def receive(self) -> str:
        whole = b""
        while True:
            first, second = self._file.read(2)
            n = second & 127
            if n >= 126:
                n = int.from_bytes(self._file.read(2 if n == 126 else 8))
            data = self._file.read(n)
            if first & 15 in (0, 1):
                whole += data
                if first & 0x80:
                    return whole.decode()

    def close(self) -> None:
        self._file.close()
        self._socket.close()


class Page:
    """A page that is open. What it asked for and what it said of errors is kept."""

    def __init__(self, port: int, target: str) -> None:
        self._line = WebSocket(port, f"/devtools/page/{target}")
        self._last = 0
        self.requests: list[str] = []
        self.errors: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Calls a method of the protocol."""
        self._last += 1
        self._line.send(json.dumps({"id": self._last, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._line.receive())
            if told.get("id") == self._last:
                assert "error" not in told, told
                return told["result"]
            self._note(told.get("method"), told.get("params", {}))

    def _note(self, method: str | None, what: dict[str, Any]) -> None:
        if method == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(what["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(what["exceptionDetails"]))
        elif method == "Log.entryAdded" and what["entry"]["level"] == "error":
            self.errors.append(f"{what['entry']['text']} {what['entry'].get('url')}")
        elif method == "Runtime.consoleAPICalled" and what["type"] in ("error", "assert"):
            self.errors.append(json.dumps(what["args"]))

    def run(self, script: str) -> Any:
        """The value of an expression; a promise is waited for."""
        got = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        assert "exceptionDetails" not in got, got["exceptionDetails"]
        return got["result"].get("value")

    def size(self, width: int, height: int) -> None:
        """Makes the picture so many pixels large."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def open(self, url: str) -> None:
        """Goes to an address; back when the page's own script has its first picture."""
        self.call("Page.navigate", url=url)
        until(lambda: self.run("!!(window.ergon && window.ergon.ready)"), "the page's script")
        self.run("window.ergon.ready")

    def press(self, key: str, shift: bool = False) -> None:
        """A key of the keyboard."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0)

    def picture(self) -> bytes:
        """What is seen, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def close(self) -> None:
        self._line.close()


class Browser:
    """Chromium that runs."""

    def __init__(self, port: int) -> None:
        self.port = port

    @contextlib.contextmanager
    def page(self, width: int = 640, height: int = 360) -> Iterator[Page]:
        """A page of its own, closed in the end."""
        target = self._ask("PUT", "/json/new?about:blank")["id"]
        page = Page(self.port, target)
        try:
            page.size(width, height)
            yield page
        finally:
            page.close()
            self._ask("GET", f"/json/close/{target}", read=False)

    def _ask(self, method: str, path: str, *, read: bool = True) -> Any:
        import http.client

        line = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        line.request(method, path)
        body = line.getresponse().read()
        line.close()
        return json.loads(body) if read else None


@contextlib.contextmanager
def running(folder: Path, *flags: str) -> Iterator[Browser]:
    """Chromium with an empty profile in a folder."""
    profile = folder / "profile"
    process = subprocess.Popen(
        [chromium(), *_FLAGS, *flags, f"--user-data-dir={profile}", "about:blank"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"HOME": str(folder)},
    )
    told = profile / "DevToolsActivePort"
    try:
        until(lambda: told.exists() and told.read_text().count("\n") >= 1, "a browser")
        yield Browser(int(told.read_text().split("\n")[0]))
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
