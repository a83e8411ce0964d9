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
    can_move_faders,
    changed_ratios,
    fader_ratios,
    faders_after,
    gains_at,
    with_faders,
    with_known_faders,
    with_rebased_faders,
)
from ergon.repl.session.version import PastVersion

if TYPE_CHECKING:
    from ergon.repl.session.engine import Change, Engine, EngineEvent
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


@dataclass(frozen=True, slots=True)
class PendingChange:
    """A change that was sent to the engine: its frame, the lines in it, and the versions around it.

    `gains` are the ratios that the engine sets at its frame.
    """

    ticket: int
    number: int
    frame: int
    lines: Sequence[WaitingLine]
    running_before: RunningVersion
    running_after: RunningVersion
    gains: Mapping[int, float] = field(default_factory=dict)

    @property
    def is_gain_change(self) -> bool:
        """Whether it changes gains alone."""
        return self.running_after.stage is self.running_before.stage


class Withdrawal(NamedTuple):
    """Lines of changes that were not made, and the version before them."""

    lines: Sequence[WaitingLine]
    running_before: RunningVersion


class Changes:
    """Changes in the order in which they act.

    `running` is the version after all of them, `done_numbers` has the numbers of their lines.
    """

    def __init__(self, engine: Engine, running: RunningVersion) -> None:
        """Begin with a version that plays."""
        self.running = running
        self.pending: list[PendingChange] = []
        self.done_numbers: list[int] = []
        self._engine = engine
        self._n_sent = 0
        # Changes that were taken back; one that was made before it could be is put back.
        self._withdrawn: dict[int, PendingChange] = {}
        # Tickets of gains that were sent again, because they were no longer right.
        self._corrections: set[int] = set()

    @property
    def playing(self) -> RunningVersion:
        """What the engine plays now."""
        return self.pending[0].running_before if self.pending else self.running

    def running_at(self, frame: int) -> RunningVersion:
        """What the engine will play at a frame."""
        done_changes = [change for change in self.pending if change.frame <= frame]
        return done_changes[-1].running_after if done_changes else self.playing

    def send(
        self, change: Change, lines: Sequence[WaitingLine], running_after: RunningVersion
    ) -> None:
        """Send a change, after which the version `running_after` plays, made of the running
        version.

        Raises EngineError.
        """
        old_version = self.running
        is_last = all(pending_change.frame <= change.frame for pending_change in self.pending)
        if not is_last:  # gains that act later are under way
            old_version = self.running_at(change.frame)
            running_after = with_rebased_faders(running_after, old_version.version, lines)
            if lines:
                change = replace(change, gains=changed_ratios(old_version, running_after))
        ticket = self._engine.change(change)
        self._n_sent += 1
        pending_change = PendingChange(
            ticket,
            self._n_sent,
            change.frame,
            tuple(lines),
            old_version,
            running_after,
            change.gains,
        )
        self.done_numbers += [line.number for line in lines]
        self._insert(pending_change)
        if is_last:
            self.running = running_after
        else:
            self.running = _with_faders_of(running_after, self.pending[-1].running_after)

    def send_gains(self, from_frame: int, waiting_lines: Sequence[WaitingLine]) -> None:
        """Send the gains that lines change, for a frame that may come before changes under way.

        Raises EngineError, or one of `REFUSALS` if there is not what they name.
        """
        start_frame = self.ready_frame(from_frame, waiting_lines)
        with_faders(self.running_at(start_frame), waiting_lines)
        self._n_sent += 1
        self._send_gains(start_frame, waiting_lines, self._n_sent)
        self.done_numbers += [line.number for line in waiting_lines]
        self._sort_done_numbers()

    def ready_frame(self, first_frame: int, waiting_lines: Sequence[WaitingLine]) -> int:
        """The first frame from `first_frame` on that has all strikes and routes that lines fade."""
        if can_move_faders(self.running_at(first_frame), waiting_lines):
            return first_frame
        later_changes = (change for change in self.pending if change.frame > first_frame)
        return next(
            (
                change.frame
                for change in later_changes
                if can_move_faders(change.running_after, waiting_lines)
            ),
            first_frame,
        )

    def _send_gains(
        self, change_frame: int, waiting_lines: Sequence[WaitingLine], change_number: int
    ) -> None:
        running = self.running_at(change_frame)
        running_after = with_known_faders(running, waiting_lines)
        gains = changed_ratios(running, running_after)
        ticket = self._engine.change(gains_at(change_frame, running_after, gains))
        self._insert(
            PendingChange(
                ticket,
                change_number,
                change_frame,
                tuple(waiting_lines),
                running,
                running_after,
                gains,
            )
        )
        self.running = _with_faders_of(self.running, self.pending[-1].running_after)

    def _insert(self, pending_change: PendingChange) -> None:
        """Insert a change behind those that act before it or at its frame."""
        insertion_index = sum(change.frame <= pending_change.frame for change in self.pending)
        later_changes = self.pending[insertion_index:]
        self.pending[insertion_index:] = [pending_change]
        self._append_following(pending_change.running_after, later_changes)
        self._sort_done_numbers()

    def _append_following(
        self, running_before: RunningVersion, later_changes: Sequence[PendingChange]
    ) -> None:
        """Append changes, the first of which now follows another version."""
        for change in later_changes:
            if change.running_before is not running_before:
                change = self._rebased_change(change, running_before)
            self.pending.append(change)
            running_before = change.running_after

    def _rebased_change(
        self, change: PendingChange, running_before: RunningVersion
    ) -> PendingChange:
        """A change that follows another version; the engine gets its gains again if they differ."""
        if change.is_gain_change:
            new_running_after = with_known_faders(running_before, change.lines)
        else:
            new_running_after = with_rebased_faders(
                change.running_after, running_before.version, change.lines
            )
        ratios = fader_ratios(new_running_after)
        new_ratios = changed_ratios(running_before, new_running_after)
        gains = {group: ratios[group] for group in {*change.gains, *new_ratios} if group in ratios}
        if gains != change.gains:
            with contextlib.suppress(EngineError):  # too many changes wait
                self._corrections.add(
                    self._engine.change(gains_at(change.frame, new_running_after, gains))
                )
        return replace(
            change, running_before=running_before, running_after=new_running_after, gains=gains
        )

    def _sort_done_numbers(self) -> None:
        """Let the numbers of lines be in the order in which they act."""
        coming_numbers = [line.number for change in self.pending for line in change.lines]
        known_numbers = {*coming_numbers}
        self.done_numbers = [
            number for number in self.done_numbers if number not in known_numbers
        ] + coming_numbers

    def past_versions(
        self, past_by_number: Mapping[int, PastVersion]
    ) -> Iterator[tuple[int, PastVersion]]:
        """The past versions that the order of effect changes, by number: gains may act before
        lines that were typed earlier, and `undo` must restore what was heard.
        """
        for pending_change in self.pending:
            old_version = pending_change.running_before.version
            for waiting_line, faders in zip(
                pending_change.lines, faders_after(old_version, pending_change.lines), strict=True
            ):
                known_past_version = past_by_number.get(waiting_line.number)
                if known_past_version is None:
                    continue
                past_version = known_past_version
                if pending_change.is_gain_change:
                    past_version = PastVersion.from_version(
                        old_version, known_past_version.beat_text, known_past_version.line
                    )
                past_version = replace(
                    past_version, number=known_past_version.number, faders=faders
                )
                if past_version != known_past_version:
                    yield waiting_line.number, past_version

    def withdraw(self, first_frame: int) -> Withdrawal:
        """Take back the changes from a frame on that were not made yet."""
        staged_indices = (
            index for index, change in enumerate(self.pending) if not change.is_gain_change
        )
        change_index = next(
            (index for index in staged_indices if self.pending[index].frame >= first_frame), None
        )
        if change_index is None:
            return Withdrawal((), self.running)
        self._engine.revoke(first_frame)
        return self._withdraw_from(change_index)

    def _withdraw_from(self, first_index: int) -> Withdrawal:
        """Take back all changes from an index on. Gains are sent again, because they need no new
        version, except those of parts that only the withdrawn changes add.
        """
        changes_after = self.pending[first_index:]
        del self.pending[first_index:]
        self.running = base_version = changes_after[0].running_before
        returned_lines: list[WaitingLine] = []
        gain_changes: list[PendingChange] = []
        for returned_change in changes_after:
            if returned_change.is_gain_change and can_move_faders(
                base_version, returned_change.lines
            ):
                gain_changes.append(returned_change)
                continue
            returned_lines += returned_change.lines
            if returned_change.is_gain_change:
                gain_changes.append(replace(returned_change, lines=()))
            else:
                self._withdrawn[returned_change.ticket] = returned_change
        returned_numbers = {line.number for line in returned_lines}
        self.done_numbers = [
            number for number in self.done_numbers if number not in returned_numbers
        ]
        self._append_following(base_version, gain_changes)
        if gain_changes:
            self.running = self.pending[-1].running_after
        return Withdrawal(returned_lines, base_version)

    def note_late(self, ticket: int, soonest_frame: int) -> Withdrawal:
        """Note that a change came too late: it and those after it are not made.

        Gains are sent again for the frame `soonest_frame`.
        """
        self._withdrawn.pop(ticket, None)
        if ticket in self._corrections:
            self._corrections.remove(ticket)
            repeated_change = all_gains_at(soonest_frame, self.running_at(soonest_frame))
            self._corrections.add(self._engine.change(repeated_change))
            return Withdrawal((), self.running)
        tickets = [change.ticket for change in self.pending]
        change_index = tickets.index(ticket) if ticket in tickets else None
        if change_index is None:
            return Withdrawal((), self.running)
        if not self.pending[change_index].is_gain_change:
            return self._withdraw_from(change_index)
        late_change, later_changes = self.pending[change_index], self.pending[change_index + 1 :]
        del self.pending[change_index:]
        self._append_following(late_change.running_before, later_changes)
        self._send_gains(
            self.ready_frame(soonest_frame, late_change.lines),
            late_change.lines,
            late_change.number,
        )
        return Withdrawal((), self.running)

    def note_done(self, engine_event: EngineEvent) -> PendingChange | None:
        """Note that a change was made; returns it. None if the ticket is not known."""
        self._corrections.discard(engine_event.ticket or 0)
        for index, change in enumerate(self.pending):
            if change.ticket == engine_event.ticket:
                return self.pending.pop(index)
        withdrawn_change = self._withdrawn.pop(engine_event.ticket or 0, None)
        if withdrawn_change is not None:  # the change was made before its withdrawal
            self.done_numbers += [line.number for line in withdrawn_change.lines]
            later_changes, self.pending = self.pending, []
            self.running = withdrawn_change.running_after
            self._append_following(withdrawn_change.running_after, later_changes)
            if later_changes:
                self.running = self.pending[-1].running_after
            self._sort_done_numbers()
        return withdrawn_change


def _with_faders_of(running: RunningVersion, last_running: RunningVersion) -> RunningVersion:
    """A running version with the faders, and the last line, of another one."""
    number, line = last_running.version.number, last_running.version.line
    version = replace(running.version, faders=last_running.version.faders, number=number, line=line)
    return replace(running, version=version)
