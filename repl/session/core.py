"""What the commands of a session act on: its versions, the lines that wait, files, the journal."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon.live.display import feels
from ergon.notation.clock.positions import Length
from ergon.repl.language.commands import NOW, Command, Guide, When
from ergon.repl.language.scope import names
from ergon.repl.session import computing, version_edits
from ergon.repl.session.captures import Capture, Captures
from ergon.repl.session.clock import Clock
from ergon.repl.session.commits import REFUSALS, Commits, VersionEdit, Waiting, fader_ratios
from ergon.repl.session.disk import Disk
from ergon.repl.session.guidance import Guidance, allow
from ergon.repl.session.journal import Journal
from ergon.repl.session.journal_content import said
from ergon.repl.session.running import Running, begin
from ergon.repl.session.stops import Stops
from ergon.repl.session.version import NotTakenError, PastVersion, Version
from ergon.repl.session.watch import Watch
from ergon.repl.session_protocol import Reply

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Store
    from ergon.scores.staging.stage import Stage

_BAR = Length(bars=1.0)


class SessionCore:
    """Versions of a score that take over from one another while they sound."""

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
    ) -> None:
        """Begin with a version whose piece stands; `make` puts its stage on an engine.

        `margin` [s] is what a change takes to reach the engine; `hands` is the recording that
        the engine writes of real hands; `disk` is what is known of files where they do not lie
        there as the version has them. One that `watches` reloads a score that was saved.
        """
        running = begin(version, clock or Clock(), real or {}, store)
        engine = make(running.stage)
        borne = engine.bearings(running.stage, running.start, (), ())
        running = replace(running, bearings=borne)
        engine.set_faders(fader_ratios(running))
        self.journal = journal
        self.quant: Length | None = _BAR
        self.quant_text = "bar"
        self.versions = [PastVersion.of(version, "1|1")]
        self.at = 0  # of versions: the last one that was not undone
        self.commits = Commits(
            engine, running, real or {}, int(margin * running.stage.rate), version
        )
        self.captures = Captures(hands)
        self.guidance = Guidance(self.commits)
        self.computing = computing.Computing()
        self.watch = Watch(version.texts) if watches else None
        self.stops = Stops(self)
        self.taps: list[float] = []
        self.disk = disk or Disk.of(version.texts)
        self.number = 0
        self._scope = names(version.piece)
        self._scope_of = version.piece
        self._messages: deque[str] = deque(maxlen=1000)
        # Which part of the scene's force each real hand was last said to get.
        self._felt: dict[str, float] = {}
        self._messages += self.felt(running)
        self.lock = threading.RLock()
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def say(self, message: str) -> None:
        """Tell something with the next messages."""
        self._messages.append(message)

    def release(self) -> None:
        """Sound and force again, after a panic and after `let_go`."""
        self.stops.release()
        self._tell("release", frame=self.commits.engine.frame)

    def take(self, text: str, commands: Sequence[Command]) -> Reply:
        """Make a version of what commands ask for."""
        for command in commands:
            if isinstance(command, Guide):
                allow(command, self.commits)
        when: When = next((c.when for c in commands if c.when is not None), None)
        is_read = any(type(command) in version_edits.READS_FILES for command in commands)
        where, made = self.queue(text, version_edits.combined(commands), when, is_read=is_read)
        said = [version_edits.summary(command, made) for command in commands] + self.felt(made)
        return Reply(True, f"ok {where} {'; '.join(filter(None, said))}".rstrip())

    def felt(self, made: Running) -> list[str]:
        """What real hands get of a version, where that is not what they were told last."""
        told = [one for one in made.bearings if self._felt.get(one.player, 1.0) != one.last.scale]
        self._felt |= {one.player: one.last.scale for one in told}
        return [feels(one) for one in told]

    def queue(
        self,
        line: str,
        edit: VersionEdit,
        when: When = None,
        *,
        goes: bool | None = None,
        beat: float | None = None,
        resets: bool = False,
        restores: int | None = None,
        is_read: bool = False,
        is_limited: bool = True,
    ) -> tuple[str, Running]:
        """Let a line wait for its boundary; a new version unless it `restores` an old one.

        Where it comes into effect, and what plays then. What was read from files stands in the
        journal as it was. Raises StoppedError where a line that `is_limited` takes too long.
        """
        place, start = self.commits.place(when, self.quant)
        self.number += 1
        number = self.number

        def numbered(version: Version, at: float) -> Version:
            made = edit(version, at)
            return replace(made, number=number, line=line)

        enter = place if beat is None else beat
        is_now = when is NOW or (when is None and self.quant is None) or goes is not None
        waiting = Waiting(line, numbered, enter, start, goes, resets, number=number, is_now=is_now)
        seconds: float | None = None
        if is_limited:
            takes_long = is_read or restores is not None or goes is not None
            seconds = computing.FILES if takes_long else computing.LINE
        with self.computing.within(seconds):
            made = self.commits.take(waiting)
        where = made.version.piece.tempo_map.written(waiting.beat)
        self._tell(
            "line",
            number=number,
            line=line,
            beat=waiting.beat,
            start=waiting.start,
            goes=goes,
            resets=resets,
            restores=restores,
            where=where,
            **(self._said(made.version) if is_read else {}),
        )
        if restores is None:
            del self.versions[self.at + 1 :]
            self.versions.append(PastVersion.of(made.version, where))
            self.at += 1
        self._rescope()
        self.pump()
        return where, made

    def _said(self, version: Version) -> dict[str, object]:
        if version.read is not None:
            self.disk.saw(version.read)
        return {**said(version.texts), "disk": self.disk.said(version.texts)}

    def drop(self, waiting: Waiting) -> None:
        """Take a line back before it began."""
        self.commits.drop(waiting)
        self._tell("dropped", number=waiting.number)
        self._rescope()

    def wrote(self, texts: Texts) -> None:
        """Files were written for texts, and `disk` knows of it."""
        self._tell("saved", score=texts.path, disk=self.disk.said(texts))
        if self.watch is not None:
            self.watch.has_changed()  # it was we

    def written(self, beat: float) -> str:
        """A beat of the piece as `bar|beat`."""
        return self.commits.head.piece.tempo_map.written(beat)

    def pump(self) -> None:
        """Hand over what is due, and hear what the engine tells."""
        with self.lock:
            self._hear()
            self._late(self.commits.tick())
            while self.commits.lost:
                one, why = self.commits.lost.pop(0)
                self._messages.append(f"'{one.line}' could not take effect and is dropped: {why}")
                self._tell("dropped", number=one.number)
            if (own := self.captures.ready(self.commits)) is not None:
                self._keep_take(own)
            if self.journal is not None and (trouble := self.journal.trouble()):
                self._messages.append(trouble)

    def _hear(self) -> None:
        for told in self.commits.engine.events():
            if told.sentence:
                self._messages.append(f"{self._written(told.frame)} {told.sentence}")
            elif told.ticket is not None and told.is_late:
                self.guidance.late(told.ticket)
                self._late(self.commits.late(told.ticket))
            elif told.ticket is not None:
                self._committed(self.commits.done(told.ticket), told.frame)

    def _keep_take(self, own: Capture) -> None:
        """A take that has ended gets its file and its name."""
        folder = Path(self.commits.head.texts.path).parent
        try:
            path = self.captures.write(own, folder, self.commits.engine.tick_frames)
            file = path.relative_to(folder).as_posix()

            def edit(version: Version, beat: float) -> Version:
                return version_edits.with_take(version, own.name, file, own.player)

            self.queue(f"# take {own.name}", edit, NOW, is_read=True)
        except (NotTakenError, *REFUSALS) as error:
            self._messages.append(str(error))
            return
        assert own.stop is not None
        seconds = (own.stop - own.start) / self.commits.rate
        self._messages.append(f"take {own.name}: {seconds:.1f} s -> {file}")

    def _late(self, lines: Sequence[Waiting]) -> None:
        for one in lines:
            if one.number:
                self._tell("late", number=one.number, beat=one.beat)
            if one.line and not one.is_now:
                self._messages.append(
                    f"'{one.line}' was not ready in time; it takes effect at the next bar"
                )

    def _committed(self, lines: Sequence[Waiting], frame: int) -> None:
        if not self.commits.waiting:  # what a line was made on may have been another version
            running = self.commits.running
            self._messages += [f"{self._written(frame)} {said}" for said in self.felt(running)]
        for one in lines:
            if one.number:  # else only the horizon went on
                self._tell("commit", number=one.number, frame=frame, beat=one.beat)

    def _rescope(self) -> None:
        piece = self.commits.head.piece
        if piece is not self._scope_of:
            self._scope, self._scope_of = names(piece), piece

    def _written(self, frame: int) -> str:
        running: Running = self.commits.running
        return running.version.piece.tempo_map.written(running.beat(frame))

    def _tell(self, event: str, **fields: Any) -> None:
        if self.journal is not None:
            self.journal.tell(event, **fields)
