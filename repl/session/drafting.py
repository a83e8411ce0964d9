"""How a line is drafted: its place among the lines that wait, and the version that checks it.

Nothing changes by a draft; a schedule takes it over, or drafts it again.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.repl.language.commands import NOW
from ergon.repl.session.groups import StagedGroup, staged_group_of
from ergon.repl.session.line_kinds import RULE_BY_KIND, LineKind
from ergon.repl.session.unheard import check_unheard
from ergon.repl.session.version import NotTakenError
from ergon.repl.session.waiting_lines import WaitingLine, WaitingLines

if TYPE_CHECKING:
    from ergon.repl.session.changes import Changes
    from ergon.repl.session.clock import Timing
    from ergon.repl.session.entry import Entry
    from ergon.repl.session.making_time import MakingTime
    from ergon.repl.session.makings import VersionMaker
    from ergon.repl.session.moments import Moments
    from ergon.repl.session.running import RunningVersion

# A line joins those under way to its beat if this much time is left when all are made [s].
_SPARE_SECONDS = 0.05


@dataclass(frozen=True, slots=True)
class Request:
    """A line as it is asked for, with its number, and the grid on which it acts.

    `n_drops` says how often all lines had been dropped when it was typed.
    """

    entry: Entry
    number: int
    grid: Length | None
    n_drops: int


@dataclass(frozen=True, slots=True)
class Sketch:
    """The `requested` line, the `lines` among which it is to wait, the `running` version that
    they follow, and the `soonest_frame` of a new line. One that `is_checked` was made before.
    """

    lines: WaitingLines
    running: RunningVersion
    requested: WaitingLine
    soonest_frame: int
    is_checked: bool


@dataclass(frozen=True, slots=True)
class Draft:
    """The `requested` line, and its entry among the waiting `lines`, made from the
    `base_lines`; `checked_version` is its version.
    """

    base_lines: WaitingLines
    lines: WaitingLines
    requested: WaitingLine
    drafted_line: WaitingLine
    checked_version: RunningVersion
    staged_group: StagedGroup | None = None


class Drafts:
    """Drafts lines. A sketch reads what is under way, so that it needs the schedule's lock; a
    draft is made of it in any thread.
    """

    def __init__(
        self,
        moments: Moments,
        changes: Changes,
        timing: Timing,
        version_maker: VersionMaker,
        making_time: MakingTime,
    ) -> None:
        """Begin with what says when lines can act, and what makes their versions."""
        self._moments, self._changes, self._timing = moments, changes, timing
        self._version_maker, self._making_time = version_maker, making_time

    def sketch(
        self, request: Request, waiting_lines: WaitingLines, requested: WaitingLine | None = None
    ) -> Sketch:
        """The place of a line among those that wait.

        A line that was `requested` before keeps its place, and was checked then. Raises
        NotTakenError where its beat is past.
        """
        placed_line = self._after_fence(
            requested or self._requested_line(request, waiting_lines), waiting_lines
        )
        placed_line = self._after_changes(placed_line)
        soonest_frame = self._moments.soonest_frame()
        return Sketch(
            waiting_lines, self._changes.running, placed_line, soonest_frame, requested is not None
        )

    def draft(self, sketch: Sketch) -> Draft:
        """A line among those that wait, and what must be made to check it.

        Raises one of `REFUSALS`.
        """
        running, soonest_frame = sketch.running, sketch.soonest_frame
        inserted_lines, inserted_line = sketch.lines.inserted(sketch.requested, soonest_frame)
        checked_version, staged_group = replace(running, version=inserted_line.result()), None
        if not (sketch.is_checked or inserted_line.rule.is_quick):
            making_begin_frame = self._making_time.begin_frame()
            group_lines = staged_group_of(inserted_lines.lines)
            if inserted_line in group_lines:
                staged_version = self._version_maker.staged(running, group_lines)
                staged_group = StagedGroup(group_lines, running, staged_version)
            else:  # a line that waits for others is only checked
                line_start_frame = (
                    soonest_frame
                    if inserted_line.start_frame is None
                    else inserted_line.start_frame
                )
                staged_version = self._version_maker.staged(
                    running, [replace(inserted_line, start_frame=line_start_frame)]
                )
            if inserted_line.version_before is not None and not (
                inserted_line.reads_files or inserted_line.restores_version
            ):
                check_unheard(inserted_line.version_before.sounding, staged_version.stage)
            checked_version = replace(staged_version, version=inserted_line.result())
            self._making_time.add(making_begin_frame)
        return Draft(
            sketch.lines,
            inserted_lines,
            sketch.requested,
            inserted_line,
            checked_version,
            staged_group,
        )

    def joined_frame(self, request: Request, waiting_lines: WaitingLines) -> int | None:
        """The frame of the lines under way to the beat of a line, if there is time to make all of
        them: lines of one beat take effect together.
        """
        entry = request.entry
        pending_changes = [change for change in self._changes.pending if not change.is_gain_change]
        if (
            not pending_changes
            or RULE_BY_KIND[entry.kind].is_quick
            or entry.sets_running is not None
        ):
            return None
        last_change = pending_changes[-1]
        ready_frame = self._moments.tick_after(self._making_time.expected_seconds + _SPARE_SECONDS)
        is_running = self._changes.running.clock.is_running
        if not last_change.lines or not is_running or last_change.frame < ready_frame:
            return None
        if any(line.sets_running is not None or line.resets for line in last_change.lines):
            return None
        with contextlib.suppress(NotTakenError):
            tempo = waiting_lines.head.piece.tempo_map
            beat, _ = self._moments.place_from(ready_frame, tempo, entry.when, request.grid)
            if abs(beat - last_change.lines[-1].beat) <= SAME:
                return last_change.frame
        return None

    def _requested_line(self, request: Request, waiting_lines: WaitingLines) -> WaitingLine:
        """The line of a request."""
        entry = request.entry
        tempo = waiting_lines.head.piece.tempo_map
        line_beat, start_frame = self._moments.place(tempo, entry.when, request.grid, entry.kind)
        if start_frame is None:
            start_frame = self._start_after_play(line_beat, entry.kind, waiting_lines)
        is_now = entry.when is NOW or (entry.when is None and request.grid is None)
        return WaitingLine(
            number=request.number,
            line=entry.line,
            edit=entry.numbered_edit(request.number),
            kind=entry.kind,
            beat=line_beat if entry.enter_beat is None else entry.enter_beat,
            start_frame=start_frame,
            sets_running=entry.sets_running,
            resets=entry.resets,
            is_now=is_now or entry.sets_running is not None,
            reads_files=entry.reads_files,
            restores_version=entry.restores_version,
            is_named=isinstance(entry.when, Position | Length),
        )

    def _start_after_play(
        self, line_beat: float, line_kind: LineKind, waiting_lines: WaitingLines
    ) -> int | None:
        """The frame of a beat that is ahead, if the piece is about to start."""
        start_line = next((line for line in waiting_lines.lines if line.sets_running), None)
        if start_line is None or start_line.clock is None or start_line.start_frame is None:
            return None
        tempo, lead = (
            waiting_lines.head.piece.tempo_map,
            self._timing.change_lead(line_kind is LineKind.STOPS),
        )
        return max(
            start_line.start_frame,
            self._timing.takeover_frame(start_line.clock, tempo, line_beat, lead),
        )

    def _after_fence(self, new_line: WaitingLine, lines: WaitingLines) -> WaitingLine:
        """A line that does not overtake an earlier one; it may move to that one's beat."""
        fence = lines.fence(new_line)
        if fence is None:
            return new_line
        return replace(new_line.moved_to(fence.beat, fence.start_frame), is_now=fence.is_now)

    def _after_changes(self, line: WaitingLine) -> WaitingLine:
        """A line that moves faders, not before the change under way that makes what it names; one
        that restores a version, not before any.
        """
        if line.start_frame is None:
            return line
        pending_changes = [change for change in self._changes.pending if change.lines]
        start_frame = line.start_frame
        if line.restores_version:
            start_frame = max([start_frame, *(change.frame for change in pending_changes)])
        elif line.kind is LineKind.FADERS:
            start_frame = self._changes.ready_frame(start_frame, (line,))
        if start_frame == line.start_frame:
            return line
        change_beat = next(
            (
                waiting_line.beat
                for change in pending_changes
                for waiting_line in change.lines
                if change.frame == start_frame
            ),
            line.beat,
        )
        return line.moved_to(change_beat, start_frame)
