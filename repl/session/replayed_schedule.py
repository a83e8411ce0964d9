"""The schedule of a journal: the same changes at the same frames."""

from __future__ import annotations

import math
from collections.abc import MutableMapping, Sequence
from typing import TYPE_CHECKING

from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.schedule import Schedule
from ergon.repl.session.version import PastVersion
from ergon.repl.session.waiting_lines import WaitingLine, WaitingLines

if TYPE_CHECKING:
    from ergon.repl.session.engine import EngineEvent


class ReplayedSchedule(Schedule):
    """A schedule whose lines and skips come from a journal."""

    next_frame: float = math.inf  # frame of the next change in the journal

    def perform_lines(
        self, lines: Sequence[WaitingLine], versions: MutableMapping[int, PastVersion]
    ) -> None:
        """Let lines take effect together at their frame, and keep their versions: a line may
        restore that of one before it.

        Raises one of `REFUSALS`.
        """
        waiting_lines = WaitingLines(self.running.version, self.running.clock, self.timing)
        for new_line in lines:
            waiting_lines, line = waiting_lines.inserted(new_line, 0)
            versions[line.number] = PastVersion.from_version(line.result())
        line_group, running = waiting_lines.lines, self.running
        line_kinds = {new_line.kind for new_line in line_group}
        if line_kinds == {LineKind.FADERS}:
            self._move_faders(line_group)
        elif line_kinds == {LineKind.STOPS}:
            self._hand_lines(line_group, self.version_maker.cut_version(running, line_group))
        else:
            self._hand_lines(line_group, self.version_maker.staged(running, line_group))
        self.reports.clear()

    def skip(self, frame: int) -> None:
        """Go on at a frame, where the session could not play for a while before."""
        self._extensions.send(self.version_maker.extended(self.running, frame))

    def take_events(self) -> Sequence[EngineEvent]:
        """The events of the engine; changes are noted."""
        engine_events = self.engine.events()
        for event in engine_events:
            if event.ticket is not None:
                self.note_event(event)
        self.reports.clear()
        return engine_events

    def _extension_frame(self) -> int | None:
        """The frame of the next extension: before the next change, which may extend it too."""
        extension_frame = super()._extension_frame()
        is_over = self.running.timeline_end >= self.version_maker.latest_beat
        return (
            None
            if extension_frame is None or is_over or extension_frame >= self.next_frame
            else extension_frame
        )
