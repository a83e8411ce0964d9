"""Values that change faster than lines are computed: controllers by MIDI, levels by OSC."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from ergon.repl.language.commands import NOW, When
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.session import version_edits
from ergon.repl.session.entry import Entry
from ergon.repl.session.line_kinds import kind_of
from ergon.repl.session.waiting_lines import REFUSALS

if TYPE_CHECKING:
    from ergon.repl.language.scope import Scope
    from ergon.repl.session.history import History
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.session_log import SessionLog
    from ergon.repl.session.version import Version

# The line that sets the value in a version; None if that version does not use it.
LineMaker = Callable[["Version"], str | None]


class FastValues:
    """The latest value of each name, set by lines. Any thread may call `set_soon`."""

    def __init__(
        self,
        schedule: Schedule,
        history: History,
        log: SessionLog,
        queue_line: Callable[[Entry], tuple[str, RunningVersion]],
        current_scope: Callable[[], Scope],
    ) -> None:
        """Begin without values. `queue_line` lets a line wait for its frame; `current_scope`
        returns the names that a line may use.
        """
        self._schedule = schedule
        self._history = history
        self._log = log
        self._queue_line = queue_line
        self._current_scope = current_scope
        self._line_makers: dict[str, LineMaker] = {}
        self._last_number = 0  # number of the last line made from movements
        self._last_names: tuple[str, ...] = ()  # values that moved
        self._refused_names: tuple[str, ...] = ()

    def set_soon(self, name: str, make_line: LineMaker) -> None:
        """Keep the value of a name, in place of one that is not set yet."""
        self._line_makers[name] = make_line

    def set_due(self) -> None:
        """Set the values that have come, by one line; wait as long as the last such line has not
        taken effect.

        Successive lines with the same names are one entry of the history, so that `undo` reverts
        the movement as a whole.
        """
        schedule = self._schedule
        if not self._line_makers or any(
            waiting_line.number == self._last_number for waiting_line in schedule.waiting
        ):
            return
        line_makers, self._line_makers = self._line_makers, {}
        head = schedule.head
        lines_by_name = {
            name: line_text
            for name, make_line in line_makers.items()
            if (line_text := make_line(head)) is not None
        }
        if not lines_by_name:
            return
        self._set(tuple(lines_by_name), "\n".join(lines_by_name.values()), NOW)

    def set_now(self, name: str, line: str) -> None:
        """Set a value at once, by a line that says itself when it acts."""
        self._set((name,), line, None)

    def _set(self, names: tuple[str, ...], line_text: str, when: When) -> None:
        """Queue a line; if the last line of the history has the same names, it is replaced."""
        is_same = names == self._last_names and self._history.current_number == self._last_number
        try:
            commands = parse(line_text, self._current_scope())
            line_time = next(
                (command.when for command in commands if command.when is not None), when
            )
            edit = version_edits.combine_edits(commands)
            replaced_number = self._last_number if is_same else None
            _, queued_version = self._queue_line(
                Entry(
                    line_text, edit, kind_of(commands), line_time, replaced_number=replaced_number
                )
            )
        except (Refusal, *REFUSALS) as error:
            if names != self._refused_names:  # one line for the movement, not one for each value
                self._refused_names = names
                self._log.say(f"{', '.join(names)}: {getattr(error, 'message', None) or error}")
            return
        self._refused_names = ()
        self._last_number, self._last_names = queued_version.version.number, names
