"""The core of a session, on which commands act: its versions, waiting lines, files and journal."""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ergon.live.display import force_sentence
from ergon.notation.clock.positions import Length
from ergon.repl.language.commands import NOW, Command, DefineBlock, Guide, When
from ergon.repl.language.scope import scope_of
from ergon.repl.session import computing, inspection, version_edits
from ergon.repl.session.acts import Acts
from ergon.repl.session.block_runs import BlockRuns
from ergon.repl.session.captures import Capture, Captures
from ergon.repl.session.clock import Clock
from ergon.repl.session.commits import REFUSALS, Commits, VersionEdit, WaitingLine, fader_ratios
from ergon.repl.session.disk import Disk, folder_of
from ergon.repl.session.fast_values import FastValues
from ergon.repl.session.guidance import Guidance, check_guide
from ergon.repl.session.history import History, PastVersions
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import effect_fields, text_fields
from ergon.repl.session.midi_input import MidiInput
from ergon.repl.session.running import RunningVersion, stage_first
from ergon.repl.session.sound_file import SoundFile
from ergon.repl.session.stops import Stops
from ergon.repl.session.version import NotTakenError, PastVersion, Version, first_line
from ergon.repl.session.watch import FileWatch
from ergon.repl.session_protocol import Reply
from ergon.scores.edits import merging

if TYPE_CHECKING:
    from ergon.repl.language.scope import Scope
    from ergon.repl.session.engine import Engine, EngineEvent
    from ergon.repl.session.frozen_parts import LoadedPart
    from ergon.scores.edits.merging import Spot
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Store
    from ergon.scores.staging.stage import Stage

