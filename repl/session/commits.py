"""Accepted lines that wait for their boundary, and their way to the engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING

from ergon._core import FORCE_FALL_TIME, EngineError, StoppedError
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import NOW, Command, When
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import scope_of
from ergon.repl.session.clock import (
    Clock,
    clock_after_takeover,
    clock_at_beat,
    next_boundary,
    running_clock,
)
from ergon.repl.session.engine import Change
from ergon.repl.session.making_time import MakingTime
from ergon.repl.session.running import JOIN_SECONDS, RunningVersion, horizon, stage_next
from ergon.repl.session.version import NotTakenError, PastVersion, Version
from ergon.scores.staging.refusals import StageError

if TYPE_CHECKING:
    from ergon.notation.clock.tempo import TempoMap
    from ergon.repl.session.engine import Engine
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.stage import Stage

# A waiting line is handed to the engine this long before the last moment at which it is in time
# [s]. Its version is made then, or earlier where making takes longer.
_AHEAD = 0.3

# A line that acts now gets twice the time that the slowest of the last lines took.
_MAKING_FACTOR = 2.0

# The errors with which a line can be refused after it was parsed.
REFUSALS = (NotTakenError, StageError, EditError, EngineError, StoppedError)

# Makes a version from the one before it and the beat at which it takes effect.
VersionEdit = Callable[[Version, float], Version]


@dataclass(slots=True)
class WaitingLine:
    """An accepted line that has not taken effect yet.

    `sets_running` starts the piece at beat `beat` (True) or stops it there (False). A line that
    `resets` puts all masses at their start; a line that `is_now` should act as soon as possible.
    A line with `is_forgotten` set by a panic is dropped if it comes too late.
    """

    line: str
    edit: VersionEdit
    beat: float
    start: int
    sets_running: bool | None = None
    resets: bool = False
    is_now: bool = False
    is_forgotten: bool = False
    reads_files: bool = False
    staged: RunningVersion | None = None
    predecessor: RunningVersion | None = None  # the version that `staged` follows
    number: int = 0
    version: Version | None = None  # the version from this line on

    def is_before(self, other: WaitingLine) -> bool:
        """Whether it takes effect before a line that was typed later.

        Lines of the same frame are in the order of their beats; those that start or stop the
        piece come last.
        """
        if self.start != other.start:
            return self.start < other.start
        return other.sets_running is not None or (
            self.sets_running is None and self.beat <= other.beat + SAME
        )


@dataclass(slots=True)
class Commits:
    """Hands versions to the engine in the order of their boundaries.

    `real` are the players whose hands are real.
    """

    engine: Engine
    running: RunningVersion
    real: Real
    # Frames from the request of a change to the first frame at which it can be made. With real
    # hands this includes the time in which their forces fall to the limit of a stiffer scene.
    margin: int
    head: Version
    waiting: list[WaitingLine] = field(default_factory=list)
    # Changes under way: the ticket, the lines, and the version that was running before.
    under_way: list[tuple[int, Sequence[WaitingLine], RunningVersion]] = field(default_factory=list)
    making_time: MakingTime = field(default_factory=MakingTime)  # of versions
    dropped: list[tuple[WaitingLine, str]] = field(default_factory=list)  # lines dropped, and why
    messages: list[str] = field(default_factory=list)
    # The version that each line made when it was last computed, by number. In the end this is the
    # version that takes effect.
    past_versions: dict[int, PastVersion] = field(default_factory=dict)
    handed_over: list[int] = field(default_factory=list)  # numbers of lines, in the order of effect
    # Lines whose beat has another frame now.
    moved_lines: list[WaitingLine] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Add to the margin the time in which forces on real hands fall."""
        if self.real and self.margin:
            self.margin += int(FORCE_FALL_TIME * self.rate)

    # --- when ------------------------------------------------------------------------------------

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.running.stage.rate

    @property
    def lead(self) -> float:
        """How long a version takes over before its beat [s]."""
        return JOIN_SECONDS + self.engine.tick_frames / self.rate

    def soonest_frame(self) -> int:
        """The first frame at which a new change can take effect: a multiple of the tick."""
        return self.first_frame(_MAKING_FACTOR * self.making_time.seconds)

    def beat_now(self) -> float:
        """The beat of the piece that the engine computes now."""
        return self.running.beat(self.engine.frame)

    def beat_and_frame(self, when: When, grid: Length | None) -> tuple[float, int]:
        """The beat on which a line acts, and the frame at which its version takes over.

        Raises NotTakenError where the beat is past.
        """
        clock, start = self.running.clock, self.soonest_frame()
        if not clock.is_running:
            return clock.stopped_beat, start
        tempo = self.head.piece.tempo_map
        lead = self.lead
        first = clock.beat(tempo, start / self.rate + lead)
        if isinstance(when, Position):
            beat = self._resolve(when)
            if beat < first - SAME:
                here = tempo.written(self.beat_now())
                raise NotTakenError(
                    f"{when.text or tempo.written(beat)} is past: the piece is at {here}"
                )
        elif isinstance(when, Length):
            beat = max(first, tempo.after(self.beat_now(), when))
        else:
            beat = first if when is NOW or grid is None else next_boundary(tempo, first, grid)
        return beat, max(start, self._takeover_frame(clock, tempo, beat))

    def _takeover_frame(self, clock: Clock, tempo: TempoMap, beat: float) -> int:
        """The frame at which a version takes over, for a beat on which it acts."""
        every = self.engine.tick_frames
        frames = (clock.seconds(tempo, beat) - self.lead) * self.rate
        return math.floor(frames / every + SAME) * every

    def frame_of(self, beat: float) -> int:
        """The first frame of the tick of a beat; the soonest frame where the piece is stopped."""
        if not self.running.clock.is_running:
            return self.soonest_frame()
        tempo, every = self.head.piece.tempo_map, self.engine.tick_frames
        return int(self.running.clock.seconds(tempo, beat) * self.rate) // every * every

    def version_at(self, beat: float) -> Version:
        """The version at a coming beat: with all waiting lines that take effect by then."""
        version = self.running.version
        for one in self.waiting:
            if one.beat <= beat + SAME and one.version is not None:
                version = one.version
        return version

    def _resolve(self, position: Position) -> float:
        try:
            return self.head.piece.tempo_map.resolve(position)
        except TextError as error:
            raise NotTakenError(error.message) from None

    # --- taking a line ---------------------------------------------------------------------------

    def insert(self, waiting: WaitingLine) -> RunningVersion:
        """Insert a line among those that wait, and make the versions up to its own.

        If it raises NotTakenError or StageError, nothing has changed.
        """
        return self._insert(waiting, sum(one.is_before(waiting) for one in self.waiting))

    def insert_last(self, waiting: WaitingLine) -> RunningVersion:
        """Like `insert`, but behind all lines of the same frame, in the order of a journal."""
        return self._insert(waiting, sum(one.start <= waiting.start for one in self.waiting))

    def _insert(self, waiting: WaitingLine, place: int) -> RunningVersion:
        before, after = self.waiting[:place], self.waiting[place:]
        made = self._make_all([*before, waiting])
        self._replace_queue([*before, waiting], made, after)
        return made[-1][0]

    def drop(self, waiting: WaitingLine) -> None:
        """Remove a waiting line."""
        place = self.waiting.index(waiting)
        before, after = self.waiting[:place], self.waiting[place + 1 :]
        self._replace_queue(before, self._make_all(before), after)

    def _replace_queue(
        self,
        queue: list[WaitingLine],
        made: list[tuple[RunningVersion, RunningVersion]],
        after: list[WaitingLine],
    ) -> None:
        """Set the waiting lines: `queue`, whose versions are `made`, and `after`, whose versions
        are remade.
        """
        on = made[-1][0] if made else self.running
        starts = self._takeover_frames(after, on)
        after = sorted(after, key=lambda one: starts[id(one)])
        version = on.version
        has_lost = bool(after) and not _names(self.head) <= _names(version)
        further = []
        for one in after:
            try:
                made_of = self._edited(version, one)
                if has_lost and one.line and not (one.resets or one.reads_files):
                    reparse(one.line, version)
                version = made_of
            except REFUSALS as error:
                due = version.piece.tempo_map.written(one.beat)
                raise NotTakenError(
                    f"after this line, the waiting line '{one.line}' (due at {due}) would fail: "
                    f"{error}; `undo` cancels waiting lines, the last one first"
                ) from error
            further.append(version)
        # From here on nothing can fail, so the queue may change.
        _keep_made(queue, made)
        for one, of_one in zip(after, further, strict=True):
            one.staged, one.predecessor, one.version = None, None, of_one
            if one.start != starts[id(one)]:
                one.start = starts[id(one)]
                self.moved_lines.append(one)
        self.waiting = [*queue, *after]
        self.head = version

    def _takeover_frames(self, lines: Sequence[WaitingLine], on: RunningVersion) -> dict[int, int]:
        """The frames at which waiting lines take over if they follow a version, by identity of the
        line.

        A change of tempo or a jump moves the frame of a beat; if the beat is then past, the line
        takes over as soon as it can.
        """
        clock, tempo = on.clock, on.version.piece.tempo_map
        soonest = max(on.start + self.engine.tick_frames, self.soonest_frame())
        return {
            id(one): one.start
            if one.is_now or one.sets_running or not clock.is_running
            else max(soonest, self._takeover_frame(clock, tempo, one.beat))
            for one in lines
        }

    @staticmethod
    def _edited(before: Version, one: WaitingLine) -> Version:
        goes = before.is_running if one.sets_running is None else one.sets_running
        return one.edit(replace(before.taken_over(), is_running=goes), one.beat)

    def _make_all(self, queue: list[WaitingLine]) -> list[tuple[RunningVersion, RunningVersion]]:
        on, found = self.running, []
        for one in queue:
            running = self._made(on, one)
            found.append((running, on))
            on = running
        return found

    def _made(self, on: RunningVersion, one: WaitingLine) -> RunningVersion:
        """The version that a line makes of `on`, made before or now. Raises `REFUSALS`."""
        if one.staged is not None and one.predecessor is on:
            return one.staged
        return self._stage_line(on, one)

    def _stage_line(self, on: RunningVersion, one: WaitingLine) -> RunningVersion:
        began = MakingTime.began()
        version = self._edited(on.version, one)
        clock, leave, enter = on.clock, one.beat, one.beat
        seconds = one.start / self.rate
        if one.sets_running is not None:
            leave = on.beat(one.start)
            tempo = version.piece.tempo_map
            clock = (
                running_clock(tempo, enter, seconds + self.lead)
                if one.sets_running
                else Clock(None, leave)
            )
        elif version.enter_beat is not None:
            enter = version.enter_beat
            clock = clock_at_beat(clock, version.piece.tempo_map, enter, seconds + self.lead)
        else:
            tempos = on.version.piece.tempo_map, version.piece.tempo_map
            tick = self.engine.tick_frames / self.rate
            clock, enter = clock_after_takeover(clock, *tempos, one.beat, seconds + self.lead, tick)
            leave = enter
        made = stage_next(
            on,
            version,
            clock,
            one.start,
            leave=leave,
            enter=enter,
            real=self.real,
            extends=not one.number,
        )
        self._check_sound(made.stage)
        # Every version passes here, so none plays that a real hand's key cannot bear.
        borne = self.engine.force_bounds(made.stage, made.start, made.glides, on.force_bounds)
        made = replace(made, force_bounds=borne)
        if one.number:
            where = version.piece.tempo_map.written(one.beat)
            self.past_versions[one.number] = PastVersion.from_version(version, where)
        if self.margin:  # without a margin the engine waits, and the time does not matter
            self.making_time.add(began)
        return made

    def drop_all(self) -> list[WaitingLine]:
        """Drop all waiting lines and return them; changes under way will be dropped if they come
        too late.
        """
        waited = [one for one in self.waiting if one.number]
        self.waiting.clear()
        for _, group, _ in self.under_way:
            for one in group:
                one.is_forgotten = True
        self.head = self.running.version
        return waited

    def _check_sound(self, stage: Stage) -> None:
        """Raise NotTakenError if a stage needs another number of channels or rate than the open
        sound card.
        """
        begun = self.running.stage
        for unit, plays, asked in (
            ("number of channels", self.engine.n_channels, stage.n_channels),
            ("rate", begun.rate, stage.rate),
        ):
            if plays != asked:
                raise NotTakenError(
                    f"the {unit} of a session cannot change: this session plays {plays:g}, and "
                    f"the score has {asked:g}; play that score in a session of its own"
                )

    # --- handing over ----------------------------------------------------------------------------

    def hand_over_due(self, before: float = math.inf) -> list[WaitingLine]:
        """Hand due versions to the engine, and extend the timeline before it ends.

        Returns the lines that were not ready in time and wait again. The timeline is not
        extended at or after the frame `before`, where a line takes over that extends it itself.
        """
        late: list[WaitingLine] = []
        while self.waiting and self.waiting[0].start <= self._handover_frame():
            one = self.waiting[0]
            if one.start < self.first_frame(0.0):
                if self.margin and not late:  # one delay, however many lines it made late
                    self.making_time.seconds = max(2.0 * self.making_time.seconds, 1.0 / self.rate)
                beat, one.start = self.beat_and_frame(
                    None, None if one.is_now else Length(bars=1.0)
                )
                one.beat, one.staged = beat if one.sets_running is None else one.beat, None
                self.waiting.sort(key=lambda other: other.start)
                late.append(one)
                continue
            group = [other for other in self.waiting if other.start == one.start]
            self.waiting = [other for other in self.waiting if other.start != one.start]
            self._hand_over(group)
        self._make_ahead()
        running = self.running
        tempo = running.version.piece.tempo_map
        # One waiting extension is enough, and a timeline without end needs none.
        is_fixed = any(not one.number for one in self.waiting) or running.timeline_end == math.inf
        if not running.clock.is_running or is_fixed:
            return late
        now = self.beat_now()
        n_bars = horizon(tempo, now)[1]
        # A waiting line extends it too, if it is due in time.
        left = n_bars // 4 if self.waiting else n_bars // 2
        if now > tempo.bars.start(tempo.bars.bar_beat(running.timeline_end)[0] - left):
            # The program was suspended, or a line took very long.
            if now > running.timeline_end + SAME:
                first, last = tempo.written(running.timeline_end), tempo.written(now)
                self.messages.append(
                    "the program was suspended, or a line took too long: what was to begin from "
                    f"{first} to {last} was skipped"
                )
            damp = running.version.damp
            again = WaitingLine(
                "", lambda old, _: replace(old, damp=damp), *self.beat_and_frame(NOW, None)
            )
            if again.start >= before:
                return late
            try:
                self.insert(again)
            except REFUSALS as error:  # a value that automation reaches later, under a real hand
                end = self.running.version.piece.tempo_map.written(running.timeline_end)
                self.messages.append(
                    f"the score could not be continued after {end}: {error}; what plays rings out"
                )
                self.running = replace(running, timeline_end=math.inf)
                return late
            late += self.hand_over_due(before)
        return late

    def first_frame(self, making: float) -> int:
        """The first frame for a change that takes `making` [s] to compute."""
        every = self.engine.tick_frames
        ahead = self.margin + int(making * self.rate)
        return -(-max(self.engine.frame + ahead, self.running.start + 1) // every) * every

    def _handover_frame(self) -> int:
        return self.engine.frame + self.margin + int(_AHEAD * self.rate)

    def _make_ahead(self) -> None:
        """Make the versions of waiting lines that would not be ready when they are handed over."""
        making = _MAKING_FACTOR * self.making_time.seconds
        if making <= _AHEAD:
            return
        until = self.engine.frame + self.margin + int(making * self.rate)
        queue = [one for one in self.waiting if one.start <= until]
        try:
            made = self._make_all(queue)
        except REFUSALS:  # the line is dropped when it is due
            return
        _keep_made(queue, made)

    def _hand_over(self, group: Sequence[WaitingLine]) -> None:
        """Hand the lines of one boundary to the engine as one change."""
        before = on = self.running
        n_dropped, taken = len(self.dropped), []
        for one in group:
            try:
                on = one.staged = self._made(on, one)
                taken.append(one)
            except REFUSALS as error:  # an earlier line removed what it needs
                self.dropped.append((one, str(error)))
        if on is before:
            self._find_head()
            return
        change = Change(
            on.start,
            on.stage,
            before.stage,
            any(one.resets for one in taken),
            gains=_changed_ratios(before, on),
            damp=on.version.damp,
            force_bounds=on.force_bounds,
        )
        try:
            ticket = self.engine.change(change)
        except EngineError as error:
            self.dropped += [(one, str(error)) for one in taken if one.line]
            self._find_head()
            return
        self.under_way.append((ticket, taken, before))
        self.handed_over += [one.number for one in taken if one.number]
        self.running = on
        if not self.waiting or len(self.dropped) > n_dropped:
            self._find_head()

    def _find_head(self) -> None:
        """Find the version after all waiting lines; drop those that can no longer take effect."""
        version = self.running.version
        for one in self.waiting[:]:
            try:
                one.version = version = self._edited(version, one)
            except REFUSALS as error:  # a line before it was dropped
                self.dropped.append((one, str(error)))
                self.waiting.remove(one)
        self.head = version

    def requeue_late(self, ticket: int) -> list[WaitingLine]:
        """Queue again the lines of a change that came too late, and those of all changes after it.

        Returns these lines, without those that a panic forgot.
        """
        index = next((i for i, (own, *_) in enumerate(self.under_way) if own == ticket), None)
        if index is None:
            return []
        late = [one for _, group, _ in self.under_way[index:] for one in group]
        back = [one for one in late if not one.is_forgotten]
        self.running = self.under_way[index][2]
        del self.under_way[index:]
        for one in late:
            one.staged = one.predecessor = None
            if one.number:
                self.handed_over.remove(one.number)
                if one.is_forgotten:
                    self.dropped.append((one, "it came too late, and a panic was entered since"))
        self.waiting = [*back, *self.waiting]
        return back

    def effect_order(self) -> dict[int, float]:
        """The place of lines in the order in which they take effect, by number."""
        waiting = (one.number for one in self.waiting if one.number)  # 0: the timeline is extended
        numbers = [*self.handed_over, *waiting]
        return {number: float(place) for place, number in enumerate(numbers)}

    def rebase(self, base: Texts) -> None:
        """Note that the files hold these texts now."""
        self.past_versions = {
            n: replace(one, base=base, renames=()) for n, one in self.past_versions.items()
        }
        version = replace(self.running.version, base=base, renames=())
        self.running = replace(self.running, version=version)
        self._find_head()

    def lines_under_way(self, ticket: int) -> Sequence[WaitingLine]:
        """The lines of a change under way; none if it is not known yet. Any thread may call it."""
        return next((group for own, group, _ in [*self.under_way] if own == ticket), ())

    def pop_done(self, ticket: int) -> Sequence[WaitingLine]:
        """Remove a completed change from those under way; returns its lines."""
        index = next((i for i, (own, *_) in enumerate(self.under_way) if own == ticket), None)
        return () if index is None else self.under_way.pop(index)[1]


def _keep_made(
    queue: Sequence[WaitingLine], made: Sequence[tuple[RunningVersion, RunningVersion]]
) -> None:
    """Keep with each line its version and the one before it."""
    for one, (running, on) in zip(queue, made, strict=True):
        one.staged, one.predecessor, one.version = running, on, running.version


def _names(version: Version) -> frozenset[str]:
    """The names of a version that lines may use."""
    piece = version.piece
    listed = (
        [one.name for one in piece.strikes],
        [one.name for one in piece.marks],
        [one.name for one in piece.mix.rooms],
    )
    matter = chain(piece.players, piece.keys, piece.instruments, piece.families)
    return frozenset(
        chain(matter, piece.gestures, piece.takes, piece.phrases, piece.blocks, *listed)
    )


def reparse(line: str, version: Version) -> Sequence[Command]:
    """The commands of a line, read again with the names of the version before it.

    A render of the journal reads it in the same way. Raises NotTakenError, for instance if a
    name no longer exists.
    """
    try:
        return parse(line, scope_of(version.piece))
    except Refusal as refusal:
        raise NotTakenError(refusal.message) from None


def fader_ratios(running: RunningVersion) -> dict[int, float]:
    """The ratio of each group of routes, by its number."""
    version = running.version
    parts = enumerate(running.stage.listening.parts())
    return {
        group: version.faders.ratio(version.sounds_as.shown(part, version.piece.instruments))
        for group, part in parts
    }


def _changed_ratios(before: RunningVersion, after: RunningVersion) -> dict[int, float]:
    """The groups of routes whose ratio has changed; all groups if the mixer is new."""
    old = fader_ratios(before) if after.stage.network is before.stage.network else {}
    return {group: to for group, to in fader_ratios(after).items() if to != old.get(group)}
