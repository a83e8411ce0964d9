"""`ergon repl --socket`: the engine in a process of its own, and prompts that join it."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import IO, TYPE_CHECKING

import click

from ergon.common.terminal import clean

from .console import Console
from .outcome import Findings, Refused
from .performing import Wishes, begun

if TYPE_CHECKING:
    from ergon.repl.wire.remote import Remote

_LOOK = 0.05  # [s] between two looks whether the engine answers
# What is the prompt's own; the rest is the engine's.
_OURS = ("socket", "engine", "plain", "strict", "journal")


def perform_apart(console: Console, path: str | None, wishes: Wishes) -> None:
    """Be the engine, or a prompt at one."""
    if wishes.engine:
        with _refused():
            _serve(console, path, wishes, _place(wishes))
    else:
        _prompt(joined(console, path, wishes), wishes)


def joined(console: Console, path: str | None, wishes: Wishes) -> Remote:
    """The session that is served; where none is, one that outlives this process."""
    with _refused():
        return _joined(console, path, wishes, _place(wishes))


@contextlib.contextmanager
def _refused() -> Iterator[None]:
    """What a socket will not do is refused usage."""
    if not hasattr(socket, "AF_UNIX"):
        raise Refused("--socket: there are no local sockets on this system")
    from ergon.repl.wire.local_socket import SocketError

    try:
        yield
    except SocketError as error:
        raise Refused(f"--socket: {error}") from None


def _place(wishes: Wishes) -> Path:
    from ergon.repl.wire.local_socket import default

    if not wishes.socket:
        return default()
    if wishes.socket.endswith((".yaml", ".yml")):
        raise Refused(f"the score comes first: ergon repl {wishes.socket} --socket")
    return Path(wishes.socket).absolute()


# --- the engine's process ------------------------------------------------------------------------


def _serve(console: Console, path: str | None, wishes: Wishes, here: Path) -> None:
    from ergon._core import __version__, stop_on_signals
    from ergon.repl.wire.local_socket import ServerSocket
    from ergon.repl.wire.serve import SessionServer

    door = ServerSocket(here)  # before anything sounds: two engines at one place are one too many
    try:
        session = begun(console, path, wishes)
    except BaseException:
        door.close()
        raise
    about = {
        "version": __version__,
        "score": os.path.abspath(session.commits.head.texts.path),
        "journal": "" if session.journal is None else str(session.journal.path.absolute()),
    }
    SessionServer(session, door, about, stop_on_signals).run()


# --- the prompt's process ------------------------------------------------------------------------


def _prompt(remote: Remote, wishes: Wishes) -> None:
    from ergon.repl.prompt.run import history_of_user, run

    if run(remote, plain=wishes.plain, strict=wishes.strict, history=history_of_user()):
        raise Findings


def _joined(console: Console, path: str | None, wishes: Wishes, here: Path) -> Remote:
    from ergon.repl.wire.local_socket import NoSessionError
    from ergon.repl.wire.protocol import ProtocolError
    from ergon.repl.wire.remote import Remote

    try:
        remote = Remote(here, _command(wishes))
    except NoSessionError as error:
        if path is None and wishes.resume is None:
            raise Refused(f"{error}; ergon repl SCORE --socket begins one") from None
        return _started(console, path, wishes, here)
    except ProtocolError as error:
        raise Refused(f"{here}: {error}") from None
    score = str(remote.about.get("score", ""))
    if wishes.resume is not None or (path is not None and os.path.abspath(path) != score):
        remote.close()
        raise Refused(
            f"{score} is played at {here} already; "
            f"`{_command(wishes)}` joins it, --socket with another path begins another"
        )
    console.say(f"joined the session that plays {score}")
    return remote


def _started(console: Console, path: str | None, wishes: Wishes, here: Path) -> Remote:
    """A process that no terminal's end ends; what it says is heard until it answers."""
    from ergon.repl.wire.local_socket import NoSessionError
    from ergon.repl.wire.protocol import ProtocolError
    from ergon.repl.wire.remote import Remote

    command = [sys.executable, "-m", "ergon.cli", "repl", *([path] if path is not None else [])]
    command += [*_as_options(wishes), f"--journal={wishes.journal}", f"--socket={here}", "--engine"]
    with _log(wishes.journal.with_suffix(".log")) as sink, open(sink.name, "rb") as said:
        log = Path(sink.name)
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True
        )
        try:
            while True:
                code = process.poll()  # before what it said last is read
                _pass_on(said.read())
                if code is not None:
                    log.unlink()
                    raise click.exceptions.Exit(abs(code))
                with contextlib.suppress(NoSessionError):
                    remote = Remote(here, _command(wishes))
                    break
                time.sleep(_LOOK)
            _pass_on(said.read())
        except ProtocolError as error:
            process.terminate()
            raise Refused(f"{here}: {error}") from None
        except click.exceptions.Exit:
            raise
        except BaseException:  # Ctrl-C: who does not want to wait wants no engine
            process.terminate()
            raise
    journal = os.path.relpath(str(remote.about.get("journal", "")) or wishes.journal)
    console.say(f"the engine is process {process.pid}; it writes {journal} and {log}")
    return remote


def _log(path: Path) -> IO[bytes]:
    """A new file under the first of its names that is free; of several each gets its own."""
    from ergon.repl.session.journal import names

    for found in names(path):
        with contextlib.suppress(FileExistsError):
            return found.open("xb")
    raise AssertionError  # names do not end


def _command(wishes: Wishes) -> str:
    """What joins the session."""
    return f"ergon repl --socket {wishes.socket}".rstrip()


def _pass_on(said: bytes) -> None:
    sys.stderr.write(clean(said.decode(errors="replace")))
    sys.stderr.flush()


def _as_options(wishes: Wishes) -> Iterator[str]:
    """What was wished of the engine, as a command line says it."""
    for field in fields(wishes):
        option, value = f"--{field.name.replace('_', '-')}", getattr(wishes, field.name)
        if field.name in _OURS or value == field.default or not value:
            continue
        if value is True:
            yield option
        else:
            yield from (f"{option}={one}" for one in _each(value))


def _each(value: object) -> tuple[object, ...]:
    return tuple(value) if isinstance(value, list | tuple) else (value,)
