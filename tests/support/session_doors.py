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


def events(stepped: Stepped, name: str = "") -> list[dict[str, Any]]:
    """The events of a session's journal, or those of a name; a line that another thread is writing
    is not read.
    """
    complete_lines, _, _ = stepped.journal.read_text().rpartition("\n")
    rows = [json.loads(row) for row in complete_lines.splitlines()]
    return [event for event in rows if name in ("", event["event"])]


def _answered(stepped: Stepped, enter: Enter) -> Enter:
    """Enter a line, and wait until it is answered."""

    def wait(line: str) -> None:
        count = len(events(stepped, "said")) + 1
        enter(line)
        until(lambda: len(events(stepped, "said")) >= count, f"an answer to {line!r}")

    return wait


@contextlib.contextmanager
def by_call(stepped: Stepped, folder: Path) -> Iterator[Enter]:
    """As `ergon.Session` does lines."""
    yield stepped.type


@contextlib.contextmanager
def by_pipe(stepped: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the prompt without a screen."""
    source, sink = os.pipe()
    with open(source, encoding="utf-8") as end, open(sink, "w", encoding="utf-8") as lines:
        prompt = PlainPrompt(ErrorBoundary(stepped.session), end, io.StringIO(), watch_nothing)
        thread = threading.Thread(target=prompt.run)
        thread.start()
        yield _answered(stepped, lambda line: print(line, file=lines, flush=True))
        lines.close()
        thread.join(PATIENCE)


@contextlib.contextmanager
def by_socket(stepped: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the socket that editors and prompts of other processes use."""
    path = folder / "s"
    served = SessionServer(stepped.session, ServerSocket(path), {})
    thread = threading.Thread(target=served.run)
    thread.start()

    def is_served() -> bool:
        with contextlib.suppress(NoSessionError), raw(path) as prompt:
            return prompt.greeting is not None
        return False

    until(is_served, "the session")
    with raw(path) as prompt:
        yield lambda line: prompt.ask(id=1, do="submit", text=line)
        prompt.ask(id=2, do="end")
    thread.join(PATIENCE)


@contextlib.contextmanager
def by_osc(stepped: Stepped, folder: Path) -> Iterator[Enter]:
    """Through the address `/ergon/cmd`."""
    osc = OscServer(("127.0.0.1", 0), None)
    performance = SimpleNamespace(status=lambda: SimpleNamespace(hands=()))
    assert osc.address is not None
    with (
        contextlib.closing(SessionOsc(stepped.session, osc, performance)),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        place = osc.address
        sender.bind(("127.0.0.1", 0))
        yield _answered(
            stepped, lambda line: sender.sendto(encode_message("/ergon/cmd", [line]), place)
        )


DOORS: dict[str, Door] = {"call": by_call, "pipe": by_pipe, "socket": by_socket, "osc": by_osc}
