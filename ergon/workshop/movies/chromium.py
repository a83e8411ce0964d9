"""Chromium without a window, controlled by its DevTools protocol over two pipes: no port is open.

A page is asked to draw an instant, and answers when it has: nothing waits for a fixed time.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import shutil
import signal
import tempfile
from collections.abc import Iterator, Sequence
from typing import Any

from ergon.common.errors import ErgonError

_PROGRAM_NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
)
_FLAGS = (
    "--headless=new",
    "--enable-unsafe-swiftshader",  # draws in software where there is no graphics card
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-extensions",
    "--mute-audio",
    "--remote-debugging-pipe",
)
_CHROMIUM_INPUT, _CHROMIUM_OUTPUT = (
    3,
    4,
)  # descriptors at which Chromium reads and writes the protocol
_FREE_DESCRIPTOR_MIN = 10  # descriptors from here on are free of the protocol's two
_ANSWER_TIMEOUT = 300.0  # [s] a picture drawn in software on a busy machine takes seconds
_EXIT_TIMEOUT = 10.0  # [s] for the browser to end by itself
# Resolves to "" when the page's own script is ready, or to the message that the page shows.
_READY_SCRIPT = """new Promise((resolve) => {
  const look = () => {
    const told = document.getElementById('told')?.textContent;
    if (window.ergon?.ready) window.ergon.ready.then(() => resolve(''), (e) => resolve(e.message));
    else if (told) resolve(told);
    else setTimeout(look, 5);
  };
  look();
})"""


class BrowserError(ErgonError, RuntimeError):
    """The browser is missing, has ended, or refuses; the message says what to do."""


def find_browser(program: str | None = None) -> str:
    """The path of Chromium or Chrome: `program`, or the first that is installed.

    Raises BrowserError.
    """
    if not hasattr(os, "posix_spawn"):
        raise BrowserError("a browser without a window can be controlled only on Linux and macOS")
    for name in (program,) if program else _PROGRAM_NAMES:
        browser = shutil.which(name)
        if browser is not None:
            return browser
    if program:
        raise BrowserError(f"there is no program {program}")
    advice = "install one, such as `apt install chromium`"
    raise BrowserError(f"no Chromium or Chrome is installed: {advice}")


class Page:
    """An open page. It keeps the addresses that the page requested, and the page's errors."""

    def __init__(self, browser: Browser, session: str) -> None:
        """`session`: its name in the protocol."""
        self._browser = browser
        self.session = session
        self.requests: list[str] = []
        self.errors: list[str] = []
        self._load_count = 0

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol. Raises BrowserError."""
        return self._browser.call(method, self.session, **parameters)

    def on_event(self, method: str, parameters: dict[str, Any]) -> None:
        """Record an event of the protocol: a finished load, a request or an error."""
        if method == "Page.loadEventFired":
            self._load_count += 1
        elif method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        elif method == "Network.webSocketCreated":
            self.requests.append(parameters["url"])
        elif method == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(parameters["exceptionDetails"]))
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(f"{parameters['entry']['text']} {parameters['entry'].get('url')}")
        elif method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "assert"):
            self.errors.append(json.dumps(parameters["args"]))

    def run(self, script: str) -> Any:
        """The value of an expression; a promise is waited for. Raises BrowserError."""
        reply = self.call(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in reply:
            details = reply["exceptionDetails"]
            reason = details.get("exception", {}).get("description", details.get("text", ""))
            raise BrowserError(f"the page fails: {reason}")
        return reply["result"].get("value")

    def set_size(self, width: int, height: int) -> None:
        """Set the size of the picture [px]."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def open(self, url: str) -> None:
        """Go to an address of `ergon view`, until its first picture is drawn.

        Raises BrowserError.
        """
        n_loaded_before = self._load_count
        self.call("Page.navigate", url=url)
        while self._load_count == n_loaded_before:
            self._browser.listen()
        reason = self.run(_READY_SCRIPT)
        if reason:
            raise BrowserError(reason)

    def press(self, key: str, shift: bool = False) -> None:
        """Press and release a key of the keyboard."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0)

    def picture(self) -> bytes:
        """What is seen, as a PNG file."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])


