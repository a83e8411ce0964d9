"""The core of a session, on which commands act: its schedule, log, files and inputs."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from ergon.notation.clock.positions import Length, Position
from ergon.notation.text.errors import quote
from ergon.repl.language.blocks import DefineBlock
from ergon.repl.language.commands import NOW, Command, Sync, When
from ergon.repl.language.recording import Guide
from ergon.repl.language.scope import scope_of
from ergon.repl.session import computing, inspection, version_edits
from ergon.repl.session.acts import Acts
from ergon.repl.session.block_runs import BlockRuns
from ergon.repl.session.captures import Capture, Captures
from ergon.repl.session.clock import Clock
from ergon.repl.session.disk import Disk, folder_of
from ergon.repl.session.drafting import Draft, Request
from ergon.repl.session.entry import Entry
from ergon.repl.session.fast_values import FastValues
from ergon.repl.session.gains import fader_ratios
from ergon.repl.session.guidance import Guidance, check_guide
from ergon.repl.session.hearing import Hearing
from ergon.repl.session.history import History, PastVersions
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import effect_fields, text_fields
from ergon.repl.session.line_kinds import kind_of
from ergon.repl.session.midi_input import MidiInput
from ergon.repl.session.running import RunningVersion, stage_first
from ergon.repl.session.schedule import Schedule
from ergon.repl.session.session_log import SessionLog
from ergon.repl.session.sound_file import SoundFile
from ergon.repl.session.stops import Stops
from ergon.repl.session.syncing import next_beginning
from ergon.repl.session.version import NotTakenError, PastVersion, Version
from ergon.repl.session.waiting_lines import REFUSALS, WaitingLine
from ergon.repl.session.watch import FileWatch
from ergon.repl.session_protocol import Reply

if TYPE_CHECKING:
    from ergon.repl.language.scope import Scope
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.frozen_parts import LoadedPart
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import RealHands
    from ergon.scores.staging.planning import TrialStore
    from ergon.scores.staging.stage import Stage

_BAR_DURATION = Length(bars=1.0)
_DRAWING_INTERVAL = 0.5  # [s] between two drawings of a key that is traced: one takes 15 ms
_TRACE_HEIGHT = 6  # characters
_TRIES_MAX = 3  # times that a line which acts now is made again before its answer


class Closable(Protocol):
    """Something that stays open as long as the session: a port, a socket."""

    def close(self) -> None:
        """Close it."""


class SessionCore:
    """A session without its prompt: versions of a score that take over from one another as they
    play.
    """

    def __init__(
        self,
        version: Version,
        make_engine: Callable[[Stage], Engine],
        *,
        margin: float,
        journal: Journal | None = None,
        real: RealHands | None = None,
        store: TrialStore | None = None,
        clock: Clock | None = None,
        hands: Path | None = None,
        disk: Disk | None = None,
        watches: bool = False,
        past: PastVersions | None = None,
        frozen: tuple[LoadedPart, ...] = (),
        is_seen: bool = False,
        driven_players: Collection[str] = (),
    ) -> None:
        """Begin with a version whose piece is stopped; `make_engine` makes an engine for its stage.

        `margin` [s] is the time in which a change reaches the engine; `hands` is the engine's
        recording of real hands; `disk` has the known hashes if files on the disk differ from the
        version. A session that `watches` reloads the score when it is saved elsewhere. `past` is
        the history of a resumed session, whose version 0 is `version`. `frozen` parts are played
        from their samples until the score changes them. If it `is_seen`, parts that are not
        heard are computed too. Written parts move the real keys of `driven_players` players.
        """
        version = replace(version, file_texts=version.file_texts or version.texts)
        running = stage_first(version, clock or Clock(), real or {}, store, frozen, is_seen=is_seen)
        engine = make_engine(running.stage)
        bounds = engine.force_bounds(running.stage, running.start_frame, (), ())
        running = replace(running, force_bounds=bounds)
        engine.set_faders(fader_ratios(running))
        past = past or PastVersions([PastVersion.from_version(version, "1|1")], 0)
        self.schedule = Schedule(
            engine, running, real or {}, int(margin * running.stage.rate), store
        )
        self.schedule.past_versions.update(
            (past_version.number, past_version) for past_version in past.versions
        )
        self.history = History([past_version.number for past_version in past.versions], past.index)
        self.journal = journal
        self.log = SessionLog(self.schedule, self.history, journal)
        self.quant: Length | None = _BAR_DURATION
        self.quant_text = "bar"
        # Lines that `undo` took back before they took effect.
        self.cancelled_lines: list[WaitingLine] = []
        self.captures = Captures(hands)
        self.sound_file = SoundFile()
        self.guidance = Guidance(self.schedule, frozenset(driven_players))
        self.computing = computing.Computations()
        self.file_watch = FileWatch(version.texts) if watches else None
        self.stops = Stops(self.schedule, self.computing, self.log, self.queue, self.drop)
        self.fast_values = FastValues(
            self.schedule, self.history, self.log, self.queue, lambda: self.scope
        )
        self.block_runs = BlockRuns(self.schedule, self.log, self.queue, self.drop)
        self.acts = Acts(self.log.write)
        self.midi = MidiInput(self.schedule, self.acts, self.fast_values, self.stops, self.say)
        self.hearing = Hearing(self.schedule, self.acts, self.stops, self.queue)
        self.tap_instants: list[float] = []
        self.traced_player: str | None = None  # player whose key is drawn while it moves
        self.drawing: tuple[str, ...] = ()
        self._drawn_frame = 0  # the frame of that drawing
        self.disk = disk or Disk.from_texts(version.texts)
        self.is_over = False  # nothing more is played or written
        self._n_lines = 0
        self._scope = scope_of(version.piece, folder_of(version.texts))
        self._scope_piece = version.piece
        for message in self.log.force_messages(running):
            self.log.say(message)

    @property
    def lock(self) -> contextlib.AbstractContextManager[bool]:
        """The lock of the schedule, which is never held for long."""
        return self.schedule.lock

    @property
    def scope(self) -> Scope:
        """The names that a line may use now: also those that waiting lines define."""
        latest_running = self.schedule.head
        if latest_running.piece is not self._scope_piece:
            scope = scope_of(latest_running.piece, folder_of(latest_running.texts))
            self._scope, self._scope_piece = scope, latest_running.piece
            return scope
        return self._scope

    def say(self, message: str) -> None:
        """Add a message."""
        self.log.say(message)

    def release(self) -> None:
        """Switch sound and force on again, after a panic or `let_go`."""
        self.stops.release()
        self.log.write("release", frame=self.schedule.engine.frame)

    def make_version(self, line_text: str, commands: Sequence[Command]) -> Reply:
        """Make a version by the edits of commands, and queue it."""
        for command in commands:
            if isinstance(command, Guide):
                check_guide(command, self.schedule, self.guidance.driven_players)
        line_time: When = next(
            (typed_command.when for typed_command in commands if typed_command.when is not None),
            None,
        )
        if line_time is None and all(isinstance(command, DefineBlock) for command in commands):
            line_time = NOW  # nothing is heard of it
        reads_files = any(type(command) in version_edits.READS_FILES for command in commands)
        edit = version_edits.combine_edits(commands)
        kind = kind_of(commands, has_strike_levels=bool(self.schedule.head.strike_levels))
        beat_text, queued_version = self.queue(
            Entry(line_text, edit, kind, line_time, reads_files=reads_files)
        )
        summaries = [
            version_edits.command_summary(command, queued_version, beat_text)
            for command in commands
        ]
        summaries += self.log.force_messages(queued_version)
        summaries += self.log.discard_messages(queued_version.version)
        return Reply(True, f"ok {beat_text} {'; '.join(filter(None, summaries))}".rstrip())

    def queue(self, entry: Entry) -> tuple[str, RunningVersion]:
        """Queue a line for its frame; returns its beat as written, and its version, staged.

        Raises one of `REFUSALS`, and nothing has changed.
        """
        entry = replace(entry, when=self.resolved_time(entry.when))
        if self.journal is not None and self.journal.is_full and not entry.is_stop:
            raise NotTakenError("the journal keeps no further line: make room on the disk")
        with self.schedule.lock:
            self._n_lines += 1
            line_number = self._n_lines

        request = Request(entry, line_number, self.quant, self.schedule.n_drops)
        with self.computing.limited(entry.step_limit):
            draft = self.schedule.insert(request, lambda draft: self._note_line(entry, draft))
        self.log.note_thawed(draft.checked_version)
        self.hand_over_due()
        for _ in range(_TRIES_MAX):  # a late line must be made again
            if not self._is_due(line_number) or not self.schedule.make_due():
                break
            self.hand_over_due()
        line = self.schedule.line(line_number) or draft.drafted_line
        return line.result().piece.tempo_map.written(line.beat), draft.checked_version

    def resolved_time(self, when: When) -> When:
        """When a line acts; `sync d1` as the beat that it means now. Raises NotTakenError."""
        if not isinstance(when, Sync):
            return when
        voice_names = (*self.scope.strikes, *self.scope.players)
        if when.name not in voice_names:
            known_names = f"; there are only {', '.join(voice_names)}" if voice_names else ""
            message = f"{quote(when.name)} is not the name of strikes, or a player{known_names}"
            raise NotTakenError(message)
        soonest_beat, _ = self.schedule.place(NOW, None)
        beat = next_beginning(self.schedule.head.piece, when.name, soonest_beat)
        return Position(plus=Length(beats=beat))

    def _is_due(self, number: int) -> bool:
        """Whether a line still waits that should act as soon as possible."""
        return any(
            waiting_line.number == number and waiting_line.is_now
            for waiting_line in self.schedule.waiting
        )

    def _note_line(self, entry: Entry, draft: Draft) -> None:
        """Note a line that waits from now on in journal and history."""
        waiting_line, version = draft.drafted_line, draft.drafted_line.result()
        optional_fields: dict[str, object] = {}
        if entry.replaced_number is not None:
            optional_fields["replaces"] = entry.replaced_number
        if not entry.is_typed:
            optional_fields["typed"] = False
        if waiting_line.start_frame is not None:
            optional_fields["start"] = waiting_line.start_frame
        if entry.reads_files:
            optional_fields |= self._read_fields(version)
            self.log.note_read(waiting_line.number, version)
        self.log.write(
            "line",
            number=waiting_line.number,
            line=waiting_line.line,
            kind=waiting_line.kind.name.lower(),
            beat=waiting_line.beat,
            goes=entry.sets_running,
            resets=entry.resets,
            restores=entry.restored_line_number,
            where=version.piece.tempo_map.written(waiting_line.beat),
            **optional_fields,
        )
        if entry.restored_line_number is None and entry.is_typed:
            self.history.add(waiting_line.number)
            if entry.replaced_number is not None:
                self.history.remove(entry.replaced_number)
                self.schedule.past_versions.pop(entry.replaced_number, None)
            if not entry.is_redo:
                self.cancelled_lines.clear()
            self.history.sort(self.schedule.effect_order())

    def _read_fields(self, version: Version) -> dict[str, object]:
        disk_fields: dict[str, object] = {}
        if version.read_texts is not None:
            self.disk.note_read(version.read_texts)
            disk_fields["base"] = text_fields(version.read_texts)
            if self.file_watch is not None:
                self.file_watch.watch_texts(version.read_texts)
        if version.read_files and version.file_texts is not None:
            self.disk.note_written(version.read_files)
            disk_fields["base"] = text_fields(version.file_texts)
            if self.file_watch is not None:
                self.file_watch.watch_texts(version.texts)
        disk_fields["disk"] = self.disk.hashes_by_name(version.texts)
        return {**text_fields(version.texts), **disk_fields, **effect_fields(version)}

    def drop(self, line: WaitingLine) -> None:
        """Remove a line that has not taken effect."""
        with self.schedule.lock:
            self.schedule.drop(line.number)
            self.log.note_dropped(line)
            self.log.take_reports()

    def note_written(self, texts: Texts, *, is_own: bool) -> None:
        """Note that files were written: those of the score itself (`is_own`), or copies."""
        base_fields = {"base": text_fields(texts)} if is_own else {}
        disk_hashes = self.disk.hashes_by_name(texts)
        self.log.write("saved", score=texts.path, disk=disk_hashes, **base_fields)
        if is_own:
            self.schedule.rebase(texts)
        if self.file_watch is not None:
            self.file_watch.has_changed()  # the session itself wrote them

    def position_text(self, beat: float) -> str:
        """A beat of the piece as `bar|beat`."""
        return self.schedule.head.piece.tempo_map.written(beat)

    # --- what goes on by itself ------------------------------------------------------------------

    def hand_over_due(self) -> None:
        """Hand to the engine what is due, and write down what it did; nothing is made here."""
        schedule = self.schedule
        with schedule.lock:
            if self.is_over:
                return
            self._take_events()
            schedule.hand_over()
            self.hearing.strike_ready()
            self.log.take_reports()
            self._report_sound_file()
            for line in self.midi.monitor.due_lines(schedule.engine.frame / schedule.rate):
                self.log.say(line)
            if self.journal is not None and (journal_error := self.journal.pop_failure()):
                self.log.say(journal_error)
            self.log.note_troubles(schedule.engine.status().troubles, schedule.engine.frame)

    def make_due(self) -> None:
        """Make what will be due soon: waiting lines, and those that come by themselves."""
        if self.schedule.make_due():
            self.hand_over_due()
        self.fast_values.set_due()
        if not self.stops.panicked:
            self.block_runs.queue_due_runs()
        if (capture := self.captures.pop_ready(self.schedule)) is not None:
            self._add_take(capture)
        frame = self.schedule.engine.frame
        if (
            self.traced_player is not None
            and frame >= self._drawn_frame + _DRAWING_INTERVAL * self.schedule.rate
        ):
            self.draw_trace()

    def extend_timeline(self) -> None:
        """Extend the timeline before it ends."""
        if self.schedule.extend():
            self.hand_over_due()

    def do_once(self) -> None:
        """Do once what the session's threads do over and over."""
        self.hand_over_due()
        self.extend_timeline()
        self.make_due()
        self.hand_over_due()

    def draw_trace(self) -> None:
        """Draw the traced key, if there is one."""
        engine, running = self.schedule.engine, self.schedule.running
        self._drawn_frame, self.drawing = engine.frame, ()
        if self.traced_player is not None:
            with contextlib.suppress(NotTakenError):  # the player is gone, or has not moved yet
                trace_arguments = (
                    self.traced_player,
                    engine.tick_frames,
                    self.captures.hands_recording,
                )
                trace_lines = inspection.draw_trace(
                    running, engine.frame, *trace_arguments, height=_TRACE_HEIGHT
                )
                self.drawing = tuple(trace_lines)

    def _take_events(self) -> None:
        """Take the engine's events, and write at once to the journal what happened."""
        schedule = self.schedule
        for engine_event in schedule.engine.events():
            if engine_event.act_ticket is not None:
                self.acts.note_ended(engine_event)
                continue
            for player, is_real in engine_event.is_real_by_player.items():
                self.log.write("hand", player=player, real=is_real, frame=engine_event.frame)
            if engine_event.sentence:
                self.log.say(f"{self.log.position_at(engine_event.frame)} {engine_event.sentence}")
            elif engine_event.ticket is not None:
                if engine_event.is_late:
                    self.guidance.note_late(engine_event.ticket)
                schedule.note_event(engine_event)
                self.log.take_reports()
        for frame, begins in schedule.engine.silences():
            self.log.write("silence", frame=frame, begins=begins)

    def _add_take(self, capture: Capture) -> None:
        """Write the file of a take that has ended, and add the take to the score."""
        folder = Path(self.schedule.head.texts.path).parent
        try:
            take_path = self.captures.write(capture, folder, self.schedule.engine.tick_frames)
            take_file = take_path.relative_to(folder).as_posix()

            def edit(version: Version, beat: float) -> Version:
                return version_edits.with_take(version, capture.name, take_file, capture.player)

            self.queue(Entry(f"# take {capture.name}", edit, when=NOW, reads_files=True))
        except (NotTakenError, *REFUSALS) as error:
            self.log.say(str(error))
            return
        assert capture.stop_frame is not None
        duration = (capture.stop_frame - capture.start_frame) / self.schedule.rate
        missing_seconds = capture.n_missing * self.schedule.engine.tick_frames / self.schedule.rate
        missing_text = (
            f", of which {missing_seconds:.3f} s were not recorded" if capture.n_missing else ""
        )
        self.log.say(f"take {capture.name}: {duration:.1f} s{missing_text} -> {take_file}")

    def _report_sound_file(self) -> None:
        message, closed_file = self.sound_file.report_change(
            self.schedule.engine, self.schedule.rate
        )
        if message:
            self.log.say(message)
        if closed_file is not None:
            self.log.write("sound", first=closed_file.first_frame, frames=closed_file.n_frames)
