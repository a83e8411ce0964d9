"""The log of a session: its journal, its messages to the player, and its history.

It turns what the schedule reports and what the engine did into events of the journal and
sentences.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ergon.live.display import force_sentence
from ergon.repl.session.journal_content import effect_fields, text_fields
from ergon.repl.session.reports import (
    LineDropped,
    LineMoved,
    LinesDone,
    LinesSlipped,
    LineSuperseded,
    Report,
    TimelineFailed,
)
from ergon.repl.session.version import Version, first_line
from ergon.scores.edits import merging

if TYPE_CHECKING:
    from ergon.repl.session.history import History
    from ergon.repl.session.journal import Journal
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule
    from ergon.repl.session.waiting_lines import WaitingLine
    from ergon.scores.edits.merging import ValuePlace
    from ergon.scores.edits.texts import Texts

_UNREPORTED_DELAY_MAX = 1.0  # [s] by which a line that acts now may be late without a message
_VERSIONS_SEARCHED = 200  # latest lines that are searched for the one that a reload discards


class SessionLog:
    """Events of the journal, messages, and the history of a schedule's lines."""

    def __init__(self, schedule: Schedule, history: History, journal: Journal | None) -> None:
        """Begin without messages."""
        self.journal = journal
        self._schedule, self._history = schedule, history
        self._messages: deque[str] = deque(maxlen=1000)
        # By player, the share of force that was reported last.
        self._reported_scales: dict[str, float] = {}
        self._frozen_names = {part.name for part in schedule.running.frozen}
        # By kind of trouble: what was reported last, and at which frame.
        self._shown_troubles: dict[str, tuple[str, float]] = {}
        # By the number of a waiting line that read files: what the journal has of its version.
        self._journal_texts: dict[int, tuple[Texts, dict[str, object]]] = {}

    def say(self, message: str) -> None:
        """Add a message."""
        self._messages.append(message)

    def pop_messages(self) -> Sequence[str]:
        """Messages since the last call."""
        messages = []
        while self._messages:
            messages.append(self._messages.popleft())
        return messages

    def write(self, event_name: str, **fields: Any) -> None:
        """Write an event to the journal."""
        if self.journal is not None:
            self.journal.append(event_name, **fields)

    def note_read(self, number: int, version: Version) -> None:
        """Note that the journal has the texts of a line's version, which read files."""
        self._journal_texts[number] = version.texts, effect_fields(version)

    def position_at(self, frame: int) -> str:
        """The position of the piece at a frame, as `bar|beat`."""
        running = self._schedule.running
        return running.version.piece.tempo_map.written(running.beat(frame))

    # --- reports ---------------------------------------------------------------------------------

    def take_reports(self) -> None:
        """Write down what the schedule has reported, in its order."""
        reports = self._schedule.reports
        if not reports:
            return
        while reports:
            self._note_report(reports.popleft())
        self._history.sort(self._schedule.effect_order())

    def _note_report(self, report: Report) -> None:
        match report:
            case LineMoved(waiting_line):
                self._note_moved(waiting_line)
            case LinesSlipped(group_lines):
                self._note_slipped(group_lines)
            case LineDropped(waiting_line, reason):
                self.say(
                    f"line {waiting_line.number} '{first_line(waiting_line.line)}' could not take "
                    f"effect and is dropped: {reason}"
                )
                self.note_dropped(waiting_line)
            case LineSuperseded(waiting_line):
                self.note_dropped(waiting_line)
            case LinesDone(frame, change, group_lines, running_after):
                self._note_done(frame, change, group_lines, running_after)
            case TimelineFailed(sentence):
                self.say(sentence)

    def _note_moved(self, line: WaitingLine) -> None:
        fields = {} if line.start_frame is None else {"start": line.start_frame}
        self.write("late", number=line.number, beat=line.beat, **fields)

    def _note_slipped(self, lines: Sequence[WaitingLine]) -> None:
        schedule = self._schedule
        typed_lines = [line for line in lines if line.line]
        if not typed_lines:
            return
        first_slipped, *lines_after = typed_lines
        assert first_slipped.start_frame is not None
        delay = (first_slipped.start_frame - schedule.engine.frame) / schedule.rate
        is_soon = first_slipped.is_now or not schedule.running.clock.is_running
        if is_soon and delay <= _UNREPORTED_DELAY_MAX:
            return
        delay_text = f"in {delay:.1f} s" if is_soon else "at the next bar"
        others_text = f", together with {len(lines_after)} typed after it" if lines_after else ""
        self.say(
            f"'{first_line(first_slipped.line)}' was not ready in time; it takes effect "
            f"{delay_text}{others_text}"
        )

    def note_dropped(self, line: WaitingLine) -> None:
        """Note that a line will not take effect."""
        self._history.remove(line.number)
        self._journal_texts.pop(line.number, None)
        self.write("dropped", number=line.number)

    def _note_done(
        self,
        done_frame: int,
        change: int,
        done_lines: Sequence[WaitingLine],
        running_after: RunningVersion,
    ) -> None:
        """Note which lines took effect at a frame, and what was skipped before it."""
        if running_after.skipped_from is not None:
            self._note_skip(done_frame, running_after)
        for done_line in done_lines:
            # If the line read files, its texts were merged with the version that now takes effect.
            text_values: dict[str, object] = {}
            if done_line.reads_files:
                version = done_line.result()
                effect_values = effect_fields(version)
                if self._journal_texts.pop(done_line.number, None) != (
                    version.texts,
                    effect_values,
                ):
                    text_values = {**text_fields(version.texts), **effect_values}
            self.write(
                "commit",
                number=done_line.number,
                frame=done_frame,
                beat=done_line.beat,
                change=change,
                **text_values,
            )
        if done_lines and not self._schedule.waiting:
            self._messages += [
                f"{self.position_at(done_frame)} {sentence}"
                for sentence in self.force_messages(running_after)
            ]

    def _note_skip(self, engine_frame: int, running_after: RunningVersion) -> None:
        skip_begin = running_after.skipped_from
        assert skip_begin is not None
        skip_end = running_after.beat(engine_frame)
        self.write("skip", frame=engine_frame, begin=skip_begin, end=skip_end)
        tempo_map = running_after.version.piece.tempo_map
        self.say(
            "the program was suspended, or the machine was too busy: what was to begin from "
            f"{tempo_map.written(skip_begin)} to {tempo_map.written(skip_end)} was skipped"
        )

    # --- sentences -------------------------------------------------------------------------------

    def force_messages(self, running: RunningVersion) -> list[str]:
        """Messages about the share of force that real hands get, where it has changed."""
        changed_bounds = [
            bound
            for bound in running.force_bounds
            if self._reported_scales.get(bound.player, 1.0) != bound.last_scale.scale
        ]
        self._reported_scales |= {bound.player: bound.last_scale.scale for bound in changed_bounds}
        return [force_sentence(bound) for bound in changed_bounds]

    def note_thawed(self, running: RunningVersion) -> None:
        """Report which frozen parts are computed live from a version on."""
        frozen_names = {part.name for part in running.frozen}
        thawed_names = [
            running.version.sounds_as.shown_name(name, running.version.piece.instruments)
            for name in sorted(self._frozen_names - frozen_names)
            if name in running.version.sounding.instruments
        ]
        self._frozen_names = frozen_names
        if thawed_names:
            verb, start_verb = ("is", "starts") if len(thawed_names) == 1 else ("are", "start")
            self.say(
                f"from this line on {', '.join(thawed_names)} {verb} computed live and "
                f"{start_verb} "
                "at rest, "
                "because the line changes what was frozen"
            )

    def discard_messages(self, version: Version) -> list[str]:
        """Messages about typed values that were replaced by those of the files."""
        messages = []
        for place in version.discarded_places:
            typed_line = self._line_that_changed(place)
            typed_text = f"'{first_line(typed_line)}'" if typed_line else "what was typed"
            messages.append(
                f"{place} was changed by {typed_text} and in the file; the value in the file "
                "is kept, "
                "and the line is discarded"
            )
        return messages

    def _line_that_changed(self, place: ValuePlace) -> str:
        """The last earlier line that changed a place; empty if none is found."""
        history, versions = self._history, self._schedule.past_versions
        past_versions = [versions[n] for n in history.numbers[: history.index]]
        for version_before, version_after in itertools.pairwise(
            reversed(past_versions[-_VERSIONS_SEARCHED:])
        ):
            if merging.is_different(version_before.texts, version_after.texts, place):
                return version_before.line
        return ""

    def note_troubles(self, troubles: Sequence[str], engine_frame: int) -> None:
        """Report each new trouble of the engine; a count that rises, at most once per second of
        sound.
        """
        rate = self._schedule.rate
        for trouble in troubles:
            trouble_kind = trouble.rstrip("0123456789")
            last_trouble, shown_frame = self._shown_troubles.get(trouble_kind, ("", -rate))
            if trouble != last_trouble and engine_frame >= shown_frame + rate:
                self._shown_troubles[trouble_kind] = trouble, engine_frame
                self.say(f"{self.position_at(engine_frame)} {trouble}")