class Browser:
    """A running Chromium, with an empty profile of its own."""

    def __init__(self, program: str, folder: str, flags: Sequence[str] = ()) -> None:
        """Start it; `folder` holds its profile. Raises BrowserError."""
        read_end, browser_write_end = _pipe()
        browser_read_end, write_end = _pipe()
        arguments = [program, *_FLAGS, *flags, f"--user-data-dir={folder}", "about:blank"]
        if os.geteuid() == 0:
            arguments.insert(1, "--no-sandbox")  # Chromium's sandbox does not run as root
        null_device = os.open(os.devnull, os.O_RDWR)
        descriptors = {
            0: null_device,
            1: null_device,
            2: null_device,
            _CHROMIUM_INPUT: browser_read_end,
            _CHROMIUM_OUTPUT: browser_write_end,
        }
        try:
            self._pid = os.posix_spawn(
                program,
                arguments,
                os.environ | {"HOME": folder},
                file_actions=[
                    (os.POSIX_SPAWN_DUP2, parent_descriptor, child_descriptor)
                    for child_descriptor, parent_descriptor in descriptors.items()
                ],
                setpgroup=0,  # Ctrl-C in a terminal is ergon's, which ends the browser itself
            )
        except OSError as error:
            os.close(read_end)
            os.close(write_end)
            raise BrowserError(f"{program} does not start: {error.strerror}") from None
        finally:
            for descriptor in (browser_read_end, browser_write_end, null_device):
                os.close(descriptor)
        self._input, self._output = read_end, write_end
        self._pages: dict[str, Page] = {}
        self._answers: dict[int, dict[str, Any]] = {}
        self._unread = b""
        self._last_id = 0

    def call(self, method: str, session: str | None = None, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol, for a page where `session` names one.

        Raises BrowserError.
        """
        self._last_id += 1
        request: dict[str, object] = {"id": self._last_id, "method": method, "params": parameters}
        if session is not None:
            request["sessionId"] = session
        call_id = self._last_id
        try:
            _write_all(self._output, json.dumps(request).encode() + b"\0")
        except OSError:
            raise BrowserError("the browser has ended") from None
        while call_id not in self._answers:
            self.listen()
        answer = self._answers.pop(call_id)
        if "error" in answer:
            raise BrowserError(f"the browser refuses {method}: {answer['error'].get('message')}")
        answer_fields: dict[str, Any] = answer["result"]
        return answer_fields

    def listen(self) -> None:
        """Wait for what the browser tells next, an answer or an event. Raises BrowserError."""
        while b"\0" not in self._unread:
            if not select.select([self._input], [], [], _ANSWER_TIMEOUT)[0]:
                raise BrowserError(f"the browser has not answered for {_ANSWER_TIMEOUT:.0f} s")
            received = os.read(self._input, 1 << 20)
            if not received:
                raise BrowserError("the browser has ended")
            self._unread += received
        message_text, _, self._unread = self._unread.partition(b"\0")
        message = json.loads(message_text)
        if "id" in message:
            self._answers[message["id"]] = message
        elif (page := self._pages.get(message.get("sessionId", ""))) is not None:
            page.on_event(message["method"], message.get("params", {}))

    @contextlib.contextmanager
    def page(self, width: int = 640, height: int = 360) -> Iterator[Page]:
        """Open a page, and close it when the context ends. Raises BrowserError."""
        target_id = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target_id, flatten=True)["sessionId"]
        self._pages[session] = page = Page(self, session)
        try:
            for domain in ("Page", "Runtime", "Network", "Log"):
                page.call(f"{domain}.enable")
            page.set_size(width, height)
            yield page
        finally:
            del self._pages[session]
            with contextlib.suppress(BrowserError):
                self.call("Target.closeTarget", targetId=target_id)

    def close(self) -> None:
        """End the browser."""
        with contextlib.suppress(BrowserError):
            self.call("Browser.close")
        os.close(self._output)
        # The browser's end of the pipe closes when the browser ends.
        while select.select([self._input], [], [], _EXIT_TIMEOUT)[0] and os.read(
            self._input, 1 << 16
        ):
            pass
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGKILL)
        os.close(self._input)
        os.waitpid(self._pid, 0)


@contextlib.contextmanager
def launch_browser(program: str | None = None, flags: Sequence[str] = ()) -> Iterator[Browser]:
    """A browser that ends with this context. Raises BrowserError."""
    with tempfile.TemporaryDirectory(prefix="ergon-browser-", ignore_cleanup_errors=True) as folder:
        browser = Browser(find_browser(program), folder, flags)
        try:
            yield browser
        finally:
            browser.close()


def _pipe() -> tuple[int, int]:
    """A pipe, (read end, write end), whose descriptors are not those of the protocol."""
    import fcntl

    pipe_ends = os.pipe()
    moved_ends = [
        fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, _FREE_DESCRIPTOR_MIN) for end in pipe_ends
    ]
    for end in pipe_ends:
        os.close(end)
    return moved_ends[0], moved_ends[1]


def _write_all(descriptor: int, message_bytes: bytes) -> None:
    while message_bytes:
        message_bytes = message_bytes[os.write(descriptor, message_bytes) :]
