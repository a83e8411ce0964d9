"""The doors of a session in virtual time: lines come by a call, a pipe, its socket or OSC.

A door does a line and waits for its answer, while the time of the session stands.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from patience import PATIENCE, until
from sessions import Stepped
from sockets import raw

from ergon.live.datagrams import encode_message
from ergon.live.osc import OscServer
from ergon.repl.prompt.error_boundary import ErrorBoundary
from ergon.repl.prompt.plain import PlainPrompt
from ergon.repl.prompt.signals import watch_nothing
from ergon.repl.session.osc import SessionOsc
from ergon.repl.wire.local_socket import NoSessionError, ServerSocket
from ergon.repl.wire.serve import SessionServer

Enter = Callable[[str], object]
Door = Callable[[Stepped, Path], contextlib.AbstractContextManager[Enter]]


def events(at: Stepped, name: str = "") -> list[dict[str, Any]]:
    """The events of a session's journal, or those of a name."""
    found = [json.loads(row) for row in at.journal.read_text().splitlines()]
    return [event for event in found if name in ("", event["event"])]


def _answered(at: Stepped, enter: Enter) -> Enter:
    """Enter a line, and wait until it is answered."""

    def wait(line: str) -> None:
        count = len(events(at, "said")) + 1
        enter(line)
        until(lambda: len(events(at, "said")) >= count, f"an answer to {line!r}")

    return wait


@contextlib.contextmanager
def by_call(at: Stepped, folder: Path) -> Iterator[Enter]:
    """As `ergon.Session` does lines."""
    yield at.type


@contextlib.contextmanager
def by_pipe(at: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the prompt without a screen."""
    source, sink = os.pipe()
    with open(source, encoding="utf-8") as end, open(sink, "w", encoding="utf-8") as lines:
        prompt = PlainPrompt(ErrorBoundary(at.session), end, io.StringIO(), watch_nothing)
        thread = threading.Thread(target=prompt.run)
        thread.start()
        yield _answered(at, lambda line: print(line, file=lines, flush=True))
        lines.close()
        thread.join(PATIENCE)


@contextlib.contextmanager
def by_socket(at: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the socket that editors and prompts of other processes use."""
    path = folder / "s"
    served = SessionServer(at.session, ServerSocket(path), {})
    thread = threading.Thread(target=served.run)
    thread.start()

    def is_served() -> bool:
        with contextlib.suppress(NoSessionError), raw(path) as found:
            return found.greeting is not None
        return False

    until(is_served, "the session")
    with raw(path) as prompt:
        yield lambda line: prompt.ask(id=1, do="submit", text=line)
        prompt.ask(id=2, do="end")
    thread.join(PATIENCE)


@contextlib.contextmanager
def by_osc(at: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the address `/ergon/cmd`."""
    osc = OscServer(("127.0.0.1", 0), None)
    performance = SimpleNamespace(status=lambda: SimpleNamespace(hands=()))
    assert osc.place is not None
    with (
        contextlib.closing(SessionOsc(at.session, osc, performance)),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        place = osc.place
        sender.bind(("127.0.0.1", 0))
        yield _answered(at, lambda line: sender.sendto(encode_message("/ergon/cmd", [line]), place))


DOORS: dict[str, Door] = {"call": by_call, "pipe": by_pipe, "socket": by_socket, "osc": by_osc}
