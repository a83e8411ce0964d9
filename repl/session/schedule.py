"""The schedule of a session: what plays, what is under way to the engine, and what waits.

It is the session's state machine; `line_kinds` has the table of what each kind of line does. The
waiting lines never change; they are replaced as a whole, so that a line can be made from them in
any thread (`drafting`) and is taken over if nothing has come between. Nothing here stages a
version while the lock is held, except a cut. `moments` says when lines can act.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon._core import FORCE_FALL_TIME, StoppedError
from ergon.notation.clock.positions import Length
from ergon.repl.language.commands import When
from ergon.repl.session.changes import Changes, Withdrawal
from ergon.repl.session.clock import Timing
from ergon.repl.session.drafting import Draft, Drafts, Request
from ergon.repl.session.engine import Change
from ergon.repl.session.extensions import Extensions
from ergon.repl.session.gains import can_move_faders, changed_ratios
from ergon.repl.session.groups import StagedGroup, group_of, staged_group_of
from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.making_time import MakingTime
from ergon.repl.session.makings import VersionMaker
from ergon.repl.session.moments import Moments
from ergon.repl.session.past_versions import PastVersionStore
from ergon.repl.session.places import LinePlace
from ergon.repl.session.reports import (
    LineDropped,
    LineMoved,
    LinesDone,
    LinesSlipped,
    LineSuperseded,
    Report,
)
from ergon.repl.session.running import RunningVersion
from ergon.repl.session.takeover import Takeovers
from ergon.repl.session.version import NotTakenError, PastVersion, Version
from ergon.repl.session.waiting_lines import REFUSALS, WaitingLine, WaitingLines

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine, EngineEvent
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import RealHands
    from ergon.scores.staging.planning import TrialStore

# A change is handed to the engine this long before the last moment at which it is in time [s].
_AHEAD_SECONDS = 0.3
# A line that ends what plays passes one that is not made yet this long before it would be late [s].
_PASS_SECONDS = 0.05
# Lines among the last ones to take effect may still change places: those of a few changes.
_UNSETTLED_MAX = 256


class Schedule:
    """What plays and what waits. `lock` guards it; it is held for some milliseconds at most."""

    def __init__(
        self,
        engine: Engine,
        running: RunningVersion,
        real_hands: RealHands,
        margin: int,
        trial_store: TrialStore | None = None,
    ) -> None:
        """Begin with a version that plays; a change reaches the engine within `margin` frames.

        With real hands that includes the time in which their forces fall to the limit of a
        stiffer scene. `trial_store` keeps results of trials.
        """
        rate = running.stage.rate
        self.engine, self.real_hands = engine, real_hands
        margin += int(FORCE_FALL_TIME * rate) if real_hands and margin else 0
        self.timing = timing = Timing(rate, engine.tick_frames)
        self.version_maker = VersionMaker(engine, Takeovers(timing, real_hands, trial_store))
        self.changes = engine_changes = Changes(engine, running)
        self.lines = WaitingLines(running.version, running.clock, timing)
        self.lock = threading.RLock()
        self.making_time = MakingTime(engine, rate)
        self.moments = Moments(engine, engine_changes, timing, self.making_time, margin)
        self._drafts = Drafts(
            self.moments, engine_changes, timing, self.version_maker, self.making_time
        )
        self.reports: deque[Report] = deque()
        self._extensions = Extensions(
            engine, engine_changes, self.moments, self.version_maker, self.reports
        )
        # The version that each line makes or made, by its number.
        self.past_versions = PastVersionStore()
        self.n_drops = 0  # how often all lines were dropped
        self._staged_group: StagedGroup | None = None

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.timing.rate

    @property
    def running(self) -> RunningVersion:
        """The version that was handed to the engine last."""
        return self.changes.running

    @property
    def head(self) -> Version:
        """The version after all waiting lines."""
        return self.lines.head

    @property
    def waiting(self) -> tuple[WaitingLine, ...]:
        """The lines that wait, in the order of effect."""
        return self.lines.lines

    def line(self, number: int) -> WaitingLine | None:
        """A line that waits or is under way, by its number."""
        with self.lock:
            sent_lines = (line for change in self.changes.pending for line in change.lines)
            return next(
                (
                    waiting_line
                    for waiting_line in (*self.waiting, *sent_lines)
                    if waiting_line.number == number
                ),
                None,
            )

    # --- when ------------------------------------------------------------------------------------

    def soonest_frame(self, kind: LineKind = LineKind.STRUCTURE) -> int:
        """The first frame at which a new line of a kind can take effect: a multiple of the tick."""
        return self.moments.soonest_frame(kind)

    def beat_now(self) -> float:
        """The beat of the piece that the engine computes now."""
        return self.moments.beat_now()

    def place(self, when: When, grid: Length | None) -> LinePlace:
        """The place of a line that is typed now. Raises NotTakenError where its beat is past."""
        return self.moments.place(self.head.piece.tempo_map, when, grid)

    def frame_of(self, beat: float) -> int:
        """The first frame of the tick of a beat; the soonest frame while the piece is stopped."""
        return self.moments.frame_of(self.head.piece.tempo_map, beat)

    # --- taking a line ---------------------------------------------------------------------------

    def insert(self, request: Request, note_draft: Callable[[Draft], None]) -> Draft:
        """Let a line wait. Raises one of `REFUSALS`, and nothing has changed.

        It is made without the lock; if the lines change meanwhile, it is drafted again, and its
        making is left to `make_due`. `note_draft` is called with the draft that is taken.
        """
        with self.lock:
            self._check_not_dropped(request)
            frame = self._drafts.joined_frame(request, self.lines)
            if frame is not None:
                self._wait_again(self.changes.withdraw(frame))
            sketch = self._drafts.sketch(request, self.lines)
        draft = self._drafts.draft(sketch)
        with self.lock:
            if self.lines is not draft.base_lines:
                self._check_not_dropped(request)
                sketch = self._drafts.sketch(request, self.lines, draft.requested)
                checked_draft = self._drafts.draft(sketch)
                checked_version = replace(
                    draft.checked_version, version=checked_draft.drafted_line.result()
                )
                draft = replace(checked_draft, checked_version=checked_version)
            self._set_lines(draft.lines)
            if draft.staged_group is not None:
                self._staged_group = draft.staged_group
            note_draft(draft)
        return draft

    def _check_not_dropped(self, request: Request) -> None:
        if request.n_drops != self.n_drops:
            raise NotTakenError("a panic has dropped this line; nothing has changed")

    def drop(self, number: int) -> None:
        """Remove a waiting line. Raises NotTakenError if one after it needs it."""
        with self.lock:
            self._set_lines(self.lines.without(number, self.soonest_frame()))

    def drop_all(self) -> list[WaitingLine]:
        """Remove all waiting lines and return them, also those that are under way to the engine."""
        with self.lock:
            self._wait_again(self.changes.withdraw(self.moments.first_frame(0.0, LineKind.STOPS)))
            dropped_lines = [*self.waiting]
            self.n_drops += 1
            self._set_lines(replace(self.lines, lines=(), superseded=()))
            return dropped_lines

    def _set_lines(
        self, lines: WaitingLines, lines_before: Sequence[WaitingLine] | None = None
    ) -> None:
        """Replace the waiting lines; report which of them have moved, and which are left out.

        Lines that were under way are among `lines_before`.
        """
        start_by_number = {
            line.number: line.start_frame
            for line in (self.waiting if lines_before is None else lines_before)
        }
        for waiting_line in lines.lines:
            place_text = waiting_line.result().piece.tempo_map.written(waiting_line.beat)
            self.past_versions[waiting_line.number] = PastVersion.from_version(
                waiting_line.result(), place_text
            )
            if (
                start_by_number.get(waiting_line.number, waiting_line.start_frame)
                != waiting_line.start_frame
            ):
                self.reports.append(LineMoved(waiting_line))
        self.reports.extend(LineSuperseded(line) for line in lines.superseded)
        self.lines = lines

    def _let_wait(self, lines: Sequence[WaitingLine]) -> None:
        """Let lines wait after the running version; drop those that can no longer be made."""
        self._set_lines(self._arranged(lines, self.soonest_frame()), lines)

    def _arranged(self, lines: Sequence[WaitingLine], soonest_frame: int) -> WaitingLines:
        """Lines after the running version, not before a frame; those that cannot be are dropped."""
        waiting_lines = WaitingLines(self.running.version, self.running.clock, self.timing)
        arranged_lines, lost_lines = waiting_lines.followed_by(lines, soonest_frame)
        self.reports.extend(
            LineDropped(lost_line.line, lost_line.reason) for lost_line in lost_lines
        )
        return arranged_lines

    def _wait_again(self, withdrawal: Withdrawal) -> None:
        """Let lines that were under way wait again, before the others."""
        if withdrawal.running_before.version is not self.lines.base_version or withdrawal.lines:
            self._let_wait([*withdrawal.lines, *self.waiting])
        self.past_versions.update(self.changes.past_versions(self.past_versions))

    def _drop_failed(self, failed_lines: Sequence[WaitingLine], reason: str) -> None:
        """Drop waiting lines."""
        self.reports.extend(LineDropped(waiting_line, reason) for waiting_line in failed_lines)
        failed_numbers = {waiting_line.number for waiting_line in failed_lines}
        self._let_wait(
            [
                waiting_line
                for waiting_line in self.waiting
                if waiting_line.number not in failed_numbers
            ]
        )

    # --- handing over ----------------------------------------------------------------------------

    def hand_over(self) -> None:
        """Hand to the engine what is due and made; what is late waits for a later frame.

        It makes no version, but for the cuts of lines that end what plays.
        """
        with self.lock:
            is_slipping = False
            while due_group := self._first_due_group():
                group_kind = due_group[0].kind
                try:
                    if due_group[0].frame < self.moments.first_frame(0.0, group_kind):
                        self._slip_lines(due_group)
                        if is_slipping:  # the engine is faster than this loop: the next turn
                            return
                        is_slipping = True
                    elif group_kind is LineKind.FADERS:
                        self._move_faders(due_group)
                    elif group_kind is LineKind.STOPS:
                        self._cut_running(due_group)
                    else:
                        self._hand_staged(due_group)
                except REFUSALS as error:
                    self._drop_failed(due_group, str(error))

    def _first_due_group(self) -> tuple[WaitingLine, ...]:
        """The next lines that can be handed over, or are late; empty if there are none."""
        moments, lines_left = self.moments, self.waiting
        until_frame, soon_frame = (
            moments.frame_after(_AHEAD_SECONDS),
            moments.frame_after(_PASS_SECONDS),
        )
        while lines_left and lines_left[0].frame <= until_frame:
            due_group = group_of(lines_left)
            due_kind, group_start = due_group[0].kind, due_group[0].frame
            is_first = len(lines_left) == len(self.waiting)
            if due_kind is LineKind.FADERS:
                is_due = is_first or can_move_faders(self.running, due_group)
            elif due_kind is LineKind.STOPS:
                # A beat counts from the beginning of the piece, which then comes first.
                has_start = any(line.sets_running for line in self.waiting[: -len(lines_left)])
                can_pass = not has_start or any(line.is_now for line in due_group)
                is_due = is_first or (group_start <= soon_frame and can_pass)
            else:
                is_late = group_start < moments.first_frame(0.0)
                is_due = is_first and (is_late or self._is_staged(due_group))
            if is_due:
                return due_group
            lines_left = lines_left[len(due_group) :]
        return ()

    def _is_staged(self, group: Sequence[WaitingLine]) -> bool:
        return self._staged_group is not None and self._staged_group.matches(group, self.running)

    def _slip_lines(self, late_group: Sequence[WaitingLine]) -> None:
        """Let late lines, and those typed after them, wait for the next bar, or for the soonest
        frame.
        """
        slip_beat, slip_frame = self.moments.place_after_slip(late_group)
        slipped_lines, lost_lines, moved_lines = self.lines.slipped(
            late_group, slip_beat, slip_frame
        )
        self.reports.append(LinesSlipped(moved_lines))
        self.reports.extend(
            LineDropped(lost_line.line, lost_line.reason) for lost_line in lost_lines
        )
        self._set_lines(slipped_lines)

    def _move_faders(self, fader_group: Sequence[WaitingLine]) -> None:
        """Hand over gains, which need no version and no order."""
        start_frame = fader_group[0].start_frame
        assert start_frame is not None
        self.changes.send_gains(start_frame, fader_group)
        self.past_versions.update(self.changes.past_versions(self.past_versions))
        self._let_wait(
            [waiting_line for waiting_line in self.waiting if waiting_line not in fader_group]
        )

    def _cut_running(self, group: Sequence[WaitingLine]) -> None:
        """End what plays: a cut of the running stage, before all that waits."""
        end_frame = group[0].start_frame
        assert end_frame is not None
        withdrawal = self.changes.withdraw(end_frame)
        waiting_lines = [*withdrawal.lines, *(line for line in self.waiting if line not in group)]
        # One of the same frame that was under way ends together with these.
        other_endings = [
            line
            for line in waiting_lines
            if line.kind is LineKind.STOPS and line.start_frame == end_frame
        ]
        lines_left = [line for line in waiting_lines if line not in other_endings]
        group = sorted((*other_endings, *group), key=lambda line: line.number)
        stop_numbers = [
            waiting_line.number for waiting_line in group if waiting_line.sets_running is False
        ]
        if stop_numbers:
            lines_left = self._without_starts(lines_left, max(stop_numbers))
        ending_lines = self._arranged(group, end_frame).lines
        started_endings = [line for line in ending_lines if line.start_frame is not None]
        # Without what was taken back, the piece may stand, and has not reached the beat of some.
        lines_left += [line for line in ending_lines if line.start_frame is None]
        try:
            if started_endings:
                self._hand_lines(
                    started_endings, self.version_maker.cut_version(self.running, started_endings)
                )
        except REFUSALS as error:
            self.reports.extend(LineDropped(line, str(error)) for line in started_endings)
        self._let_wait(lines_left)

    def _without_starts(
        self, waiting_lines: Sequence[WaitingLine], stop_line_number: int
    ) -> list[WaitingLine]:
        """Lines that wait after a stop: those that start the piece and were typed before the line
        `stop_line_number` are dropped.
        """
        start_lines = [
            waiting_line
            for waiting_line in waiting_lines
            if waiting_line.sets_running and waiting_line.number < stop_line_number
        ]
        reason = "the piece was stopped before it began"
        self.reports.extend(LineDropped(waiting_line, reason) for waiting_line in start_lines)
        return [waiting_line for waiting_line in waiting_lines if waiting_line not in start_lines]

    def _hand_staged(self, group: Sequence[WaitingLine]) -> None:
        staged_group = self._staged_group
        assert staged_group is not None
        self._staged_group = None
        self._hand_lines(group, staged_group.running_after)
        self._let_wait(self.waiting[len(group) :])

    def _hand_lines(
        self, line_group: Sequence[WaitingLine], running_result: RunningVersion
    ) -> None:
        """Hand over lines, whose result was made. Raises EngineError."""
        old_running = self.running
        running_after = replace(
            running_result, version=line_group[-1].result(), serial=old_running.serial + 1
        )
        change = Change(
            running_after.start_frame,
            running_after.stage,
            old_running.stage,
            any(waiting_line.resets for waiting_line in line_group),
            gains=changed_ratios(old_running, running_after),
            damping_t60=running_after.damping_t60,
            force_bounds=running_after.force_bounds,
        )
        self.changes.send(change, line_group, running_after)
        self.past_versions.update(self.changes.past_versions(self.past_versions))

    def note_event(self, engine_event: EngineEvent) -> None:
        """Note that a change took effect, or came too late."""
        with self.lock:
            if engine_event.is_late:
                soonest_frame = self.moments.first_frame(0.0, LineKind.FADERS)
                self._wait_again(self.changes.note_late(engine_event.ticket or 0, soonest_frame))
                return
            running, finished_change = self.running, self.changes.note_done(engine_event)
            if finished_change is None:
                return
            self.reports.append(
                LinesDone(
                    engine_event.frame,
                    finished_change.number,
                    finished_change.lines,
                    finished_change.running_after,
                )
            )
            if self.running is not running:  # the withdrawal came too late
                finished_numbers = {line.number for line in finished_change.lines}
                self._let_wait(
                    [
                        waiting_line
                        for waiting_line in self.waiting
                        if waiting_line.number not in finished_numbers
                    ]
                )

    # --- making ----------------------------------------------------------------------------------

    def make_due(self) -> bool:
        """Make the version of the next lines if it will be needed soon; False if none is.

        Any thread may call it; the lock is free while the version is made.
        """
        with self.lock:
            running, unmade_group = self.running, self._first_unmade_group()
        if not unmade_group:
            return False
        making_begin_frame = self.making_time.begin_frame()
        try:
            staged_group = StagedGroup(
                unmade_group, running, self.version_maker.staged(running, unmade_group)
            )
        except StoppedError:  # the session is closed
            raise
        except REFUSALS:
            failed_line, reason = self.version_maker.first_failing(running, unmade_group)
            with self.lock:
                if unmade_group == staged_group_of(self.waiting):
                    self._drop_failed([failed_line], reason)
            return True
        finally:
            self.making_time.add(making_begin_frame)
        with self.lock:
            self._staged_group = staged_group
        return True

    def _first_unmade_group(self) -> tuple[WaitingLine, ...]:
        until_frame = self.moments.frame_after(_AHEAD_SECONDS + self.making_time.expected_seconds)
        unmade_group = staged_group_of(self.waiting)
        if not unmade_group or unmade_group[0].frame > until_frame:
            return ()
        is_late = unmade_group[0].frame < self.moments.first_frame(0.0)
        return () if is_late or self._is_staged(unmade_group) else unmade_group

    def extend(self) -> bool:
        """Extend the timeline if half of it is over; False if that is not needed.

        Any thread may call it; the lock is free while the extension is made.
        """
        with self.lock:
            running, extension_frame = self.running, self._extension_frame()
        if extension_frame is None:
            return False
        try:
            extended_running = self._extensions.extended(running, extension_frame)
        except StoppedError:
            raise
        except REFUSALS as error:  # a value that automation reaches later, under a real hand
            with self.lock:
                if running is self.running:
                    self._extensions.stop_extending(error)
            return True
        with self.lock:
            if running is self.running and extension_frame >= self.moments.first_frame(0.0):
                self._extensions.send(extended_running)
        return True

    def _extension_frame(self) -> int | None:
        return self._extensions.due_frame(self.waiting)

    # --- past ------------------------------------------------------------------------------------

    def effect_order(self) -> dict[int, float]:
        """The place of the last lines in the order in which they take effect, by number."""
        last_numbers = self.changes.done_numbers[-_UNSETTLED_MAX:]
        numbers = [*last_numbers, *(waiting_line.number for waiting_line in self.waiting)]
        return {number: float(order_index) for order_index, number in enumerate(numbers)}

    def rebase(self, base_texts: Texts) -> None:
        """Note that the files hold these texts now."""
        with self.lock:
            self.past_versions.rebase(base_texts)
            version = replace(self.running.version, file_texts=base_texts, renames=())
            self.changes.running = replace(self.running, version=version)
            self._let_wait(self.waiting)
