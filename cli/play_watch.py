"""`ergon play --watch`: a session that reloads its score whenever it is saved."""

from __future__ import annotations

import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.api.options import SessionOptions

from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.api.options import PlayOptions
    from ergon.repl.session_protocol import SessionProtocol

_POLL_SECONDS = 0.1  # [s] between two looks for messages
# Options that a session does not have: it has no end, and makes its own plan.
_EXCLUDED = ("until", "loop", "method", "error", "cents", "plan", "draft", "seed", "see")


def play_watched(console: Console, path: str, play_options: PlayOptions, *, strict: bool) -> None:
    """Play a score until Ctrl-C; each saved version plays on from the position of the one before.

    Raises Refused, ScoreError, OptionError and DeviceError.
    """
    from ergon import _core
    from ergon.api import local_session, score

    if path == score.STDIN:
        raise Refused("--watch needs a file: the score cannot be -")
    for name in _EXCLUDED:
        if getattr(play_options, name) not in (None, False):
            raise Refused(f"--watch excludes --{name}")
    if strict:
        raise Refused("--watch excludes --strict")
    common_names = {option_field.name for option_field in fields(SessionOptions)} & {
        option_field.name for option_field in fields(play_options)
    }
    arguments = {name: getattr(play_options, name) for name in common_names}
    with tempfile.TemporaryDirectory(prefix="ergon-play-") as folder:
        options = SessionOptions(**arguments, watch=True, journal=Path(folder, "session.jsonl"))
        session = local_session.begin_session(path, options, console)
        _core.stop_on_signals([signal.SIGINT], ends=True)
        follow(session, console.say, play_options.from_, _timed_looks())


def follow(
    session: SessionProtocol,
    say: Callable[[str], None],
    start_position: str | None,
    looks: Iterator[None],
) -> None:
    """Play a session from a position, print its messages at each look, and close it."""
    try:
        reply = session.submit("play" if start_position is None else f"play from {start_position}")
        if not reply.taken:
            raise Refused(f"--from: {reply.text}")
        say("a saved version plays on from the next bar; Ctrl-C ends")
        for _ in looks:
            for message in session.messages():
                say(message)
    finally:
        session.close()


def _timed_looks() -> Iterator[None]:
    while True:
        time.sleep(_POLL_SECONDS)
        yield
