"""A session whose engine is a process of its own: it is served, joined, or started."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING

from ergon.common.errors import ErgonError
from ergon.common.report import Report
from ergon.common.terminal import clean

from .errors import EngineExitError, OptionError
from .local_session import begin_session
from .options import SessionOptions

if TYPE_CHECKING:
    from ergon.repl.wire.remote import RemoteSession

_POLL_SECONDS = 0.05  # [s] between two looks whether the engine answers
# On Windows a process that outlives its terminal: in a group of its own, without a window.
_DETACHED_FLAGS = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0) | getattr(
    subprocess, "CREATE_NO_WINDOW", 0
)
# Options that the engine's process gets in another way.
_SEPARATE_OPTIONS = ("socket", "journal")


def serve(path: str | None, options: SessionOptions, report: Report) -> None:
    """Run the engine in this process, until the session ends."""
    with _as_option_errors():
        _serve_session(path, options, _socket_path(options), report)


def join(path: str | None, options: SessionOptions, report: Report) -> RemoteSession:
    """Join the session that is served; if there is none, start one that outlives this process.

    Raises OptionError, and EngineExitError where the new process ends before it answers.
    """
    with _as_option_errors():
        return _join_session(path, options, _socket_path(options), report)


@contextlib.contextmanager
def _as_option_errors() -> Iterator[None]:
    """Turn errors of a socket into an OptionError."""
    from ergon.repl.wire.local_socket import SocketError

    try:
        yield
    except SocketError as error:
        raise OptionError("socket", str(error)) from None


def _socket_path(session_options: SessionOptions) -> Path:
    from ergon.repl.wire.local_socket import default_path

    if not session_options.socket:
        return default_path()
    if session_options.socket.endswith((".yaml", ".yml")):
        raise OptionError(
            "socket", f"a score comes first: ergon repl {session_options.socket} --socket"
        )
    return Path(session_options.socket).absolute()


# --- the engine's process ------------------------------------------------------------------------


def _serve_session(
    path: str | None, session_options: SessionOptions, socket_path: Path, report: Report
) -> None:
    from ergon._core import __version__, stop_on_signals
    from ergon.repl.session.sounding import SoundingPlaces
    from ergon.repl.wire.local_socket import ServerSocket
    from ergon.repl.wire.serve import SessionServer

    server_socket = ServerSocket(
        socket_path
    )  # before anything sounds: two engines at one place are one too many
    try:
        session = begin_session(path, session_options, report)
    except BaseException:
        server_socket.close()
        raise
    description = {
        "version": __version__,
        "score": os.path.abspath(session.schedule.head.texts.path),
        "journal": "" if session.journal is None else str(session.journal.path.absolute()),
    }
    follow = partial(SoundingPlaces, session.schedule)
    SessionServer(session, server_socket, description, stop_on_signals, follow).run()


# --- the prompt's process ------------------------------------------------------------------------


def _join_session(
    path: str | None, session_options: SessionOptions, socket_path: Path, report: Report
) -> RemoteSession:
    from ergon.repl.wire.local_socket import NoSessionError
    from ergon.repl.wire.protocol import ProtocolError
    from ergon.repl.wire.remote import RemoteSession

    try:
        remote_session = RemoteSession(socket_path, _join_command(session_options))
    except NoSessionError as error:
        if path is None and session_options.resume is None:
            raise OptionError(
                "socket", f"{error}; `ergon repl SCORE --socket` begins one"
            ) from None
        return _start_engine(path, session_options, socket_path, report)
    except ProtocolError as error:
        raise ErgonError(f"{socket_path}: {error}") from None
    played_score = str(remote_session.about.get("score", ""))
    if session_options.resume is not None or (
        path is not None and os.path.abspath(path) != played_score
    ):
        remote_session.close()
        raise ErgonError(
            f"a session at {socket_path} plays {played_score} already; "
            f"`{_join_command(session_options)}` "
            "joins it, --socket with another path begins another session"
        )
    report.say(f"joined the session that plays {played_score}")
    return remote_session


def _start_engine(
    path: str | None, session_options: SessionOptions, socket_path: Path, report: Report
) -> RemoteSession:
    """Start the engine's process, in a process session of its own (setsid); pass on its stderr
    until it answers.
    """
    from ergon.repl.wire.local_socket import NoSessionError
    from ergon.repl.wire.protocol import ProtocolError
    from ergon.repl.wire.remote import RemoteSession

    command = [sys.executable, "-m", "ergon.cli", "repl", *([path] if path is not None else [])]
    command += [
        *_command_line_options(session_options),
        f"--journal={session_options.journal}",
        f"--socket={socket_path}",
        "--engine",
    ]
    with (
        _new_log_file(Path(session_options.journal).with_suffix(".log")) as log_sink,
        open(log_sink.name, "rb") as log_file,
    ):
        log_path = Path(log_sink.name)
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=log_sink,
            stderr=log_sink,
            start_new_session=True,
            creationflags=_DETACHED_FLAGS,
        )
        try:
            while True:
                exit_code = process.poll()  # asked before its last output is read
                _write_stderr(log_file.read())
                if exit_code is not None:
                    log_path.unlink()
                    raise EngineExitError(abs(exit_code))
                with contextlib.suppress(NoSessionError):
                    remote_session = RemoteSession(socket_path, _join_command(session_options))
                    break
                time.sleep(_POLL_SECONDS)
            _write_stderr(log_file.read())
        except ProtocolError as error:
            process.terminate()
            raise ErgonError(f"{socket_path}: {error}") from None
        except EngineExitError:
            raise
        except BaseException:  # Ctrl-C while waiting: the engine is not wanted
            process.terminate()
            raise
    journal = os.path.relpath(
        str(remote_session.about.get("journal", "")) or session_options.journal
    )
    report.say(f"the engine is process {process.pid}; it writes {journal} and {log_path}")
    return remote_session


def _new_log_file(path: Path) -> IO[bytes]:
    """A new file under the first free one of its names: each of several engines gets its own."""
    from ergon.repl.session.journal import numbered_paths

    for log_path in numbered_paths(path):
        with contextlib.suppress(FileExistsError):
            return log_path.open("xb")
    raise AssertionError  # names do not end


def _join_command(options: SessionOptions) -> str:
    """The command that joins the session."""
    return f"ergon repl --socket {options.socket}".rstrip()


def _write_stderr(text: bytes) -> None:
    sys.stderr.write(clean(text.decode(errors="replace")))
    sys.stderr.flush()


def _command_line_options(session_options: SessionOptions) -> Iterator[str]:
    """The options, as a command line for the engine."""
    for field in fields(session_options):
        option_name = f"--{field.name.replace('_', '-')}"
        field_value = getattr(session_options, field.name)
        if field.name in _SEPARATE_OPTIONS or field_value == field.default:
            continue
        if field_value is True:
            yield option_name
        elif field_value is not None and field_value is not False:
            values = _option_values(field_value)
            yield from (f"{option_name}={option_value}" for option_value in values)


def _option_values(option_value: object) -> tuple[object, ...]:
    return tuple(option_value) if isinstance(option_value, list | tuple) else (option_value,)
