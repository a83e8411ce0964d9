"""Lines that were taken and wait for their boundary, and how they come into effect there."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ergon._core import EngineError, StoppedError
from ergon.live.guard import FALL
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError
from ergon.repl.language.commands import NOW, When
from ergon.repl.session.clock import Clock, boundary, started
from ergon.repl.session.engine import Change
from ergon.repl.session.running import HORIZON, JOIN, Running, follow
from ergon.repl.session.version import GLIDE, NotTakenError, Version
from ergon.scores.staging.stage import StageError

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine
    from ergon.scores.staging.live import Real

# What waits is made again shortly before it is due, on what then plays [s].
_AHEAD = 0.3

# A line that is to act now is made in twice the time that the slowest of the last ones took.
_AGAIN, _FORGET = 2.0, 0.8

# What a line is refused by, once it is read.
REFUSALS = (NotTakenError, StageError, EditError, EngineError, StoppedError)

# A line: what it makes of the version before it, when it takes effect at a beat.
VersionEdit = Callable[[Version, float], Version]


@dataclass(slots=True)
class Waiting:
    """A line between Enter and its boundary.

    `goes`: the piece begins to go, from beat `beat`, or stands from there; None: as before. One
    that `resets` finds all masses where they are written to begin; one that `is_now` was to act as
    soon as it can.
    """

    line: str
    edit: VersionEdit
    beat: float
    start: int
    goes: bool | None = None
    resets: bool = False
    is_now: bool = False
    made: Running | None = None
    on: Running | None = None  # what it was made to follow
    number: int = 0


@dataclass(slots=True)
class Commits:
    """Hands versions to the engine in the order of their boundaries.

    `real` are the players whose hands are real.
    """

    engine: Engine
    running: Running
    real: Real
    # Frames from asking for a change to the first in which it can be; where hands are real, with
    # the time in which their forces fall to what a stiffer scene leaves them.
    margin: int
    head: Version
    waiting: list[Waiting] = field(default_factory=list)
    # By ticket: what was handed over, and on what.
    handed: list[tuple[int, Sequence[Waiting], Running]] = field(default_factory=list)
    took: float = 0.0  # what making a version takes [s]
    lost: list[tuple[Waiting, str]] = field(default_factory=list)  # and why

    def __post_init__(self) -> None:
        """Leave real hands their time."""
        if self.real and self.margin:
            self.margin += int(FALL * self.rate)

    # --- when ------------------------------------------------------------------------------------

    @property
    def rate(self) -> float:
        """Frames a second."""
        return self.running.stage.rate

    @property
    def lead(self) -> float:
        """By how much a version takes over before its beat [s]."""
        return JOIN + self.engine.tick_frames / self.rate

    def soonest(self) -> int:
        """The first frame at which a change can still be made: a multiple of the tick."""
        return self.first(_AGAIN * self.took)

    def now(self) -> float:
        """The beat of the piece that is computed now."""
        return self.running.beat(self.engine.frame)

    def place(self, when: When, grid: Length | None) -> tuple[float, int]:
        """The beat on which a line acts, and the frame at which its version takes over.

        Raises NotTakenError where the beat is past.
        """
        clock, start = self.running.clock, self.soonest()
        if not clock.goes:
            return clock.at, start
        tempo = self.head.piece.tempo_map
        lead = self.lead
        first = clock.beat(tempo, start / self.rate + lead)
        if isinstance(when, Position):
            beat = self._resolved(when)
            if beat < first - SAME:
                here = tempo.written(self.now())
                raise NotTakenError(
                    f"{when.text or tempo.written(beat)} is past: the piece is at {here}"
                )
        elif isinstance(when, Length):
            beat = max(first, tempo.after(self.now(), when))
        else:
            beat = first if when is NOW or grid is None else boundary(tempo, first, grid)
        frames = (clock.seconds(tempo, beat) - lead) * self.rate
        every = self.engine.tick_frames
        return beat, max(start, math.floor(frames / every + SAME) * every)

    def frame(self, beat: float) -> int:
        """The first frame of the tick of a beat; of a piece that stands the soonest."""
        if not self.running.clock.goes:
            return self.soonest()
        tempo, every = self.head.piece.tempo_map, self.engine.tick_frames
        return int(self.running.clock.seconds(tempo, beat) * self.rate) // every * every

    def _resolved(self, position: Position) -> float:
        try:
            return self.head.piece.tempo_map.resolve(position)
        except TextError as error:
            raise NotTakenError(error.message) from None

    # --- taking a line ---------------------------------------------------------------------------

    def take(self, waiting: Waiting) -> Running:
        """Put a line in its place among those that wait, and make all that comes of it.

        Raises NotTakenError or StageError, and then nothing has changed.
        """
        place = sum(one.beat <= waiting.beat + SAME for one in self.waiting)
        before, after = self.waiting[:place], self.waiting[place:]
        made = self._made([*before, waiting])
        self._fold([*before, waiting], made, after)
        return made[-1][0]

    def drop(self, waiting: Waiting) -> None:
        """Take a line back before its boundary."""
        place = self.waiting.index(waiting)
        before, after = self.waiting[:place], self.waiting[place + 1 :]
        self._fold(before, self._made(before), after)

    def _fold(
        self,
        queue: list[Waiting],
        made: list[tuple[Running, Running]],
        after: list[Waiting],
    ) -> None:
        """Lines that are made, and those after them, whose stage is made when they are due."""
        version = made[-1][0].version if made else self.running.version
        for one in after:
            version = self._version(version, one)
        # Nothing can fail any more.
        for one, (running, on) in zip(queue, made, strict=True):
            one.made, one.on = running, on
        for one in after:
            one.made = one.on = None
        self.waiting = [*queue, *after]
        self.head = version

    @staticmethod
    def _version(before: Version, one: Waiting) -> Version:
        before = replace(before, cuts=False, damp=None, glide=GLIDE, read=None)
        return one.edit(before, one.beat)

    def _made(self, queue: list[Waiting]) -> list[tuple[Running, Running]]:
        on, found = self.running, []
        for one in queue:
            is_made = one.made is not None and one.on is on
            running = one.made if is_made and one.made is not None else self._follow(on, one)
            found.append((running, on))
            on = running
        return found

    def _follow(self, on: Running, one: Waiting) -> Running:
        began = time.perf_counter()
        version = self._version(on.version, one)
        clock, leave, enter = on.clock, one.beat, one.beat
        seconds = one.start / self.rate
        if one.goes is not None:
            leave = on.beat(one.start)
            tempo = version.piece.tempo_map
            clock = started(tempo, enter, seconds + self.lead) if one.goes else Clock(None, leave)
        made = follow(on, version, clock, one.start, leave=leave, enter=enter, real=self.real)
        # Every version comes by here: none takes over that a real hand's key does not bear.
        borne = self.engine.bearings(made.stage, made.start, made.glides, on.bearings)
        made = replace(made, bearings=borne)
        if self.margin:  # else the engine waits
            self.took = max(time.perf_counter() - began, _FORGET * self.took)
        return made

    # --- handing over ----------------------------------------------------------------------------

    def tick(self) -> list[Waiting]:
        """Hand over what is due soon, and put on the timeline what comes after the horizon.

        Lines that were not ready in time, and wait again.
        """
        late = []
        while self.waiting and self.waiting[0].start <= self._soon():
            one = self.waiting[0]
            if one.start < self.first(0.0):
                self.took = max(2.0 * self.took, 1.0 / self.rate)
                beat, one.start = self.place(None, None if one.is_now else Length(bars=1.0))
                one.beat, one.made = beat if one.goes is None else one.beat, None
                self.waiting.sort(key=lambda other: other.start)
                late.append(one)
                continue
            group = [other for other in self.waiting if other.start == one.start]
            self.waiting = self.waiting[len(group) :]
            self._hand(group)
        bars = self.running.version.piece.tempo_map.bars
        running = self.running
        if not running.clock.goes or self.waiting:
            return late
        half = bars.start(bars.bar_beat(running.until)[0] - HORIZON // 2)
        if self.now() > half:
            damp = running.version.damp
            again = Waiting("", lambda old, _: replace(old, damp=damp), *self.place(NOW, None))
            self.take(again)
            late += self.tick()
        return late

    def first(self, making: float) -> int:
        """The first tick that a change can reach, when it takes so long to make [s]."""
        every = self.engine.tick_frames
        ahead = self.margin + int(making * self.rate)
        return -(-max(self.engine.frame + ahead, self.running.start + 1) // every) * every

    def _soon(self) -> int:
        return self.engine.frame + self.margin + int(_AHEAD * self.rate)

    def _hand(self, group: Sequence[Waiting]) -> None:
        """Lines of one boundary come into effect together: the last is what all of them made."""
        before = on = self.running
        for one in group:
            is_made = one.made is not None and one.on is on
            try:
                on = one.made if is_made and one.made is not None else self._follow(on, one)
            except REFUSALS as error:  # a line between has taken away what it needs
                self.lost.append((one, str(error)))
        if on is before:
            return
        change = Change(
            on.start,
            on.stage,
            before.stage,
            any(one.resets for one in group),
            gains=_moved(before, on),
            damp=on.version.damp,
            bearings=on.bearings,
        )
        self.handed.append((self.engine.change(change), group, before))
        self.running = on
        if not self.waiting:
            self.head = on.version

    def late(self, ticket: int) -> list[Waiting]:
        """A change came too late: it and all that were built on it wait again; which they are."""
        index = next((i for i, (own, *_) in enumerate(self.handed) if own == ticket), None)
        if index is None:
            return []
        back = [one for _, group, _ in self.handed[index:] for one in group]
        self.running = self.handed[index][2]
        del self.handed[index:]
        for one in back:
            one.made = one.on = None
        self.waiting = [*back, *self.waiting]
        return back

    def done(self, ticket: int) -> Sequence[Waiting]:
        """A change was made: which lines'."""
        index = next((i for i, (own, *_) in enumerate(self.handed) if own == ticket), None)
        return () if index is None else self.handed.pop(index)[1]


def fader_ratios(running: Running) -> dict[int, float]:
    """The ratio of each group of routes."""
    faders = running.version.faders
    return {group: faders.ratio(part) for group, part in enumerate(running.stage.listening.parts())}


def _moved(before: Running, after: Running) -> dict[int, float]:
    """Groups of routes whose faders stand elsewhere than before; all of a new mixer."""
    old = fader_ratios(before) if after.stage.network is before.stage.network else {}
    return {group: to for group, to in fader_ratios(after).items() if to != old.get(group)}
