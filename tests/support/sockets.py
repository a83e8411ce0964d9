"""A session served without its own process, and connections that can send anything."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Iterator
from pathlib import Path

from patience import PATIENCE, until

from ergon.repl.session_protocol import Reply, Sounding, SoundingPlace, State
from ergon.repl.wire import local_socket
from ergon.repl.wire.protocol import encode
from ergon.repl.wire.remote import RemoteSession
from ergon.repl.wire.serve import SessionServer


def remote(path: Path) -> RemoteSession:
    return RemoteSession(path, "ergon repl --socket")


class Acted:
    """A session whose lines say what they do: `slow` until a panic, `quit`, `fail`."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.happened: list[str] = []
        self.panicked = threading.Event()
        self.slow = threading.Event()
        self.closed = False
        self.sounding: list[SoundingPlace] = []

    def look(self) -> Sounding:
        began, self.sounding = tuple(self.sounding), []
        return Sounding(1.0, began)

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        self.lines.append(text)
        if text == "slow":
            self.slow.set()
            assert self.panicked.wait(PATIENCE)
        if text == "fail":
            raise SystemExit
        if text == "adda":
            return Reply(False, "unknown verb", "ada", ("⣀⡠", "b"))
        return Reply(True, f"ok {text[:20]}", leaves=text == "quit")

    def state(self) -> State:
        return State(bar=len(self.lines) + 1, beat=1.5, tempo=72.0, playing=(("ada", "lean"),))

    def messages(self) -> list[str]:
        happened, self.happened = self.happened, []
        return happened

    def panic(self) -> None:
        self.panicked.set()

    def cancel(self) -> bool:
        self.cancelled = True
        return True

    def let_go(self) -> None:
        self.happened.append("let go")

    def end_input(self) -> None:
        self.happened.append("input ends")

    def close(self) -> None:
        self.closed = True

    def complete(self, line: str, cursor: int) -> list[object]:
        return [State] if line == "fail" else []

    def tokens(self, line: str) -> list[tuple[int, int, str]]:
        return [(0, len(line), "name")]

    def is_whole(self, text: str) -> bool:
        return not text.endswith("\\")


@contextlib.contextmanager
def serving(path: Path, face: Acted | None = None) -> Iterator[Acted]:
    face = face or Acted()
    served = SessionServer(
        face,
        local_socket.ServerSocket(path),
        {"version": "0", "score": "s", "journal": "j"},
        follow=lambda: face.look,
    )
    thread = threading.Thread(target=served.run)
    thread.start()
    try:
        until(lambda: _answers(path), "the session")
        yield face
    finally:
        served.end("the test ends")
        thread.join(PATIENCE)
        assert not thread.is_alive()
        assert face.closed
        assert not path.exists()


def _answers(path: Path) -> bool:
    try:
        with raw(path) as raised:  # so it was let in, before anything else happens
            return raised.greeting is not None
    except local_socket.NoSessionError:
        return False


class Raw:
    """A connection that can send any bytes."""

    def __init__(self, path: Path) -> None:
        self.socket = local_socket.connect(path)[0]
        self.socket.settimeout(PATIENCE)
        self._file = self.socket.makefile("rb")
        self.greeting = self.read()

    def read(self) -> dict[str, object] | None:
        """The next line; None at the end."""
        try:
            line = self._file.readline()
        except ConnectionError:
            return None
        return json.loads(line) if line else None

    def say(self, data: bytes) -> None:
        self.socket.sendall(data)

    def ask(self, **fields: object) -> dict[str, object] | None:
        self.say(encode(**fields))
        return self.read()

    def close(self) -> None:
        self._file.close()
        self.socket.close()


def raw(path: Path) -> contextlib.closing[Raw]:
    return contextlib.closing(Raw(path))
