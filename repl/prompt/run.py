"""Runs a session at a prompt that suits the terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.terminal import clean
from ergon.common.user_folders import state_folder
from ergon.repl.session_protocol import SessionProtocol, SignalWatch

from .error_boundary import ErrorBoundary
from .plain import PlainPrompt
from .signals import suspension_disabled, termination_deferred, watch_nothing

if TYPE_CHECKING:
    from .screen import ScreenPrompt

EXIT_REFUSED = 1  # the exit code under `strict` when a line was not taken


def run(
    session: SessionProtocol,
    *,
    plain: bool = False,
    strict: bool = False,
    history: Path | None,
    watch: SignalWatch = watch_nothing,
) -> int:
    """Serve a session until it is left, and close it; the exit code.

    `plain` prints lines instead of drawing a screen; so does a prompt without a terminal, or
    with one that cannot redraw. `history` is the file of earlier lines (`history_of_user()`),
    None for none. SIGTERM, SIGHUP and, in a script, Ctrl-C close the session and then have their
    usual effect; before that, `watch` makes them end forces and sound. In a terminal, Ctrl-C
    clears the typed text; while a line is computed, it ends all forces.
    """
    n_refused = 0
    boundary = ErrorBoundary(session)
    prompt = _make_prompt(boundary, plain or not can_redraw(), history, watch)
    with termination_deferred(prompt.end, watch), suspension_disabled(watch):
        try:
            n_refused = prompt.run()
        finally:
            boundary.close()
    for message in boundary.messages():
        print(clean(message))
    return EXIT_REFUSED if strict and n_refused else 0


def _make_prompt(
    session: ErrorBoundary, plain: bool, history: Path | None, watch: SignalWatch
) -> PlainPrompt | ScreenPrompt:
    if plain:
        return PlainPrompt(session, sys.stdin, sys.stdout, watch)
    from .screen import ScreenPrompt

    return ScreenPrompt(session, history, watch)


def can_redraw() -> bool:
    """Whether there is a terminal that can redraw a line."""
    is_dumb = os.environ.get("TERM", "").lower() in ("dumb", "unknown")
    return sys.stdin.isatty() and sys.stdout.isatty() and not is_dumb


def user_history(environment: Mapping[str, str] = os.environ) -> Path | None:
    """$XDG_STATE_HOME/ergon/history, or ~/.local/state/ergon/history."""
    folder = state_folder(environment)
    return None if folder is None else folder / "history"
