"""Blocks that run by themselves: each run is queued shortly before its beat."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.repl.language.block_values import TICK_NAME, has_tick
from ergon.repl.language.blocks import RunBlock
from ergon.repl.session import version_edits
from ergon.repl.session.entry import Entry
from ergon.repl.session.waiting_lines import REFUSALS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from ergon.repl.session.block_rules import Rule
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.session_log import SessionLog
    from ergon.repl.session.waiting_lines import WaitingLine

_QUEUE_LEAD = 1.0  # [s] before its beat a run is queued
_PAUSE_MIN = 0.25  # [s] at least between two runs of a block


class BlockRuns:
    """The queued runs by the number of their line, and the last run of each block."""

    def __init__(
        self,
        schedule: Schedule,
        log: SessionLog,
        queue_line: Callable[[Entry], tuple[str, RunningVersion]],
        drop_line: Callable[[WaitingLine], None],
    ) -> None:
        """Begin without queued runs; `queue_line` lets a line wait for its frame, `drop_line`
        removes it.
        """
        self._schedule = schedule
        self._log = log
        self._queue_line = queue_line
        self._drop_line = drop_line
        self._waiting_runs: dict[int, tuple[str, Rule]] = {}
        self._last_run_beats: dict[str, float] = {}
        self._last_turn_beat = 0.0  # the beat of the last turn
        self._refused_names: set[str] = set()

    def queue_due_runs(self) -> None:
        """Queue runs that are due, and drop those whose rule no longer holds."""
        schedule = self._schedule
        named_rules = {(name, rule) for name, rule in self._active_rules()}
        if not named_rules and not self._waiting_runs:
            return
        is_running, beat_now = schedule.running.clock.is_running, schedule.beat_now()
        has_jumped = beat_now < self._last_turn_beat - SAME
        self._last_turn_beat = beat_now
        if has_jumped or not is_running:
            self._last_run_beats.clear()
        for waiting_line in [
            line for line in schedule.waiting if line.number in self._waiting_runs
        ]:
            block_name, rule = self._waiting_runs[waiting_line.number]
            if (
                has_jumped
                or not is_running
                or not self._is_in_force(block_name, rule, waiting_line.beat)
            ):
                self._drop_line(waiting_line)
        waiting_numbers = {line.number for line in schedule.waiting}
        for number in self._waiting_runs.keys() - waiting_numbers:
            del self._waiting_runs[number]
            schedule.past_versions.pop(number, None)  # `undo` returns to typed lines alone
        if is_running:
            for block_name, rule in sorted(named_rules, key=lambda named_rule: named_rule[0]):
                self._queue_next(block_name, rule)

    def _active_rules(self) -> Iterator[tuple[str, Rule]]:
        """The rules of the running version and of all waiting ones."""
        schedule = self._schedule
        yield from schedule.running.version.rules.items()
        for line in schedule.waiting:
            yield from line.result().rules.items()

    def _is_in_force(self, name: str, rule: Rule, beat: float) -> bool:
        return self._schedule.lines.version_at(beat).rules.get(name) == rule

    def _queue_next(self, block_name: str, rule: Rule) -> None:
        """Queue the next run of a block if it is due and not yet queued."""
        schedule = self._schedule
        tempo, clock = schedule.head.piece.tempo_map, schedule.running.clock
        soonest_seconds = schedule.soonest_frame() / schedule.rate + schedule.timing.takeover_lead
        first_beat, latest_beat = (
            clock.beat(tempo, seconds)
            for seconds in (soonest_seconds, soonest_seconds + _QUEUE_LEAD)
        )
        earliest_beat = max(first_beat - 2.0 * SAME, rule.begin_beat)
        if (last_run_beat := self._last_run_beats.get(block_name)) is not None:
            earliest_beat = max(
                earliest_beat,
                last_run_beat,
                tempo.beats(tempo.seconds(last_run_beat) + _PAUSE_MIN) - 2.0 * SAME,
            )
        run_beat = rule.trigger.next_beat(tempo, rule.begin_beat, earliest_beat, latest_beat)
        if run_beat is None or not self._is_in_force(block_name, rule, run_beat):
            return
        self._last_run_beats[block_name] = run_beat
        run_position = Position(plus=Length(beats=run_beat))
        tick_values: tuple[str, ...] = ()
        if has_tick(schedule.head.piece.blocks.get(block_name, ())):
            tick_values = (
                f"{TICK_NAME}={rule.trigger.run_count(tempo, rule.begin_beat, run_beat)}",
            )
        run_line = " ".join(("run", block_name, *tick_values))
        try:
            edit = version_edits.combine_edits([RunBlock(block_name, tick_values)])
            _, queued_version = self._queue_line(
                Entry(run_line, edit, when=run_position, is_typed=False)
            )
        except REFUSALS as error:
            if block_name not in self._refused_names:  # once, and not for each bar
                self._refused_names.add(block_name)
                self._log.say(f"{block_name} cannot run: {error}")
            return
        self._refused_names.discard(block_name)
        self._waiting_runs[queued_version.version.number] = block_name, rule