_BAR = Length(bars=1.0)
_DELAY_TOLD = 1.0  # [s] by which a line that acts now may be late without a message
_DRAWS_EVERY = 0.5  # [s] between two drawings of a key that is traced: one takes 15 ms
_TRACE_HEIGHT = 6  # characters
_LOOKS_BACK = 200  # latest lines that are searched for the one that a reload discards


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
        make: Callable[[Stage], Engine],
        *,
        margin: float,
        journal: Journal | None = None,
        real: Real | None = None,
        store: Store | None = None,
        clock: Clock | None = None,
        hands: Path | None = None,
        disk: Disk | None = None,
        watches: bool = False,
        past: PastVersions | None = None,
        frozen: tuple[LoadedPart, ...] = (),
        is_seen: bool = False,
    ) -> None:
        """Begin with a version whose piece is stopped; `make` makes an engine for its stage.

        `margin` [s] is the time in which a change reaches the engine; `hands` is the engine's
        recording of real hands; `disk` has the known hashes if files on the disk differ from the
        version. A session that `watches` reloads the score when it is saved elsewhere. `past` is
        the history of a resumed session, whose version 0 is `version`. `frozen` parts are played
        from their samples until the score changes them. If it `is_seen`, parts that are not
        heard are computed too.
        """
        version = replace(version, base=version.base or version.texts)
        running = stage_first(version, clock or Clock(), real or {}, store, frozen, is_seen=is_seen)
        engine = make(running.stage)
        borne = engine.force_bounds(running.stage, running.start, (), ())
        running = replace(running, force_bounds=borne)
        engine.set_faders(fader_ratios(running))
        self.journal = journal
        self.quant: Length | None = _BAR
        self.quant_text = "bar"
        self.commits = Commits(
            engine, running, real or {}, int(margin * running.stage.rate), version
        )
        past = past or PastVersions([PastVersion.from_version(version, "1|1")], 0)
        self.history = History([one.number for one in past.versions], past.index)
        self.commits.past_versions.update((one.number, one) for one in past.versions)
        # Lines that `undo` took back before they took effect.
        self.cancelled: list[WaitingLine] = []
        self.captures = Captures(hands)
        self.sound_file = SoundFile()
        self.guidance = Guidance(self.commits)
        self.computing = computing.Computing()
        self.watch = FileWatch(version.texts) if watches else None
        self.stops = Stops(self)
        self.fast_values = FastValues(self)
        self.block_runs = BlockRuns(self)
        self.acts = Acts(self._journal_event)
        self.midi = MidiInput(self)
        self.taps: list[float] = []
        self.traced: str | None = None  # whose key is drawn while it moves
        self.drawing: tuple[str, ...] = ()
        self._drawn = 0  # the frame of that drawing
        self._attached: list[Closable] = []
        self._turns: list[Callable[[float], object]] = []
        self.disk = disk or Disk.of_texts(version.texts)
        self.number = 0
        self._scope = scope_of(version.piece, folder_of(version.texts))
        self._scope_piece = version.piece
        self._messages: deque[str] = deque(maxlen=1000)
        # By player, the share of force that was reported last.
        self._scales: dict[str, float] = {}
        self._frozen = {part.name for part in frozen}  # those that the last line left frozen
        # By kind of trouble: what was told last, and at which frame.
        self._troubled: dict[str, tuple[str, float]] = {}
        self._messages += self.force_messages(running)
        self.lock = threading.RLock()
        self._events_lock = threading.Lock()
        # Events taken from the engine and not yet handled, each with whether the journal has it.
        self._events: deque[tuple[EngineEvent, bool]] = deque()
        self._is_closed = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def scope(self) -> Scope:
        """The names that a line may use now."""
        piece = self.commits.head.piece
        if piece is not self._scope_piece:
            folder = folder_of(self.commits.head.texts)
            self._scope, self._scope_piece = scope_of(piece, folder), piece
        return self._scope

    def attach(self, one: Closable, turn: Callable[[float], object] | None = None) -> None:
        """Let a port or a socket be closed when the session ends.

        Until then, the session's thread calls its `turn` some 50 times a second with the present
        instant [s, time.monotonic].
        """
        self._attached.append(one)
        if turn is not None:
            self._turns.append(turn)

    def say(self, message: str) -> None:
        """Add a message."""
        self._messages.append(message)

    def release(self) -> None:
        """Switch sound and force on again, after a panic or `let_go`."""
        self.stops.release()
        self._journal_event("release", frame=self.commits.engine.frame)

    def make_version(self, text: str, commands: Sequence[Command]) -> Reply:
        """Make a version by the edits of commands, and queue it."""
        for command in commands:
            if isinstance(command, Guide):
                check_guide(command, self.commits)
        when: When = next((c.when for c in commands if c.when is not None), None)
        if when is None and all(isinstance(command, DefineBlock) for command in commands):
            when = NOW  # nothing is heard of it
        is_read = any(type(command) in version_edits.READS_FILES for command in commands)
        where, made = self.queue(text, version_edits.combined(commands), when, reads_files=is_read)
        said = [version_edits.summary(command, made, where) for command in commands]
        said += self.force_messages(made)
        said += self._dropped_messages(made.version)
        return Reply(True, f"ok {where} {'; '.join(filter(None, said))}".rstrip())

    def _dropped_messages(self, version: Version) -> list[str]:
        """Messages about typed values that were replaced by those of the files."""
        found = []
        for spot in version.discarded_spots:
            line = self._line_that_changed(spot)
            typed = f"'{first_line(line)}'" if line else "what was typed"
            found.append(
                f"{spot} was changed by {typed} and in the file; the value in the file is kept, "
                "and the line is discarded"
            )
        return found

    def _line_that_changed(self, spot: Spot) -> str:
        """The last earlier line that changed a place; empty if none is found."""
        past = [self.commits.past_versions[n] for n in self.history.numbers[: self.history.index]]
        for before, after in itertools.pairwise(reversed(past[-_LOOKS_BACK:])):
            if merging.differ(before.texts, after.texts, spot):
                return before.line
        return ""

    def force_messages(self, made: RunningVersion) -> list[str]:
        """Messages about the share of force that real hands get, where it has changed."""
        changed = [
            one for one in made.force_bounds if self._scales.get(one.player, 1.0) != one.last.scale
        ]
        self._scales |= {one.player: one.last.scale for one in changed}
        return [force_sentence(one) for one in changed]

    def queue(
        self,
        line: str,
        edit: VersionEdit,
        when: When = None,
        *,
        sets_running: bool | None = None,
        beat: float | None = None,
        resets: bool = False,
        restores: int | None = None,
        reads_files: bool = False,
        is_limited: bool = True,
        redoes: bool = False,
        replaces: int | None = None,
        is_typed: bool = True,
    ) -> tuple[str, RunningVersion]:
        """Queue a line for its boundary: a new version, or an earlier one that it `restores`.

        In the history it may take the place of the line `replaces`; a line that is not
        `is_typed` is not in the history. Returns the beat as written, and the staged version.
        The journal keeps texts that were read from files. Raises StoppedError if a line that
        `is_limited` takes too long.
        """
        is_stop = resets or sets_running is False
        if self.journal is not None and self.journal.is_full and not is_stop:
            raise NotTakenError("the journal keeps no further line: make room on the disk")
        place, start = self.commits.beat_and_frame(when, self.quant)
        self.number += 1
        number = self.number

        def numbered(version: Version, at: float) -> Version:
            made = edit(version, at)
            return replace(made, number=number, line=line)

        if resets:  # the piece stands there: what begins between there and `place` never plays
            place = self.commits.running.beat(start)
        enter = place if beat is None else beat
        is_now = when is NOW or (when is None and self.quant is None) or sets_running is not None
        waiting = WaitingLine(
            line,
            numbered,
            enter,
            start,
            sets_running,
            resets,
            number=number,
            is_now=is_now,
            reads_files=reads_files,
        )
        seconds: float | None = None
        if is_limited:
            takes_long = reads_files or restores is not None or sets_running is not None
            seconds = computing.FILES_SECONDS if takes_long else computing.LINE_SECONDS
        with self.computing.limited(seconds):
            made = self.commits.insert(waiting)
        where = made.version.piece.tempo_map.written(waiting.beat)
        self._tell_thawed(made)
        self._journal_event(
            "line",
            number=number,
            line=line,
            beat=waiting.beat,
            start=waiting.start,
            goes=sets_running,
            resets=resets,
            restores=restores,
            where=where,
            **({} if replaces is None else {"replaces": replaces}),
            **({} if is_typed else {"typed": False}),
            **(self._fields_read(made.version) if reads_files else {}),
        )
        if restores is None and is_typed:
            self.history.add(number)
            if replaces is not None:
                self.history.remove(replaces)
                self.commits.past_versions.pop(replaces, None)
            if not redoes:
                self.cancelled.clear()
            self.history.sort(self.commits.effect_order())
        self._tell_moved()
        self.pump()
        return where, made

    def _tell_thawed(self, made: RunningVersion) -> None:
        """Report which frozen parts are computed live from a version on."""
        frozen = {part.name for part in made.frozen}
        thawed = [
            made.version.sounds_as.shown(name, made.version.piece.instruments)
            for name in sorted(self._frozen - frozen)
            if name in made.version.sounding.instruments
        ]
        self._frozen = frozen
        if thawed:
            verb, start = ("is", "starts") if len(thawed) == 1 else ("are", "start")
            self._messages.append(
                f"from this line on {', '.join(thawed)} {verb} computed live and {start} at rest, "
                "because the line changes what was frozen"
            )

    def _tell_moved(self) -> None:
        """Note in the journal the new frames of waiting lines that have moved."""
        for one in self.commits.moved_lines:
            self._journal_event("late", number=one.number, beat=one.beat, start=one.start)
        self.commits.moved_lines.clear()

    def _fields_read(self, version: Version) -> dict[str, object]:
        disk: dict[str, object] = {}
        if version.read_texts is not None:
            self.disk.note_read(version.read_texts)
            disk["base"] = text_fields(version.read_texts)
            if self.watch is not None:
                self.watch.watch_texts(version.read_texts)
        disk["disk"] = self.disk.hashes_by_name(version.texts)
        return {**text_fields(version.texts), **disk, **effect_fields(version)}

    def drop(self, waiting: WaitingLine) -> None:
        """Remove a line that has not taken effect."""
        self.commits.drop(waiting)
        self.note_dropped(waiting)
        self._tell_moved()

    def note_dropped(self, waiting: WaitingLine) -> None:
        """Note in history and journal that a line will not take effect."""
        self.history.remove(waiting.number)
        self._journal_event("dropped", number=waiting.number)

    def note_written(self, texts: Texts, *, is_own: bool) -> None:
        """Note that files were written: those of the score itself (`is_own`), or copies."""
        base = {"base": text_fields(texts)} if is_own else {}
        names = self.disk.hashes_by_name(texts)
        self._journal_event("saved", score=texts.path, disk=names, **base)
        if is_own:
            self.commits.rebase(texts)
        if self.watch is not None:
            self.watch.has_changed()  # the session itself wrote them

    def position_text(self, beat: float) -> str:
        """A beat of the piece as `bar|beat`."""
        return self.commits.head.piece.tempo_map.written(beat)

    def pump(self) -> None:
        """Do what is due: hand versions to the engine, handle its events, and run what else is
        waiting.
        """
        with self.lock:
            self._handle_events()
            self._report_late(self.commits.hand_over_due())
            self._messages += self.commits.messages
            self.commits.messages.clear()
            while self.commits.dropped:
                one, why = self.commits.dropped.pop(0)
                self._messages.append(
                    f"'{first_line(one.line)}' could not take effect and is dropped: {why}"
                )
                self.note_dropped(one)
            self.history.sort(self.commits.effect_order())
            self.fast_values.set_due()
            if not self.stops.panicked:
                self.block_runs.queue_due()
            if (own := self.captures.pop_ready(self.commits)) is not None:
                self._add_take(own)
            self._tell_sound_file()
            if self.journal is not None and (trouble := self.journal.pop_failure()):
                self._messages.append(trouble)
            self._tell_troubles()
            if self.traced is not None:
                frame = self.commits.engine.frame
                if frame >= self._drawn + _DRAWS_EVERY * self.commits.rate:
                    self.draw_trace()

    def draw_trace(self) -> None:
        """Draw the traced key, if there is one."""
        engine, running = self.commits.engine, self.commits.running
        self._drawn, self.drawing = engine.frame, ()
        if self.traced is not None:
            with contextlib.suppress(NotTakenError):  # the player is gone, or has not moved yet
                own = self.traced, engine.tick_frames, self.captures.path
                lines = inspection.draw_trace(running, engine.frame, *own, height=_TRACE_HEIGHT)
                self.drawing = tuple(lines)

    def _tell_troubles(self) -> None:
        """Report each new trouble of the engine; a count that rises, at most once per second of
        sound.
        """
        frame = self.commits.engine.frame
        for trouble in self.commits.engine.status().troubles:
            kind = trouble.rstrip("0123456789")
            last, told = self._troubled.get(kind, ("", -self.commits.rate))
            if trouble != last and frame >= told + self.commits.rate:
                self._troubled[kind] = trouble, frame
                self._messages.append(f"{self._position_at(frame)} {trouble}")

    def _take_events(self) -> None:
        """Take the engine's events and write at once to the journal what happened, even while a
        line is computed, so that a kill loses nothing. Any thread may call it.
        """
        with self._events_lock:
            for event in self.commits.engine.events():
                if event.act_ticket is not None:
                    self.acts.note_ended(event)
                    continue
                lines: Sequence[WaitingLine] = ()
                if event.ticket is not None and not event.is_late:
                    lines = self.commits.lines_under_way(event.ticket)
                    self._tell_committed(lines, event.frame)
                self._events.append((event, bool(lines)))

    def _handle_events(self) -> None:
        self._take_events()
        while self._events:
            event, is_told = self._events.popleft()
            for player, is_real in event.real.items():
                self._journal_event("hand", player=player, real=is_real, frame=event.frame)
            if event.sentence:
                self._messages.append(f"{self._position_at(event.frame)} {event.sentence}")
            elif event.ticket is not None and event.is_late:
                self.guidance.note_late(event.ticket)
                self._report_late(self.commits.requeue_late(event.ticket))
            elif event.ticket is not None:
                lines = self.commits.pop_done(event.ticket)
                self._report_forces(event.frame)
                if not is_told:
                    self._tell_committed(lines, event.frame)
        for frame, begins in self.commits.engine.silences():
            self._journal_event("silence", frame=frame, begins=begins)

    def _add_take(self, own: Capture) -> None:
        """Write the file of a take that has ended, and add the take to the score."""
        folder = Path(self.commits.head.texts.path).parent
        try:
            path = self.captures.write(own, folder, self.commits.engine.tick_frames)
            file = path.relative_to(folder).as_posix()

            def edit(version: Version, beat: float) -> Version:
                return version_edits.with_take(version, own.name, file, own.player)

            self.queue(f"# take {own.name}", edit, NOW, reads_files=True)
        except (NotTakenError, *REFUSALS) as error:
            self._messages.append(str(error))
            return
        assert own.stop is not None
        seconds = (own.stop - own.start) / self.commits.rate
        missing = own.n_missing * self.commits.engine.tick_frames / self.commits.rate
        cut = f", of which {missing:.3f} s were not recorded" if own.n_missing else ""
        self._messages.append(f"take {own.name}: {seconds:.1f} s{cut} -> {file}")

    def _tell_sound_file(self) -> None:
        said, closed = self.sound_file.report_change(self.commits.engine, self.commits.rate)
        if said:
            self._messages.append(said)
        if closed is not None:
            self._journal_event("sound", first=closed.first, frames=closed.frames)

    def _report_late(self, lines: Sequence[WaitingLine]) -> None:
        for one in lines:
            if one.number:
                self._journal_event("late", number=one.number, beat=one.beat, start=one.start)
            delay = (one.start - self.commits.engine.frame) / self.commits.rate
            if one.line and (not one.is_now or delay > _DELAY_TOLD):
                when = f"in {delay:.1f} s" if one.is_now else "at the next bar"
                self._messages.append(
                    f"'{first_line(one.line)}' was not ready in time; it takes effect {when}"
                )

    def _report_forces(self, frame: int) -> None:
        if not self.commits.waiting:  # a waiting line may have been made for another version
            running = self.commits.running
            self._messages += [
                f"{self._position_at(frame)} {said}" for said in self.force_messages(running)
            ]

    def _tell_committed(self, lines: Sequence[WaitingLine], frame: int) -> None:
        """Note in the journal which lines took effect at a frame."""
        for one in lines:
            if one.number:  # 0: no line, only the timeline was extended
                # If the line read files, its texts were merged with the version that now takes
                # effect.
                texts: dict[str, object] = {}
                if one.reads_files and one.staged:
                    version = one.staged.version
                    texts = {**text_fields(version.texts), **effect_fields(version)}
                self._journal_event(
                    "commit", number=one.number, frame=frame, beat=one.beat, **texts
                )

    def _position_at(self, frame: int) -> str:
        running: RunningVersion = self.commits.running
        return running.version.piece.tempo_map.written(running.beat(frame))

    def _journal_event(self, event: str, **fields: Any) -> None:
        if self.journal is not None:
            self.journal.append(event, **fields)
