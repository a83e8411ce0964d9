"""Panic and release: end sound and force at once, and switch them on again."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from ergon.repl.language.commands import NOW
from ergon.repl.session import version_edits
from ergon.repl.session.entry import Entry
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.version import first_line
from ergon.repl.session.waiting_lines import REFUSALS

if TYPE_CHECKING:
    from ergon.repl.session.computing import Computations
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.session_log import SessionLog
    from ergon.repl.session.waiting_lines import WaitingLine

_LISTED_MAX = 5  # lines that a message names
PANIC_MESSAGE = (
    "panic: no sound, no force; `release` ends the panic, `undo` brings back what was played, and "
    "`play` starts the piece"
)
LET_GO_MESSAGE = "forces on all hands are off; `release` switches them on"


class Stops:
    """The stops of a session; `panic` and `let_go` never wait for a line."""

    def __init__(
        self,
        schedule: Schedule,
        computations: Computations,
        log: SessionLog,
        queue_line: Callable[[Entry], Any],
        drop_line: Callable[[WaitingLine], None],
    ) -> None:
        """Begin without a stop; `queue_line` lets a line wait for its frame, `drop_line` removes
        it.
        """
        self._schedule = schedule
        self._computations = computations
        self._log = log
        self._queue_line = queue_line
        self._drop_line = drop_line
        self._n_stops = 0
        self._n_panics = self._n_finished_resets = 0  # panics, and those whose reset is done
        # For the line that a thread does: whether it may release, and the number of stops before.
        self._line_state = threading.local()
        self._is_let_go_reported = False  # whether it was reported that forces are off
        self._lock = threading.RLock()
        self._last_reset_version: int | None = None  # the line of the last reset
        self.panicked = False

    def begin_line(self, may_release: bool) -> None:
        """Note that this thread begins a line."""
        self._line_state.state = may_release, self._n_stops

    @property
    def has_let_go(self) -> bool:
        """Whether forces are off, by `let_go` or by a signal."""
        return self._schedule.engine.status().is_let_go

    @property
    def is_stopped(self) -> bool:
        """Whether sound or force is off until `release`."""
        return self.panicked or self.has_let_go

    @property
    def n_panics(self) -> int:
        """How many panics there were; each puts all masses at their start."""
        return self._n_panics

    @property
    def may_release(self) -> bool:
        """Whether no stop was entered after the line that is being done."""
        may_release, n_stops_before = getattr(self._line_state, "state", (True, self._n_stops))
        return may_release and n_stops_before == self._n_stops

    def panic(self) -> None:
        """End sound and force now; waiting lines and gestures are dropped soon after."""
        self._schedule.engine.panic()
        self._computations.cancel()
        self._n_stops += 1
        self._n_panics += 1
        self._say_panic()
        threading.Thread(target=self.reset_after_panic, daemon=True).start()

    def panic_in_turn(self) -> None:
        """Do the line `panic` in its turn: also drop what lines before it have begun."""
        self._schedule.engine.panic()
        self._n_panics += 1
        self._say_panic()
        self.reset_after_panic()

    def _say_panic(self) -> None:
        if not self.panicked:
            self.panicked = True
            self._log.say(PANIC_MESSAGE)

    def _say_cancelled(self, line_texts: Sequence[str]) -> None:
        if line_texts:
            listed = ", ".join(f"'{first_line(text)}'" for text in line_texts[:_LISTED_MAX])
            n_more = len(line_texts) - _LISTED_MAX
            others = f" and {n_more} more" if n_more > 0 else ""
            self._log.say(f"the panic cancelled lines that waited: {listed}{others}")

    def let_go(self) -> None:
        """End every force, until `release`; the sound goes on."""
        self._schedule.engine.let_go()
        self._n_stops += 1
        if self._schedule.real_hands and not self._is_let_go_reported:
            self._is_let_go_reported = True
            self._log.say(LET_GO_MESSAGE)

    def release(self) -> None:
        """Switch sound and force on again. What is left of a panic is cancelled: a reset that
        comes later would stop what was started since.
        """
        with self._lock:
            self._n_finished_resets = self._n_panics
            self._last_reset_version = None
            self._cancel_reset()
            self._schedule.engine.release()
            self.panicked = self._is_let_go_reported = False

    def _cancel_reset(self) -> None:
        with self._schedule.lock:
            for line in [line for line in self._schedule.waiting if line.resets]:
                self._drop_line(line)

    def reset_after_panic(self) -> None:
        """Reset after a panic: no line waits, no gesture plays, every mass is at its start."""
        with self._lock, self._schedule.lock:
            if self._n_finished_resets == self._n_panics:
                return
            self._n_finished_resets = self._n_panics
            if self._schedule.head.number == self._last_reset_version:
                return  # nothing was typed since the last one
            dropped_lines = self._schedule.drop_all()
            for line in dropped_lines:
                self._log.note_dropped(line)
            self._say_cancelled([line.line for line in dropped_lines if line.line])
            stop_entry = Entry(
                "panic",
                version_edits.end_all_playing,
                LineKind.STOPS,
                NOW,
                sets_running=False,
                resets=True,
            )
            try:
                _, queued_version = self._queue_line(stop_entry)
                self._last_reset_version = queued_version.version.number
            except REFUSALS as error:
                self._log.say(f"the piece could not be reset after the panic: {error}")
