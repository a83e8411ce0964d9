"""Panic and release: end sound and force at once, and switch them on again."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Protocol

from ergon.repl.language.commands import NOW, When
from ergon.repl.session import version_edits
from ergon.repl.session.commits import REFUSALS

if TYPE_CHECKING:
    from ergon.repl.session.commits import Commits, VersionEdit, WaitingLine
    from ergon.repl.session.computing import Computing

PANIC_MESSAGE = (
    "panic: no sound, no force; `release` ends the panic, `undo` brings back what was played, and "
    "`play` starts the piece"
)
LET_GO_MESSAGE = "forces on all hands are off; `release` switches them on"


class StoppedSession(Protocol):
    """The session on which a stop acts: its lines, its engine, and its messages."""

    commits: Commits
    computing: Computing
    lock: threading.RLock
    number: int

    def say(self, message: str) -> None:
        """Add a message."""

    def note_dropped(self, waiting: WaitingLine) -> None:
        """Note that a line will not take effect."""

    def queue(
        self,
        line: str,
        edit: VersionEdit,
        when: When = None,
        *,
        sets_running: bool | None = None,
        resets: bool = False,
        is_limited: bool = True,
    ) -> object:
        """Let a line wait for its boundary."""


class Stops:
    """The stops of a session; `panic` and `let_go` take no lock, so that they never wait for a
    line.
    """

    def __init__(self, session: StoppedSession) -> None:
        """Begin without a stop."""
        self._session = session
        self._count = 0
        self._panics = self._resets = 0  # panics, and those whose reset is done
        self._line_at_reset: int | None = None  # the number of lines at the last reset
        # For the line that is being done: whether it may release, and the number of stops before
        # it.
        self._line = (True, 0)
        self._is_let_go_reported = False  # whether it was reported that forces are off
        self.panicked = False

    @property
    def count(self) -> int:
        """The number of stops so far."""
        return self._count

    def note_line(self, releases: bool, count: int) -> None:
        """Note that a line begins which was entered after `count` stops."""
        self._line = releases, count

    @property
    def has_let_go(self) -> bool:
        """Whether forces are off, by `let_go` or by a signal."""
        return self._session.commits.engine.status().let_go

    @property
    def is_stopped(self) -> bool:
        """Whether sound or force is off until `release`."""
        return self.panicked or self.has_let_go

    @property
    def may_release(self) -> bool:
        """Whether no stop was entered after the line that is being done."""
        releases, count = self._line
        return releases and count == self._count

    def panic(self) -> None:
        """End sound and force now; waiting lines and gestures are dropped soon after."""
        self._session.commits.engine.panic()
        self._session.computing.cancel()
        self._count += 1
        self._panics += 1
        self._say_panic()
        threading.Thread(target=self.reset_after_panic, daemon=True).start()

    def panic_in_turn(self) -> None:
        """Do the line `panic` in its turn: also drop what lines before it have begun."""
        self._session.commits.engine.panic()
        self._panics += 1
        self._say_panic()
        self.reset_after_panic()

    def _say_panic(self) -> None:
        if not self.panicked:
            self.panicked = True
            self._session.say(PANIC_MESSAGE)

    def let_go(self) -> None:
        """End every force, until `release`; the sound goes on."""
        self._session.commits.engine.let_go()
        self._count += 1
        if self._session.commits.real and not self._is_let_go_reported:
            self._is_let_go_reported = True
            self._session.say(LET_GO_MESSAGE)

    def release(self) -> None:
        """Switch sound and force on again."""
        self.reset_after_panic()
        self._line_at_reset = None
        self._session.commits.engine.release()
        self.panicked = self._is_let_go_reported = False

    def reset_after_panic(self) -> None:
        """Reset after a panic: no line waits, no gesture plays, every mass is at its start."""
        session = self._session
        with session.lock:
            if self._resets == self._panics:
                return
            self._resets = self._panics
            if self._line_at_reset == session.number:
                return
            for one in session.commits.drop_all():
                session.note_dropped(one)
            try:
                session.queue(
                    "panic",
                    version_edits.hush,
                    NOW,
                    sets_running=False,
                    resets=True,
                    is_limited=False,
                )
            except REFUSALS as error:
                session.say(f"the piece could not be reset after the panic: {error}")
            self._line_at_reset = session.number
