"""A session in whatever terminal there is."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.terminal import clean
from ergon.repl.session_protocol import SessionProtocol

from .error_boundary import ErrorBoundary
from .plain import Plain
from .signals import Watch, put_off, unstopped, unwatched

if TYPE_CHECKING:
    from .screen import Screen

REFUSED = 1  # the exit code under `strict` when a line was not taken


def run(
    session: SessionProtocol,
    *,
    plain: bool = False,
    strict: bool = False,
    history: Path | None,
    watch: Watch = unwatched,
) -> int:
    """Serve a session until somebody leaves, and close it; the exit code.

    `plain` draws nothing and prints lines, as it does where there is no terminal, or a dumb one.
    `history` is the file of lines typed before (`history_of_user()`), None for none. SIGTERM,
    SIGHUP and, in a script, Ctrl-C close the session and then act as they would have; `watch` has
    them end forces and sound before that. In a terminal Ctrl-C clears what is typed; while a line
    is at work it lets go of every hand.
    """
    refused = 0
    calm = ErrorBoundary(session)
    server = _server(calm, plain or not drawable(), history, watch)
    with put_off(server.end, watch), unstopped(watch):
        try:
            refused = server.run()
        finally:
            calm.close()
    for message in calm.messages():
        print(clean(message))
    return REFUSED if strict and refused else 0


def _server(
    session: ErrorBoundary, plain: bool, history: Path | None, watch: Watch
) -> Plain | Screen:
    if plain:
        return Plain(session, sys.stdin, sys.stdout, watch)
    from .screen import Screen

    return Screen(session, history, watch)


def drawable() -> bool:
    """Whether there is a terminal in which a line can be drawn anew."""
    dumb = os.environ.get("TERM", "").lower() in ("dumb", "unknown")
    return sys.stdin.isatty() and sys.stdout.isatty() and not dumb


def history_of_user(environment: Mapping[str, str] = os.environ) -> Path | None:
    """$XDG_STATE_HOME/ergon/history, or ~/.local/state/ergon/history."""
    base = environment.get("XDG_STATE_HOME", "")
    if Path(base).is_absolute():  # the specification says to ignore relative paths
        return Path(base) / "ergon" / "history"
    try:
        return Path.home() / ".local" / "state" / "ergon" / "history"
    except RuntimeError:  # nobody's
        return None
