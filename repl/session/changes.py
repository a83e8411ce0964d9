"""The way to the engine: what it plays, and the changes that are under way to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from ergon.repl.session.gains import all_gains_at, changed_ratios, faded, gains_at, with_faders

if TYPE_CHECKING:
    from ergon.repl.session.engine import Change, Engine, EngineEvent
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


@dataclass(frozen=True, slots=True)
class UnderWay:
    """A change that was sent to the engine: the lines in it, and the versions around it."""

    ticket: int
    number: int
    lines: Sequence[WaitingLine]
    before: RunningVersion
    after: RunningVersion

    @property
    def is_gains(self) -> bool:
        """Whether it changes gains alone."""
        return self.after.stage is self.before.stage


class Returned(NamedTuple):
    """Lines of changes that were not made, and the version before them."""

    lines: Sequence[WaitingLine]
    before: RunningVersion


class Changes:
    """Changes in the order in which they were sent.

    `running` is the version after all of them, `done` has the numbers of their lines.
    """

    def __init__(self, engine: Engine, running: RunningVersion) -> None:
        """Begin with a version that plays."""
        self.running = running
        self.under_way: list[UnderWay] = []
        self.done: list[int] = []
        self._engine = engine
        self._n_sent = 0
        # Changes that were taken back; one that was made before it could be is put back.
        self._withdrawn: dict[int, UnderWay] = {}

    @property
    def playing(self) -> RunningVersion:
        """What the engine plays now."""
        return self.under_way[0].before if self.under_way else self.running

    def playing_at(self, frame: int) -> RunningVersion:
        """What the engine will play at a frame."""
        playing = self.playing
        for one in self.under_way:
            if one.after.start <= frame:
                playing = one.after
        return playing

    def send(self, change: Change, lines: Sequence[WaitingLine], after: RunningVersion) -> None:
        """Send a change, after which the version `after` plays. Raises EngineError."""
        ticket = self._engine.change(change)
        self._n_sent += 1
        self.under_way.append(UnderWay(ticket, self._n_sent, tuple(lines), self.running, after))
        self.done += [one.number for one in lines]
        self.running = after

    def send_gains(self, frame: int, lines: Sequence[WaitingLine]) -> None:
        """Send the gains that lines change, for a frame that may come before changes under way.

        Raises EngineError, or one of `REFUSALS` if the last version lacks what they name.
        """
        after = with_faders(self.running, lines)
        playing = self.playing_at(frame)
        gains = changed_ratios(playing, faded(playing, lines))
        earlier = [
            replace(one, before=faded(one.before, lines), after=faded(one.after, lines))
            for one in self.under_way
        ]
        self.send(gains_at(frame, after, gains), lines, after)
        self.under_way[: len(earlier)] = earlier
        self._note_overtaken(frame, lines)
        for one in earlier:  # a new mixer would bring back the gains of before
            if not one.is_gains:
                self.send(all_gains_at(max(frame, one.after.start), one.after), (), after)

    def _note_overtaken(self, frame: int, lines: Sequence[WaitingLine]) -> None:
        """Put the numbers of lines that act at a frame before those that act later."""
        later = [
            line.number
            for one in self.under_way
            if one.after.start > frame and not one.is_gains
            for line in one.lines
        ]
        numbers = [line.number for line in lines]
        moved = {*later, *numbers}
        self.done = [number for number in self.done if number not in moved] + numbers + later

    def withdraw(self, frame: int) -> Returned:
        """Take back the changes from a frame on that were not made yet."""
        index = next((i for i, one in enumerate(self.under_way) if one.after.start >= frame), None)
        if index is None:
            return Returned((), self.running)
        self._engine.revoke(frame)
        return self._take_back(index, frame)

    def _take_back(self, index: int, frame: int) -> Returned:
        """Take back the changes from one on. Gains need no version, so that they act all the
        same.
        """
        back = self.under_way[index:]
        del self.under_way[index:]
        base = self.running = back[0].before
        lines: list[WaitingLine] = []
        for one in back:
            if one.is_gains:
                after = faded(base, one.lines)
                self.under_way.append(replace(one, before=base, after=after))
                base = after
            else:
                self._withdrawn[one.ticket] = one
                lines += one.lines
        numbers = {line.number for line in lines}
        self.done = [number for number in self.done if number not in numbers]
        self.running = base
        if any(one.is_gains for one in back):  # their gains were those of other groups
            self.send(all_gains_at(frame, base), (), base)
        return Returned(lines, base)

    def note_late(self, ticket: int, soonest: int) -> Returned:
        """Note that a change came too late: it and those after it are not made.

        Gains are sent again for the frame `soonest`.
        """
        index = next((i for i, one in enumerate(self.under_way) if one.ticket == ticket), None)
        returned = Returned((), self.running)
        if index is not None and self.under_way[index].is_gains:
            late = self.under_way.pop(index)
            again = self._engine.change(all_gains_at(soonest, self.running))
            running = self.running
            self.under_way.append(replace(late, ticket=again, before=running, after=running))
        elif index is not None:
            returned = self._take_back(index, soonest)
        self._withdrawn.pop(ticket, None)
        return returned

    def note_done(self, event: EngineEvent) -> UnderWay | None:
        """Note that a change was made; returns it. None if the ticket is not known."""
        for index, one in enumerate(self.under_way):
            if one.ticket == event.ticket:
                return self.under_way.pop(index)
        withdrawn = self._withdrawn.pop(event.ticket or 0, None)
        if withdrawn is not None:  # it was made before it could be withdrawn
            self.done += [line.number for line in withdrawn.lines]
            self.running = withdrawn.after
        return withdrawn
