"""Accepted lines that wait for their frame, in the order of effect; the object never changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

from ergon._core import EngineError, StoppedError
from ergon.notation.clock.meter import SAME
from ergon.notation.text.edit import EditError
from ergon.repl.language.commands import Command
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import scope_of
from ergon.repl.session.clock import Clock, TakeoverBeats, Timing, takeover_beats
from ergon.repl.session.line_kinds import RULE_BY_KIND, KindRule, LineKind, must_keep_order
from ergon.repl.session.version import NotTakenError, Version, is_same_music
from ergon.scores.staging.refusals import StageError

if TYPE_CHECKING:
    from ergon.notation.clock.tempo import TempoMap

# The errors with which a line can be refused after it was parsed.
REFUSALS = (NotTakenError, StageError, EditError, EngineError, StoppedError)

# Makes a version from the one before it and the beat at which it takes effect.
VersionEdit = Callable[[Version, float], Version]


@dataclass(frozen=True, slots=True, eq=False)
class WaitingLine:
    """An accepted line that has not taken effect yet.

    It acts on beat `beat`, and takes over at frame `start_frame`; None: the piece is stopped, and
    has not reached that beat. It starts the piece at its beat (`sets_running`), or stops it there
    (False). A line that `resets` puts all masses at their start; one that `is_now` acts as soon as
    possible; one that `restores_version` restores an earlier version. The beat of one that
    `is_named` was asked for. `version_before` and `version` are the versions before and after it,
    `clock` the clock after it. `n_slips` counts how often it was not ready in time.
    """

    number: int
    line: str
    edit: VersionEdit
    kind: LineKind
    beat: float
    start_frame: int | None
    sets_running: bool | None = None
    resets: bool = False
    is_now: bool = False
    reads_files: bool = False
    restores_version: bool = False
    is_named: bool = False
    version_before: Version | None = None
    version: Version | None = None
    clock: Clock | None = None
    n_slips: int = 0

    @property
    def rule(self) -> KindRule:
        """How it acts."""
        return RULE_BY_KIND[self.kind]

    def lead(self, timing: Timing) -> float:
        """How long before its beat it takes over [s]."""
        return timing.change_lead(self.kind is LineKind.STOPS)

    @property
    def frame(self) -> float:
        """Its frame; infinite if the piece must reach its beat first."""
        return math.inf if self.start_frame is None else self.start_frame

    def result(self) -> Version:
        """The version after it."""
        assert self.version is not None
        return self.version

    def moved_to(self, beat: float, start_frame: int | None) -> WaitingLine:
        """The line at another frame and beat. A line that starts or stops the piece keeps its
        beat.
        """
        beat = beat if self.sets_running is None else self.beat
        return replace(self, beat=beat, start_frame=start_frame)

    def is_before(self, other_line: WaitingLine) -> bool:
        """Whether it takes effect before a line that was typed later.

        Lines of one frame are in the order of typing. Lines for which the piece must first be
        played are in the order of their beats.
        """
        if self.start_frame is None and other_line.start_frame is None:
            return self.beat <= other_line.beat + SAME
        return self.frame <= other_line.frame

    def follows(self, earlier: WaitingLine) -> bool:
        """Whether it must act after an earlier line, however late that is.

        What restores a version follows every line that was typed before it, and is followed by
        every one typed after it: the version that it restores has nothing of these. Lines that
        need no stage wait for neither.
        """
        is_restoring = self.restores_version or earlier.restores_version
        is_quick = (earlier if self.restores_version else self).rule.is_quick
        keeps_order = must_keep_order(earlier.kind, self.kind) or (is_restoring and not is_quick)
        return self.number > earlier.number and keeps_order


class _BreaksLaterLineError(NotTakenError):
    """A line is refused because one that waits after it could then not be made."""


class LostLine(NamedTuple):
    """A line that can no longer take effect, and why."""

    line: WaitingLine
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class WaitingLines:
    """Lines in the order of effect, which follow the version `base_version` with its `clock`.

    `superseded` are those that were left out when the lines were last arranged: each would
    restore a version after a line typed later has restored another.
    """

    base_version: Version
    clock: Clock
    timing: Timing
    lines: tuple[WaitingLine, ...] = ()
    superseded: tuple[WaitingLine, ...] = ()

    @property
    def head(self) -> Version:
        """The version after all lines."""
        return self.lines[-1].result() if self.lines else self.base_version

    def version_at(self, beat: float) -> Version:
        """The version at a coming beat: with all lines that take effect by then."""
        versions = (line.result() for line in reversed(self.lines) if line.beat <= beat + SAME)
        return next(versions, self.base_version)

    def inserted(
        self, new_line: WaitingLine, soonest_frame: int
    ) -> tuple[WaitingLines, WaitingLine]:
        """The lines with one more, and the entry of that line.

        If it needs what a later line defines, it takes effect together with that line. Lines whose
        beat gets another frame take over at frame `soonest_frame` at the earliest. Raises one of
        `REFUSALS` if it cannot be made, or if a line after it could not.
        """
        first_index = sum(other_line.is_before(new_line) for other_line in self.lines)
        try:
            return self._with_line(new_line, first_index, soonest_frame)
        except _BreaksLaterLineError:
            raise
        except (NotTakenError, EditError) as refusal:
            for place_index in self._later_places(first_index):
                other_line = self.lines[place_index - 1]
                moved_line = replace(
                    new_line,
                    beat=other_line.beat,
                    start_frame=other_line.start_frame,
                    is_now=other_line.is_now,
                )
                try:
                    return self._with_line(moved_line, place_index, soonest_frame)
                except (NotTakenError, EditError):
                    continue
            raise refusal from None

    def _later_places(self, first: int) -> Iterable[int]:
        """Places behind the lines of each later frame."""
        for place_index in range(first + 1, len(self.lines) + 1):
            is_last = place_index == len(self.lines)
            if is_last or self.lines[place_index].frame != self.lines[place_index - 1].frame:
                yield place_index

    def _with_line(
        self, new_line: WaitingLine, place_index: int, soonest_frame: int
    ) -> tuple[WaitingLines, WaitingLine]:
        earlier_lines, later_lines = self.lines[:place_index], self.lines[place_index:]
        version_before, clock = self._state_after(earlier_lines)
        followed_line = self._follow(new_line, version_before, clock)
        arranged_lines, lost_lines = self._arranged(
            (*earlier_lines, followed_line), later_lines, soonest_frame
        )
        if lost_lines:
            (failed_line, failure_reason), *_ = lost_lines
            due_text = followed_line.result().piece.tempo_map.written(failed_line.beat)
            raise _BreaksLaterLineError(
                f"after this line, the waiting line '{failed_line.line}' (due at {due_text}) "
                f"would fail: {failure_reason}; `undo` cancels waiting lines, the last one first"
            )
        return arranged_lines, followed_line

    def without(self, number: int, soonest_frame: int) -> WaitingLines:
        """The lines without that of a number. Raises NotTakenError if one after it would fail."""
        place_index = next(
            i for i, waiting_line in enumerate(self.lines) if waiting_line.number == number
        )
        arranged_lines, lost_lines = self._arranged(
            self.lines[:place_index], self.lines[place_index + 1 :], soonest_frame
        )
        if lost_lines:
            raise NotTakenError(
                f"the waiting line '{lost_lines[0].line.line}' needs this one: "
                f"{lost_lines[0].reason}; `undo` cancels waiting lines, the last one first"
            )
        return arranged_lines

    def followed_by(
        self, new_lines: Sequence[WaitingLine], soonest_frame: int
    ) -> tuple[WaitingLines, list[LostLine]]:
        """These lines and `new_lines` behind them, sorted by their frames."""
        return self._arranged(self.lines, new_lines, soonest_frame)

    def slipped(
        self, late_lines: Sequence[WaitingLine], slip_beat: float, start_frame: int
    ) -> tuple[WaitingLines, list[LostLine], list[WaitingLine]]:
        """The lines after some were late and wait for another beat; also those that could not be
        made any more, and those that moved.

        A fence: lines that were typed after them and would overtake them move too.
        """
        moving_lines = [*late_lines]
        for waiting_line in sorted(self.lines, key=lambda waiting_line: waiting_line.number):
            is_fenced = any(
                waiting_line.follows(line) or self._begins_after(waiting_line, line)
                for line in moving_lines
            )
            is_early = waiting_line not in late_lines and waiting_line.frame < start_frame
            if is_fenced and is_early:
                moving_lines.append(waiting_line)
        moved_numbers = {line.number for line in moving_lines}
        while True:
            slipped_lines, lost_lines, moved_lines = self._moved(
                moved_numbers, slip_beat, start_frame
            )
            # What needs a late line waits for it too.
            dependent_numbers = {
                lost_line.line.number
                for lost_line in lost_lines
                if lost_line.line.number > min(moved_numbers)
            } - moved_numbers
            if not dependent_numbers:
                return slipped_lines, lost_lines, moved_lines
            moved_numbers |= dependent_numbers

    def _moved(
        self, moved_numbers: Container[int], slip_beat: float, start_frame: int
    ) -> tuple[WaitingLines, list[LostLine], list[WaitingLine]]:
        """The lines after some have moved to another beat, in the order of typing."""
        moved_lines = [
            _slipped_line(waiting_line, slip_beat, start_frame)
            for waiting_line in self.lines
            if waiting_line.number in moved_numbers
        ]
        moved_lines.sort(key=lambda waiting_line: waiting_line.number)
        other_lines = [
            waiting_line for waiting_line in self.lines if waiting_line.number not in moved_numbers
        ]
        earlier_lines = [
            waiting_line for waiting_line in other_lines if waiting_line.frame <= start_frame
        ]
        later_lines = [
            waiting_line for waiting_line in other_lines if waiting_line.frame > start_frame
        ]
        empty_queue = replace(self, lines=())
        lines, lost_lines = empty_queue._arranged(
            (), [*earlier_lines, *moved_lines, *later_lines], start_frame
        )
        return lines, lost_lines, moved_lines

    def fence(self, new_line: WaitingLine) -> WaitingLine | None:
        """The last earlier line that a new one must not overtake: one that has slipped, or that
        restores a version; one that acts as soon as possible or on the grid, unless the new one
        asks for less time; and one for the beat on which the new one starts the piece.
        """
        obstacles = [
            line
            for line in self.lines
            if line.frame > new_line.frame
            and (
                (new_line.follows(line) and _has_priority(line, new_line))
                or (line.frame < math.inf and self._begins_after(new_line, line))
            )
        ]
        return max(obstacles, key=lambda line: line.frame, default=None)

    def _begins_after(self, new_line: WaitingLine, earlier_line: WaitingLine) -> bool:
        """Whether a line starts the piece on the very beat that an earlier one is for."""
        return (
            new_line.sets_running is True
            and new_line.number > earlier_line.number
            and not self.clock.is_running
            and abs(earlier_line.beat - new_line.beat) <= SAME
        )

    def _state_after(self, waiting_lines: Sequence[WaitingLine]) -> tuple[Version, Clock]:
        if not waiting_lines:
            return self.base_version, self.clock
        last_line = waiting_lines[-1]
        assert last_line.clock is not None
        return last_line.result(), last_line.clock

    def _arranged(
        self,
        lines_before: tuple[WaitingLine, ...],
        lines_after: Sequence[WaitingLine],
        soonest_frame: int,
    ) -> tuple[WaitingLines, list[LostLine]]:
        """The lines in `lines_before`, which stay, and those in `lines_after`, with their new
        frames and versions.
        """
        version, clock = self._state_after(lines_before)
        tempo_map = version.piece.tempo_map
        if lines_before and lines_before[-1].start_frame is not None:
            soonest_frame = max(soonest_frame, lines_before[-1].start_frame)
        framed_lines = [
            self._framed(waiting_line, clock, tempo_map, soonest_frame)
            for waiting_line in lines_after
        ]
        framed_lines.sort(key=_effect_key)
        arranged_lines, lost_lines, superseded = [*lines_before], [], []
        restored_number = max(
            (line.number for line in lines_before if line.restores_version), default=-1
        )
        for waiting_line in framed_lines:
            if waiting_line.restores_version and waiting_line.number < restored_number:
                superseded.append(waiting_line)
                continue
            try:
                followed_line = self._follow(waiting_line, version, clock)
            except REFUSALS as error:
                lost_lines.append(LostLine(waiting_line, str(error)))
                continue
            arranged_lines.append(followed_line)
            version, clock = self._state_after(arranged_lines)
            if waiting_line.restores_version:
                restored_number = waiting_line.number
        return replace(self, lines=tuple(arranged_lines), superseded=tuple(superseded)), lost_lines

    def _framed(
        self, line: WaitingLine, clock: Clock, tempo_map: TempoMap, soonest_frame: int
    ) -> WaitingLine:
        """A line with the frame of its beat; if that is past, it takes over as soon as it can."""
        if line.sets_running is not None or (line.is_now and line.start_frame is not None):
            return line
        start_frame: int | None
        if not clock.is_running:
            is_waiting = line.beat > clock.stopped_beat + SAME
            start_frame = (
                None
                if is_waiting
                else soonest_frame
                if line.start_frame is None
                else line.start_frame
            )
        else:
            start_frame = self.timing.takeover_frame(
                clock, tempo_map, line.beat, line.lead(self.timing)
            )
            if (
                line.start_frame is not None
                and abs(start_frame - line.start_frame) <= self.timing.tick_frames
            ):
                return line
            start_frame = max(soonest_frame, start_frame)
        return line if start_frame == line.start_frame else replace(line, start_frame=start_frame)

    def _follow(self, line: WaitingLine, version: Version, clock: Clock) -> WaitingLine:
        """A line after another version. Raises one of `REFUSALS`."""
        base_version = line.version_before
        if base_version is version and line.version is not None:
            new_version = line.version
        elif _differ_by_faders(line, version):
            new_version = replace(line.result(), faders=version.faders)
        else:
            new_version = version_after_line(version, line)
            is_parsed = line.line and not (line.resets or line.reads_files)
            if (
                base_version is not None
                and is_parsed
                and not names_of(base_version) <= names_of(version)
            ):
                reparse(line.line, version)
        new_clock = takeover_beats_of(clock, version, new_version, line, self.timing).clock
        if base_version is version and line.clock == new_clock and line.version is new_version:
            return line
        return replace(line, version_before=version, version=new_version, clock=new_clock)


def _has_priority(earlier: WaitingLine, new_line: WaitingLine) -> bool:
    """Whether an earlier line goes first, though a new one that follows it could act sooner. What
    restores a version replaces an earlier one that does.
    """
    asks_for_less = new_line.is_named or earlier.is_named or new_line.is_now > earlier.is_now
    would_be_wiped = earlier.restores_version and not new_line.restores_version
    return bool(earlier.n_slips or would_be_wiped or not asks_for_less)


def _slipped_line(line: WaitingLine, slip_beat: float, start_frame: int) -> WaitingLine:
    """A line that acts on a later beat, and is edited again for it."""
    moved_line = line.moved_to(slip_beat, start_frame)
    return replace(moved_line, version=None, clock=None, n_slips=line.n_slips + 1)


def _effect_key(waiting_line: WaitingLine) -> tuple[float, float]:
    """The order of effect, as in `WaitingLine.is_before`."""
    return (
        (math.inf, waiting_line.beat)
        if waiting_line.start_frame is None
        else (waiting_line.start_frame, waiting_line.number)
    )


def takeover_beats_of(
    clock: Clock,
    old_version: Version,
    new_version: Version,
    waiting_line: WaitingLine,
    timing: Timing,
) -> TakeoverBeats:
    """Where a line leaves the piece of the version before, and where that of its own goes on."""
    if waiting_line.start_frame is None:
        return TakeoverBeats(clock, waiting_line.beat, waiting_line.beat)
    tempos = old_version.piece.tempo_map, new_version.piece.tempo_map
    return takeover_beats(
        clock,
        *tempos,
        waiting_line.beat,
        waiting_line.start_frame,
        waiting_line.sets_running,
        new_version.takeover_beat,
        timing,
    )


def version_after_line(version_before: Version, line: WaitingLine) -> Version:
    """The version after a line. Raises one of `REFUSALS`."""
    is_running = version_before.is_running if line.sets_running is None else line.sets_running
    return line.edit(replace(version_before.taken_over(), is_running=is_running), line.beat)


def _differ_by_faders(waiting_line: WaitingLine, version: Version) -> bool:
    """Whether a version differs from the one before a line by faders alone, which the line does
    not set.
    """
    base_version, line_version = waiting_line.version_before, waiting_line.version
    if (
        base_version is None
        or line_version is None
        or waiting_line.restores_version
        or line_version.faders is not base_version.faders
    ):
        return False
    return is_same_music(base_version.taken_over(), version.taken_over())


def names_of(version: Version) -> frozenset[str]:
    """The names of a version that lines may use."""
    piece = version.piece
    other_names = (
        [strikes.name for strikes in piece.strikes],
        [mark.name for mark in piece.marks],
        [room.name for room in piece.mix.rooms],
    )
    part_names = chain(piece.players, piece.keys, piece.instruments, piece.families)
    return frozenset(
        chain(part_names, piece.gestures, piece.takes, piece.phrases, piece.blocks, *other_names)
    )


def reparse(line_text: str, version: Version) -> Sequence[Command]:
    """The commands of a line, read again with the names of the version before it.

    A render of the journal reads it in the same way. Raises NotTakenError, for instance if a
    name no longer exists.
    """
    try:
        return parse(line_text, scope_of(version.piece))
    except Refusal as refusal:
        raise NotTakenError(refusal.message) from None
