"""The changes that were sent to the engine and have not been made yet, and the version that it
plays.

Changes are in the order in which they act. A change of gains needs no stage, so that it may be sent
for a frame before that of a change that was sent earlier. The latter then follows a version with
other faders, and its gains are sent again where they are no longer right.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from ergon._core import EngineError
from ergon.repl.session.gains import (
    all_gains_at,
    can_move,
    changed_ratios,
    faded,
    fader_ratios,
    faders_after,
    gains_at,
    on_other_faders,
    with_faders,
)
from ergon.repl.session.version import PastVersion

if TYPE_CHECKING:
    from ergon.repl.session.engine import Change, Engine, EngineEvent
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


@dataclass(frozen=True, slots=True)
class UnderWay:
    """A change that was sent to the engine: its frame, the lines in it, and the versions around it.

    `gains` are the ratios that the engine sets at its frame.
    """

    ticket: int
    number: int
    frame: int
    lines: Sequence[WaitingLine]
    before: RunningVersion
    after: RunningVersion
    gains: Mapping[int, float] = field(default_factory=dict)

    @property
    def is_gains(self) -> bool:
        """Whether it changes gains alone."""
        return self.after.stage is self.before.stage


class Returned(NamedTuple):
    """Lines of changes that were not made, and the version before them."""

    lines: Sequence[WaitingLine]
    before: RunningVersion


class Changes:
    """Changes in the order in which they act.

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
        # Tickets of gains that were sent again, because they were no longer right.
        self._corrections: set[int] = set()

    @property
    def playing(self) -> RunningVersion:
        """What the engine plays now."""
        return self.under_way[0].before if self.under_way else self.running

    def playing_at(self, frame: int) -> RunningVersion:
        """What the engine will play at a frame."""
        acts = [change for change in self.under_way if change.frame <= frame]
        return acts[-1].after if acts else self.playing

    def send(self, change: Change, lines: Sequence[WaitingLine], after: RunningVersion) -> None:
        """Send a change, after which the version `after` plays, made of the running version.

        Raises EngineError.
        """
        old_version = self.running
        is_last = all(sent.frame <= change.frame for sent in self.under_way)
        if not is_last:  # gains that act later are under way
            old_version = self.playing_at(change.frame)
            after = on_other_faders(after, old_version.version, lines)
            if lines:
                change = replace(change, gains=changed_ratios(old_version, after))
        ticket = self._engine.change(change)
        self._n_sent += 1
        sent = UnderWay(
            ticket, self._n_sent, change.frame, tuple(lines), old_version, after, change.gains
        )
        self.done += [line.number for line in lines]
        self._insert(sent)
        if is_last:
            self.running = after
        else:
            self.running = _with_faders_of(after, self.under_way[-1].after)

    def send_gains(self, from_frame: int, waiting_lines: Sequence[WaitingLine]) -> None:
        """Send the gains that lines change, for a frame that may come before changes under way.

        Raises EngineError, or one of `REFUSALS` if there is not what they name.
        """
        start_frame = self.ready_frame(from_frame, waiting_lines)
        with_faders(self.playing_at(start_frame), waiting_lines)
        self._n_sent += 1
        self._send_gains(start_frame, waiting_lines, self._n_sent)
        self.done += [line.number for line in waiting_lines]
        self._sort_done()

    def ready_frame(self, first_frame: int, waiting_lines: Sequence[WaitingLine]) -> int:
        """The first frame from `first_frame` on that has all strikes and routes that lines fade."""
        if can_move(self.playing_at(first_frame), waiting_lines):
            return first_frame
        later = (change for change in self.under_way if change.frame > first_frame)
        return next(
            (change.frame for change in later if can_move(change.after, waiting_lines)), first_frame
        )

    def _send_gains(
        self, change_frame: int, waiting_lines: Sequence[WaitingLine], change_number: int
    ) -> None:
        running = self.playing_at(change_frame)
        running_after = faded(running, waiting_lines)
        gains = changed_ratios(running, running_after)
        ticket = self._engine.change(gains_at(change_frame, running_after, gains))
        self._insert(
            UnderWay(
                ticket,
                change_number,
                change_frame,
                tuple(waiting_lines),
                running,
                running_after,
                gains,
            )
        )
        self.running = _with_faders_of(self.running, self.under_way[-1].after)

    def _insert(self, sent: UnderWay) -> None:
        """Insert a change behind those that act before it or at its frame."""
        index = sum(change.frame <= sent.frame for change in self.under_way)
        later = self.under_way[index:]
        self.under_way[index:] = [sent]
        self._follow(sent.after, later)
        self._sort_done()

    def _follow(self, before: RunningVersion, later: Sequence[UnderWay]) -> None:
        """Append changes, the first of which now follows another version."""
        for change in later:
            if change.before is not before:
                change = self._corrected(change, before)
            self.under_way.append(change)
            before = change.after

    def _corrected(self, change: UnderWay, before: RunningVersion) -> UnderWay:
        """A change that follows another version; the engine gets its gains again if they differ."""
        if change.is_gains:
            version_after = faded(before, change.lines)
        else:
            version_after = on_other_faders(change.after, before.version, change.lines)
        ratios = fader_ratios(version_after)
        wanted_ratios = changed_ratios(before, version_after)
        gains = {
            group: ratios[group] for group in {*change.gains, *wanted_ratios} if group in ratios
        }
        if gains != change.gains:
            with contextlib.suppress(EngineError):  # too many changes wait
                self._corrections.add(
                    self._engine.change(gains_at(change.frame, version_after, gains))
                )
        return replace(change, before=before, after=version_after, gains=gains)

    def _sort_done(self) -> None:
        """Let the numbers of lines be in the order in which they act."""
        coming_numbers = [line.number for change in self.under_way for line in change.lines]
        known = {*coming_numbers}
        self.done = [number for number in self.done if number not in known] + coming_numbers

    def past_versions(self, past: Mapping[int, PastVersion]) -> Iterator[tuple[int, PastVersion]]:
        """The past versions that the order of effect changes, by number: gains may act before
        lines that were typed earlier, and `undo` must restore what was heard.
        """
        for pending_change in self.under_way:
            old_version = pending_change.before.version
            for waiting_line, faders in zip(
                pending_change.lines,
                faders_after(old_version, pending_change.lines),
                strict=True,
            ):
                known_version = past.get(waiting_line.number)
                if known_version is None:
                    continue
                version_after = known_version
                if pending_change.is_gains:
                    version_after = PastVersion.from_version(
                        old_version, known_version.where, known_version.line
                    )
                version_after = replace(version_after, number=known_version.number, faders=faders)
                if version_after != known_version:
                    yield waiting_line.number, version_after

    def withdraw(self, first_frame: int) -> Returned:
        """Take back the changes from a frame on that were not made yet."""
        staged = (i for i, change in enumerate(self.under_way) if not change.is_gains)
        change_index = next((i for i in staged if self.under_way[i].frame >= first_frame), None)
        if change_index is None:
            return Returned((), self.running)
        self._engine.revoke(first_frame)
        return self._take_back(change_index)

    def _take_back(self, first_index: int) -> Returned:
        """Take back all changes from an index on. Gains are sent again, because they need no new
        version, except those of parts that only the withdrawn changes add.
        """
        changes_after = self.under_way[first_index:]
        del self.under_way[first_index:]
        self.running = base_version = changes_after[0].before
        returned_lines: list[WaitingLine] = []
        gain_changes: list[UnderWay] = []
        for returned_change in changes_after:
            if returned_change.is_gains and can_move(base_version, returned_change.lines):
                gain_changes.append(returned_change)
                continue
            returned_lines += returned_change.lines
            if returned_change.is_gains:
                gain_changes.append(replace(returned_change, lines=()))
            else:
                self._withdrawn[returned_change.ticket] = returned_change
        numbers = {line.number for line in returned_lines}
        self.done = [number for number in self.done if number not in numbers]
        self._follow(base_version, gain_changes)
        if gain_changes:
            self.running = self.under_way[-1].after
        return Returned(returned_lines, base_version)

    def note_late(self, ticket: int, soonest: int) -> Returned:
        """Note that a change came too late: it and those after it are not made.

        Gains are sent again for the frame `soonest`.
        """
        self._withdrawn.pop(ticket, None)
        if ticket in self._corrections:
            self._corrections.remove(ticket)
            repeated_change = all_gains_at(soonest, self.playing_at(soonest))
            self._corrections.add(self._engine.change(repeated_change))
            return Returned((), self.running)
        tickets = [change.ticket for change in self.under_way]
        change_index = tickets.index(ticket) if ticket in tickets else None
        if change_index is None:
            return Returned((), self.running)
        if not self.under_way[change_index].is_gains:
            return self._take_back(change_index)
        late_change, later = self.under_way[change_index], self.under_way[change_index + 1 :]
        del self.under_way[change_index:]
        self._follow(late_change.before, later)
        self._send_gains(
            self.ready_frame(soonest, late_change.lines), late_change.lines, late_change.number
        )
        return Returned((), self.running)

    def note_done(self, engine_event: EngineEvent) -> UnderWay | None:
        """Note that a change was made; returns it. None if the ticket is not known."""
        self._corrections.discard(engine_event.ticket or 0)
        for index, change in enumerate(self.under_way):
            if change.ticket == engine_event.ticket:
                return self.under_way.pop(index)
        withdrawn = self._withdrawn.pop(engine_event.ticket or 0, None)
        if withdrawn is not None:  # the change was made before its withdrawal
            self.done += [line.number for line in withdrawn.lines]
            later, self.under_way = self.under_way, []
            self.running = withdrawn.after
            self._follow(withdrawn.after, later)
            if later:
                self.running = self.under_way[-1].after
            self._sort_done()
        return withdrawn


def _with_faders_of(running: RunningVersion, last_running: RunningVersion) -> RunningVersion:
    """A running version with the faders, and the last line, of another one."""
    number, line = last_running.version.number, last_running.version.line
    version = replace(running.version, faders=last_running.version.faders, number=number, line=line)
    return replace(running, version=version)
