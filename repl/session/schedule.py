"""The schedule of a session: what plays, what is under way to the engine, and what waits.

It is the session's state machine; `line_kinds` has the table of what each kind of line does. The
waiting lines never change; they are replaced as a whole, so that a line can be made from them in
any thread (`draft`) and is taken over if nothing has come between. Nothing here stages a version
while the lock is held, except a cut.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon._core import FORCE_FALL_TIME, EngineError, StoppedError
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.repl.language.commands import NOW, When
from ergon.repl.session.changes import Changes, Returned
from ergon.repl.session.clock import Timing, next_boundary
from ergon.repl.session.engine import Change
from ergon.repl.session.gains import can_move, changed_ratios, faders_after
from ergon.repl.session.groups import StagedGroup, group_of, staged_group_of
from ergon.repl.session.line_kinds import RULES, LineKind
from ergon.repl.session.making_time import MakingTime
from ergon.repl.session.past_versions import PastVersionStore
from ergon.repl.session.places import BAR, Place, Present, frame_of, place_of
from ergon.repl.session.reports import Done, Dropped, Moved, Report, Slipped, Superseded, Unable
from ergon.repl.session.running import RunningVersion, horizon
from ergon.repl.session.takeover import Takeovers
from ergon.repl.session.unheard import check_unheard
from ergon.repl.session.version import NotTakenError, PastVersion, Version
from ergon.repl.session.waiting_lines import REFUSALS, WaitingLine, WaitingLines

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine, EngineEvent
    from ergon.repl.session.entry import Entry
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import Real

# A change is handed to the engine this long before the last moment at which it is in time [s].
_AHEAD = 0.3
# A line that ends what plays passes one that is not made yet this long before it would be late [s].
_PASSES = 0.05
# A line that acts now gets twice the time that the last makings took.
_MAKING_FACTOR = 2.0
# Lines among the last ones to take effect may still change places: those of a few changes.
_UNSETTLED = 256
# Shortest and longest time by which a line is put off because it was late [s].
_SLIP_MIN, _SLIP_MAX = 0.005, 30.0


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
class Draft:
    """A line as it was `asked` for, and as it stands among the waiting `lines`, made from the
    `base_lines`; `checked` is its version.
    """

    base_lines: WaitingLines
    lines: WaitingLines
    asked: WaitingLine
    line: WaitingLine
    checked: RunningVersion
    staged: StagedGroup | None = None


class Schedule:
    """What plays and what waits. `lock` guards it; it is held for some milliseconds at most."""

    def __init__(self, engine: Engine, running: RunningVersion, real: Real, margin: int) -> None:
        """Begin with a version that plays; a change reaches the engine within `margin` frames.

        With real hands that includes the time in which their forces fall to the limit of a
        stiffer scene.
        """
        rate = running.stage.rate
        self.engine = engine
        self.real = real
        self.margin = margin + (int(FORCE_FALL_TIME * rate) if real and margin else 0)
        self.timing = Timing(rate, engine.tick_frames)
        self.takeovers = Takeovers(self.timing, real)
        self.changes = Changes(engine, running)
        self.lines = WaitingLines(running.version, running.clock, self.timing)
        self.lock = threading.RLock()
        self.making_time = MakingTime(engine, rate)
        self.extension_time = MakingTime(engine, rate)
        self.reports: deque[Report] = deque()
        # The version that each line makes or made, by its number.
        self.past_versions = PastVersionStore()
        self.latest = math.inf  # the beat on which nothing begins any more
        self.n_drops = 0  # how often all lines were dropped
        self._staged: StagedGroup | None = None

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
            sent = (line for one in self.changes.under_way for line in one.lines)
            return next((one for one in (*self.waiting, *sent) if one.number == number), None)

    # --- when ------------------------------------------------------------------------------------

    def soonest_frame(self, kind: LineKind = LineKind.STRUCTURE) -> int:
        """The first frame at which a new line of a kind can take effect: a multiple of the tick."""
        seconds = 0.0 if RULES[kind].is_quick else self.making_time.seconds
        return self.first_frame(_MAKING_FACTOR * seconds, kind)

    def first_frame(self, making: float, kind: LineKind = LineKind.STRUCTURE) -> int:
        """The first frame for a change that takes `making` [s] to compute."""
        tick, changes = self.timing.tick_frames, self.changes
        request = -(-(self.engine.frame + self.margin) // tick) * tick
        if kind is LineKind.FADERS:
            after = 0
        elif kind is LineKind.ENDS:  # it withdraws what can still be withdrawn
            after = changes.playing_at(request - 1).start + 1
        else:
            after = changes.running.start + 1
        ahead = self.engine.frame + self.margin + int(making * self.rate)
        return -(-max(ahead, after) // tick) * tick

    def beat_now(self) -> float:
        """The beat of the piece that the engine computes now."""
        return self.running.beat(self.engine.frame)

    def place(self, when: When, grid: Length | None, kind: LineKind = LineKind.STRUCTURE) -> Place:
        """The place of a line that is typed now. Raises NotTakenError where its beat is past."""
        lead = self.timing.lead_of(kind is LineKind.ENDS)
        frames = self.first_frame(0.0, kind), self.soonest_frame(kind)
        beat, start = place_of(when, grid, self._present(), frames, lead)
        is_now = when is NOW or (when is None and grid is None)
        if kind is LineKind.FADERS and is_now and start is not None:
            start = frames[1]  # they need not wait for the beginning of the piece
        return Place(beat, start)

    def frame_of(self, beat: float) -> int:
        """The first frame of the tick of a beat; the soonest frame where the piece stands."""
        return frame_of(beat, self._present(), self.soonest_frame())

    def _present(self) -> Present:
        tempo = self.head.piece.tempo_map
        return Present(self.running.clock, tempo, self.beat_now(), self.timing)

    def version_at(self, beat: float) -> Version:
        """The version at a coming beat: with all waiting lines that take effect by then."""
        version = self.running.version
        for one in self.waiting:
            if one.beat <= beat + SAME:
                version = one.result()
        return version

    # --- taking a line ---------------------------------------------------------------------------

    def insert(self, request: Request, note: Callable[[Draft], None]) -> Draft:
        """Let a line wait. Raises one of `REFUSALS`, and nothing has changed.

        It is made without the lock; if the lines change meanwhile, it is drafted again, and its
        making is left to `make_due`. `note` is called with the draft that is taken.
        """
        draft = self._draft(request)
        with self.lock:
            if self.lines is not draft.base_lines:
                again = self._draft(request, draft.asked)
                checked = replace(draft.checked, version=again.line.result())
                draft = replace(again, checked=checked)
            self._set_lines(draft.lines)
            if draft.staged is not None:
                self._staged = draft.staged
            note(draft)
        return draft

    def _draft(self, request: Request, asked: WaitingLine | None = None) -> Draft:
        """A line among those that wait, and what must be made to check it; nothing has changed.

        A line that was `asked` for before keeps its place, and was checked then.
        """
        with self.lock:
            if request.n_drops != self.n_drops:
                raise NotTakenError("a panic has dropped this line; nothing has changed")
            if asked is None:
                self._let_join(request)
            lines, running = self.lines, self.running
            first = self._behind_changes(self._behind_fence(asked or self._asked(request)))
            soonest = self.soonest_frame()
        lines_after, line = lines.inserted(first, soonest)
        checked, made = replace(running, version=line.result()), None
        if asked is None and not line.rule.is_quick:
            began = self.making_time.began()
            group = staged_group_of(lines_after.lines)
            if line in group:
                result = self._stage_lines(running, group)
                made = StagedGroup(group, running, result)
            else:  # it waits for others, so that it is only checked
                start = soonest if line.start is None else line.start
                result = self._stage_lines(running, [replace(line, start=start)])
            if line.base is not None and not (line.reads_files or line.sets_all):
                check_unheard(line.base.sounding, result.stage)
            checked = replace(result, version=line.result())
            self.making_time.add(began)
        return Draft(lines, lines_after, first, line, checked, made)

    def _asked(self, request: Request) -> WaitingLine:
        """The line of a request."""
        entry = request.entry
        beat, start = self.place(entry.when, request.grid, entry.kind)
        if start is None:
            start = self._start_after_play(beat, self.timing.lead_of(entry.kind is LineKind.ENDS))
        is_now = entry.when is NOW or (entry.when is None and request.grid is None)
        return WaitingLine(
            request.number,
            entry.line,
            entry.numbered_edit(request.number),
            entry.kind,
            beat if entry.enter is None else entry.enter,
            start,
            entry.sets_running,
            entry.resets,
            is_now or entry.sets_running is not None,
            entry.reads_files,
            entry.sets_all,
            isinstance(entry.when, Position | Length),
        )

    def _behind_fence(self, one: WaitingLine) -> WaitingLine:
        """A line that does not overtake an earlier one; it may move to that one's beat."""
        fence = self.lines.fence(one)
        if fence is None:
            return one
        return replace(one.moved_to(fence.beat, fence.start), is_now=fence.is_now)

    def _let_join(self, request: Request) -> None:
        """Take back the lines that are under way to the beat of a line, if there is time to make
        all of them: lines of one beat take effect together.
        """
        entry, timing = request.entry, self.timing
        staged = [change for change in self.changes.under_way if not change.is_gains]
        if not staged or RULES[entry.kind].is_quick or entry.sets_running is not None:
            return
        last, tick = staged[-1], timing.tick_frames
        seconds = _MAKING_FACTOR * self.making_time.seconds + _PASSES
        ready = -(-(self.engine.frame + self.margin + int(seconds * self.rate)) // tick) * tick
        clock = self.running.clock
        if not last.lines or not clock.is_running or last.frame < ready:
            return
        if any(line.sets_running is not None or line.resets for line in last.lines):
            return
        with contextlib.suppress(NotTakenError):
            frames, lead = (ready, ready), timing.lead_of(False)
            beat, _ = place_of(entry.when, request.grid, self._present(), frames, lead)
            if abs(beat - last.lines[-1].beat) <= SAME:
                self._wait_again(self.changes.withdraw(last.frame))

    def _behind_changes(self, line: WaitingLine) -> WaitingLine:
        """A line that moves faders, not before the change under way that makes what it names; one
        that restores a version, not before any.
        """
        if line.start is None:
            return line
        sent, start = [change for change in self.changes.under_way if change.lines], line.start
        if line.sets_all:
            start = max([start, *(change.frame for change in sent)])
        elif line.kind is LineKind.FADERS:
            start = self.changes.ready_frame(start, (line,))
        if start == line.start:
            return line
        beat = next(
            (waits.beat for change in sent for waits in change.lines if change.frame == start),
            line.beat,
        )
        return line.moved_to(beat, start)

    def _start_after_play(self, beat: float, lead: float) -> int | None:
        """The frame of a beat that is ahead, if the piece is about to start."""
        begins = next((one for one in self.waiting if one.sets_running), None)
        if begins is None or begins.clock is None or begins.start is None:
            return None
        tempo = self.head.piece.tempo_map
        return max(begins.start, self.timing.takeover_frame(begins.clock, tempo, beat, lead))

    def _stage_lines(self, on: RunningVersion, lines: Sequence[WaitingLine]) -> RunningVersion:
        """The running version after lines, checked. Raises one of `REFUSALS`."""
        return self._checked(on, self.takeovers.stage(on, lines, self.latest))

    def _checked(self, on: RunningVersion, made: RunningVersion) -> RunningVersion:
        """A version with the bounds of its forces. Raises NotTakenError if it cannot be played."""
        for unit, plays, asked in (
            ("number of channels", self.engine.n_channels, made.stage.n_channels),
            ("rate", self.rate, made.stage.rate),
        ):
            if plays != asked:
                raise NotTakenError(
                    f"the {unit} of a session cannot change: this session plays {plays:g}, and "
                    f"the score has {asked:g}; play that score in a session of its own"
                )
        # Every version passes here, so none plays that a real hand's key cannot bear.
        bounds = self.engine.force_bounds(made.stage, made.start, made.glides, on.force_bounds)
        return replace(made, force_bounds=bounds)

    def drop(self, number: int) -> None:
        """Remove a waiting line. Raises NotTakenError if one after it needs it."""
        with self.lock:
            self._set_lines(self.lines.without(number, self.soonest_frame()))

    def drop_all(self) -> list[WaitingLine]:
        """Remove all waiting lines and return them, also those that are under way to the engine."""
        with self.lock:
            self._wait_again(self.changes.withdraw(self.first_frame(0.0, LineKind.ENDS)))
            waited = [*self.waiting]
            self.n_drops += 1
            self._set_lines(replace(self.lines, lines=(), superseded=()))
            return waited

    def _set_lines(self, lines: WaitingLines, before: Sequence[WaitingLine] | None = None) -> None:
        """Replace the waiting lines; report which of them have moved, and which are left out.

        Lines that were under way are among those `before`.
        """
        starts = {one.number: one.start for one in (self.waiting if before is None else before)}
        for one in lines.lines:
            where = one.result().piece.tempo_map.written(one.beat)
            self.past_versions[one.number] = PastVersion.from_version(one.result(), where)
            if starts.get(one.number, one.start) != one.start:
                self.reports.append(Moved(one))
        self.reports.extend(Superseded(one) for one in lines.superseded)
        self.lines = lines

    def _let_wait(self, lines: Sequence[WaitingLine]) -> None:
        """Let lines wait after the running version; drop those that can no longer be made."""
        running = self.running
        begun = WaitingLines(running.version, running.clock, self.timing)
        arranged, lost = begun.followed_by(lines, self.soonest_frame())
        self.reports.extend(Dropped(one.line, one.why) for one in lost)
        self._set_lines(arranged, lines)

    def _wait_again(self, returned: Returned) -> None:
        """Let lines that were under way wait again, before the others."""
        if returned.before.version is not self.lines.base or returned.lines:
            self._let_wait([*returned.lines, *self.waiting])
        self._note_under_way()

    def _fail(self, failed: Sequence[WaitingLine], why: str) -> None:
        """Drop waiting lines."""
        self.reports.extend(Dropped(one, why) for one in failed)
        numbers = {one.number for one in failed}
        self._let_wait([one for one in self.waiting if one.number not in numbers])

    # --- handing over ----------------------------------------------------------------------------

    def hand_over(self) -> None:
        """Hand to the engine what is due and made; what is late waits for a later frame.

        It makes no version, but for the cuts of lines that end what plays.
        """
        with self.lock:
            is_slipping = False
            while group := self._first_due():
                kind = group[0].kind
                try:
                    if group[0].frame < self.first_frame(0.0, kind):
                        self._slip(group)
                        if is_slipping:  # the engine is faster than this loop: the next turn
                            return
                        is_slipping = True
                    elif kind is LineKind.FADERS:
                        self._move_faders(group)
                    elif kind is LineKind.ENDS:
                        self._end(group)
                    else:
                        self._hand_staged(group)
                except REFUSALS as error:
                    self._fail(group, str(error))

    def _first_due(self) -> tuple[WaitingLine, ...]:
        """The next lines that can be handed over, or are late; empty if there are none."""
        request = self.engine.frame + self.margin
        until, soon = (request + int(s * self.rate) for s in (_AHEAD, _PASSES))
        rest = self.waiting
        while rest and rest[0].frame <= until:
            group = group_of(rest)
            kind, start = group[0].kind, group[0].frame
            is_first = len(rest) == len(self.waiting)
            if kind is LineKind.FADERS:
                is_due = is_first or can_move(self.running, group)
            elif kind is LineKind.ENDS:
                before = self.waiting[: len(self.waiting) - len(rest)]
                # A beat counts from the beginning of the piece, which then comes first.
                begins = any(one.sets_running for one in before)
                can_pass = not begins or any(one.is_now for one in group)
                is_due = is_first or (start <= soon and can_pass)
            else:
                is_due = is_first and (self._is_staged(group) or start < self.first_frame(0.0))
            if is_due:
                return group
            rest = rest[len(group) :]
        return ()

    def _is_staged(self, group: Sequence[WaitingLine]) -> bool:
        return self._staged is not None and self._staged.fits(group, self.running)

    def _slip(self, group: Sequence[WaitingLine]) -> None:
        """Let late lines, and those typed after them, wait for the next bar, or for the soonest
        frame.
        """
        first, slips = group[0], max(one.n_slips for one in group)
        seconds = 0.0
        if slips or not first.rule.is_quick:
            # Each line waits longer when it slips again, whatever was measured.
            seconds = max(self.making_time.seconds, _SLIP_MIN) * 2.0 ** min(slips, 20)
            seconds = min(_SLIP_MAX, seconds)
        start = self.first_frame(_MAKING_FACTOR * seconds, first.kind)
        clock, tempo = self.running.clock, self.running.version.piece.tempo_map
        lead = first.lead(self.timing)
        beat = clock.beat(tempo, start / self.rate + lead)
        if clock.is_running and not all(one.is_now for one in group):
            beat = next_boundary(tempo, beat, BAR)
            start = max(start, self.timing.takeover_frame(clock, tempo, beat, lead))
        lines, lost, moved = self.lines.slipped(group, beat, start)
        self.reports.append(Slipped(moved))
        self.reports.extend(Dropped(one.line, one.why) for one in lost)
        self._set_lines(lines)

    def _move_faders(self, group: Sequence[WaitingLine]) -> None:
        """Hand over gains, which need no version and no order."""
        start = group[0].start
        assert start is not None
        self.changes.send_gains(start, group)
        self._note_under_way()
        self._let_wait([one for one in self.waiting if one not in group])

    def _note_under_way(self) -> None:
        """Let the versions that `undo` restores be those of the order of effect: gains may act
        before lines that were typed earlier.
        """
        for change in self.changes.under_way:
            before = change.before.version
            for line, faders in zip(change.lines, faders_after(before, change.lines), strict=True):
                past = self.past_versions.get(line.number)
                if past is None:
                    continue
                after = past
                if change.is_gains:
                    after = PastVersion.from_version(before, past.where, past.line)
                after = replace(after, number=past.number, faders=faders)
                if after != past:
                    self.past_versions[line.number] = after

    def _end(self, group: Sequence[WaitingLine]) -> None:
        """End what plays: a cut of the running stage, before all that waits."""
        start = group[0].start
        assert start is not None
        returned = self.changes.withdraw(start)
        lines = [*returned.lines, *(line for line in self.waiting if line not in group)]
        # One of the same frame that was under way ends together with these.
        also = [line for line in lines if line.kind is LineKind.ENDS and line.start == start]
        rest = [line for line in lines if line not in also]
        group = sorted((*also, *group), key=lambda line: line.number)
        if any(one.sets_running is False for one in group):
            rest = self._without_start(rest)
        running = self.running
        begun = WaitingLines(running.version, running.clock, self.timing)
        ending, lost = begun.followed_by(group, start)
        self.reports.extend(Dropped(one.line, one.why) for one in lost)
        ends = [one for one in ending.lines if one.start is not None]
        # Without what was taken back, the piece may stand, and has not reached the beat of some.
        rest += [one for one in ending.lines if one.start is None]
        try:
            if ends:
                cut = self._checked(running, self.takeovers.cut(running, ends))
                self._hand(ends, cut)
        except REFUSALS as error:
            self.reports.extend(Dropped(one, str(error)) for one in ends)
        self._let_wait(rest)

    def _without_start(self, lines: Sequence[WaitingLine]) -> list[WaitingLine]:
        """Lines that wait after a stop: none of them starts the piece that was stopped."""
        started = [one for one in lines if one.sets_running]
        why = "the piece was stopped before it began"
        self.reports.extend(Dropped(one, why) for one in started)
        return [one for one in lines if not one.sets_running]

    def _hand_staged(self, group: Sequence[WaitingLine]) -> None:
        made = self._staged
        assert made is not None
        self._staged = None
        self._hand(group, made.result)
        self._let_wait(self.waiting[len(group) :])

    def _hand(self, group: Sequence[WaitingLine], result: RunningVersion) -> None:
        """Hand over lines, whose result was made. Raises EngineError."""
        before = self.running
        after = replace(result, version=group[-1].result(), serial=before.serial + 1)
        change = Change(
            after.start,
            after.stage,
            before.stage,
            any(one.resets for one in group),
            gains=changed_ratios(before, after),
            damp=after.damp,
            force_bounds=after.force_bounds,
        )
        self.changes.send(change, group, after)
        self._note_under_way()

    def note_event(self, event: EngineEvent) -> None:
        """Note that a change took effect, or came too late."""
        with self.lock:
            if event.is_late:
                soonest = self.first_frame(0.0, LineKind.FADERS)
                self._wait_again(self.changes.note_late(event.ticket or 0, soonest))
                return
            running, made = self.running, self.changes.note_done(event)
            if made is None:
                return
            self.reports.append(Done(event.frame, made.number, made.lines, made.after))
            if self.running is not running:  # it was withdrawn too late
                numbers = {line.number for line in made.lines}
                self._let_wait([one for one in self.waiting if one.number not in numbers])

    # --- making ----------------------------------------------------------------------------------

    def make_due(self) -> bool:
        """Make the version of the next lines if it will be needed soon; False if none is.

        Any thread may call it; the lock is free while the version is made.
        """
        with self.lock:
            on, group = self.running, self._first_unmade()
        if not group:
            return False
        began = self.making_time.began()
        try:
            made = StagedGroup(group, on, self._stage_lines(on, group))
        except StoppedError:  # the session is closed
            raise
        except REFUSALS:
            failed, why = self._first_failing(on, group)
            with self.lock:
                if group == staged_group_of(self.waiting):
                    self._fail([failed], why)
            return True
        finally:
            self.making_time.add(began)
        with self.lock:
            self._staged = made
        return True

    def _first_failing(
        self, on: RunningVersion, group: Sequence[WaitingLine]
    ) -> tuple[WaitingLine, str]:
        """The first line of a group that cannot be made after those before it, and why."""
        for count in range(1, len(group) + 1):
            try:
                self._stage_lines(on, group[:count])
            except REFUSALS as error:
                return group[count - 1], str(error)
        return group[-1], "it could not be made together with those before it"

    def _first_unmade(self) -> tuple[WaitingLine, ...]:
        ahead = _AHEAD + _MAKING_FACTOR * self.making_time.seconds
        until = self.engine.frame + self.margin + int(ahead * self.rate)
        group = staged_group_of(self.waiting)
        if not group or group[0].frame > until:
            return ()
        is_late = group[0].frame < self.first_frame(0.0)
        return () if is_late or self._is_staged(group) else group

    def extend(self) -> bool:
        """Extend the timeline if half of it is over; False if that is not needed.

        Any thread may call it; the lock is free while the extension is made.
        """
        with self.lock:
            on, start = self.running, self._extension_frame()
        if start is None:
            return False
        began = self.extension_time.began()
        try:
            after = self._checked(on, self.takeovers.extended(on, start, self.latest))
        except StoppedError:
            raise
        except REFUSALS as error:  # a value that automation reaches later, under a real hand
            self._end_timeline(on, error)
            return True
        finally:
            self.extension_time.add(began)
        with self.lock:
            if on is self.running and start >= self.first_frame(0.0):
                self._send_extension(after)
        return True

    def _send_extension(self, after: RunningVersion) -> None:
        change = Change(
            after.start,
            after.stage,
            self.running.stage,
            damp=after.damp,
            force_bounds=after.force_bounds,
        )
        try:
            self.changes.send(change, (), after)
        except EngineError as error:  # too many changes wait: the next turn tries again
            self.reports.append(Unable(f"the score could not be continued yet: {error}"))

    def _extension_frame(self) -> int | None:
        """The frame of the next extension; None if none is needed now."""
        running = self.running
        if not running.clock.is_running or running.timeline_end == math.inf:
            return None
        tempo, now = running.version.piece.tempo_map, self.beat_now()
        n_bars = horizon(tempo, now)[1]
        end = tempo.bars.bar_beat(running.timeline_end)[0]
        if now <= tempo.bars.start(end - n_bars // 2):
            return None
        start = self.first_frame(_MAKING_FACTOR * self.extension_time.seconds)
        # A line that takes over sooner extends the timeline too.
        is_soon = any(one.frame <= start and not one.rule.is_quick for one in self.waiting)
        return None if is_soon else start

    def _end_timeline(self, on: RunningVersion, error: Exception) -> None:
        with self.lock:
            if on is self.running:
                end = on.version.piece.tempo_map.written(on.timeline_end)
                why = f"the score could not be continued after {end}: {error}"
                self.reports.append(Unable(f"{why}; what plays rings out"))
                self.changes.running = replace(on, timeline_end=math.inf)

    # --- past ------------------------------------------------------------------------------------

    def effect_order(self) -> dict[int, float]:
        """The place of the last lines in the order in which they take effect, by number."""
        done = self.changes.done[-_UNSETTLED:]
        numbers = [*done, *(one.number for one in self.waiting)]
        return {number: float(place) for place, number in enumerate(numbers)}

    def rebase(self, base: Texts) -> None:
        """Note that the files hold these texts now."""
        with self.lock:
            self.past_versions.rebase(base)
            version = replace(self.running.version, base=base, renames=())
            self.changes.running = replace(self.running, version=version)
            self._let_wait(self.waiting)
