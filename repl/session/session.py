"""A session: lines in, replies out, and music that no line can stop."""

from __future__ import annotations

import itertools
import math
import re
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.live.display import force_sentence
from ergon.notation.clock.positions import Length
from ergon.notation.text.edit import EditError
from ergon.repl.face import Reply, State
from ergon.repl.language.commands import NOW, Command, Guide, When
from ergon.repl.language.complete import complete
from ergon.repl.language.highlight import tokens
from ergon.repl.language.lines import is_whole
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.language.scope import names
from ergon.repl.session import asides, computing, deeds, files
from ergon.repl.session.captures import Capture, Captures
from ergon.repl.session.clock import Clock
from ergon.repl.session.commits import REFUSALS, Commits, Deed, Waiting, faders
from ergon.repl.session.disk import Disk
from ergon.repl.session.journal import Journal
from ergon.repl.session.leads import Leads, allow
from ergon.repl.session.recorded import said
from ergon.repl.session.running import Running, begin
from ergon.repl.session.stops import Stops
from ergon.repl.session.version import NotTakenError, Past, Version
from ergon.scores.staging.stage import StageError

if TYPE_CHECKING:
    from ergon.repl.face import Suggestion
    from ergon.repl.session.engine import Engine
    from ergon.scores.edits.texts import Texts
    from ergon.scores.staging.live import Real
    from ergon.scores.staging.planning import Store
    from ergon.scores.staging.stage import Stage

_LOOK = 0.02  # [s] between two looks at the engine
_WATCH = 15  # looks between two at the score's files
_BAR = Length(bars=1.0)
_HALF = re.compile("[\ud800-\udfff]")


class Session:
    """Versions of a score that take over from one another while they sound.

    One thread at a time may submit; any may look.
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
        engine.faders(faders(running))
        self.journal = journal
        self.quant: Length | None = _BAR
        self.quant_text = "bar"
        self.versions = [Past.of(version, "1|1")]
        self.at = 0  # of versions: the last one that was not undone
        self.commits = Commits(
            engine, running, real or {}, int(margin * running.stage.rate), version
        )
        self.captures = Captures(hands)
        self.leads = Leads(self.commits)
        self.computing = computing.Computing()
        self.watch = files.Watch(version.texts) if watches else None
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

    # --- what the keyboard sees ------------------------------------------------------------------

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line, or a block of lines as one version; whatever it is, the music goes on."""
        count = self.stops.count
        with self.lock:
            self.stops.begins(releases, count)
            try:
                self.pump()
                reply = self._submitted(text)
            except Refusal as refusal:
                reply = _not_taken(refusal.message, refusal.try_)
            except NotTakenError as error:
                reply = _not_taken(str(error), error.try_)
            except StageError as error:
                first = error.diagnostics[0]
                reply = _not_taken(first.message, None, first.help)
            except _core.StoppedError as error:
                reply = _not_taken(self.computing.refusal(error))
            except (EditError, _core.EngineError) as error:
                reply = _not_taken(str(error))
            except BaseException as error:  # pyo3's panics are no Exceptions, nor is SystemExit
                reply = _not_taken(f"{type(error).__name__} in ergon itself; nothing has changed")
            frame = self.commits.engine.frame  # as far as whoever resumes knows that it went
            self._tell("said", line=text[:10_000], taken=reply.taken, reply=reply.text, frame=frame)
            return reply

    def state(self) -> State:
        """Where it is and what is heard."""
        running, engine = self.commits.running, self.commits.engine
        frame, look = engine.frame, engine.look()
        tempo = running.version.piece.tempo_map
        beat = running.beat(frame)
        bar, into = tempo.bar_beat(beat)
        peak = max(look.peaks, default=0.0)
        capture = self.captures.now
        return State(
            bar=bar,
            beat=into,
            tempo=tempo.bpm(beat),
            playing=running.in_flight(frame),
            load=look.load,
            late=look.late,
            level=20.0 * math.log10(peak) if peak > 0 else -math.inf,
            quant=self.quant_text,
            recording=None if capture is None else capture.seconds(frame, running.stage.rate),
            panicked=self.stops.panicked,
            let_go=look.let_go,
        )

    def messages(self) -> Sequence[str]:
        """What happened since the last call, a sentence each."""
        found = []
        while self._messages:
            found.append(self._messages.popleft())
        return found

    def panic(self) -> None:
        """Silence and no force, at once; a line that is being computed is dropped."""
        self.stops.panic()

    def let_go(self) -> None:
        """No force on any hand, at once, until `release`; the sound goes on."""
        self.stops.let_go()

    def input_ends(self) -> None:
        """The session ends after the lines that wait, and nobody is there to stop a force."""
        self.stops.let_go()

    def cancel(self) -> bool:
        """Drop the line that is being computed, from any thread; whether there is one."""
        return self.computing.cancel()

    def release(self) -> None:
        """Sound and force again, after a panic and after `let_go`."""
        self.stops.release()
        self._tell("release", frame=self.commits.engine.frame)

    def say(self, message: str) -> None:
        """Tell something with the next messages."""
        self._messages.append(message)

    def close(self) -> None:
        """Hush, and let go of everything."""
        if self._over.is_set():
            return
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        with self.lock:
            self._tell("end", frame=self.commits.engine.frame)
            self.commits.engine.close()
            self._hear()
            if self.journal is not None:
                self.journal.close()

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """How a line may go on at a column."""
        return complete(line, cursor, self._scope)

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """What a line's words are, for colours."""
        return tokens(line, self._scope)

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends it."""
        return is_whole(text)

    # --- doing it --------------------------------------------------------------------------------

    def _submitted(self, text: str) -> Reply:
        if _HALF.search(text):  # no journal could be read again
            raise NotTakenError("there is half of a character in this line (a lone surrogate)")
        commands = parse(text, self._scope)
        if not commands:
            return Reply(True, "")
        music = [command for command in commands if type(command) in deeds.DEEDS]
        others = [command for command in commands if type(command) not in deeds.DEEDS]
        replies = [self.take(text, music)] if music else []
        replies += [asides.ASIDES[type(command)](self, command) for command in others]
        said = [reply.text for reply in replies if reply.text]
        lines = tuple(line for reply in replies for line in reply.lines)
        taken = all(reply.taken for reply in replies)
        return Reply(taken, "; ".join(said), None, lines, any(r.leaves for r in replies))

    def take(self, text: str, commands: Sequence[Command]) -> Reply:
        """Make a version of what commands ask for."""
        for command in commands:
            if isinstance(command, Guide):
                allow(command, self.commits)
        when: When = next((c.when for c in commands if c.when is not None), None)
        is_read = any(type(command) in deeds.READ for command in commands)
        where, made = self.queue(text, deeds.together(commands), when, is_read=is_read)
        said = [deeds.said(command, made) for command in commands] + self.felt(made)
        return Reply(True, f"ok {where} {'; '.join(filter(None, said))}".rstrip())

    def felt(self, made: Running) -> list[str]:
        """What real hands get of a version, where that is not what they were told last."""
        told = [one for one in made.bearings if self._felt.get(one.player, 1.0) != one.last.scale]
        self._felt |= {one.player: one.last.scale for one in told}
        return [force_sentence(one) for one in told]

    def queue(
        self,
        line: str,
        deed: Deed,
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
            made = deed(version, at)
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
            self.versions.append(Past.of(made.version, where))
            self.at += 1
        self._rescope()
        self.pump()
        return where, made

    def _said(self, version: Version) -> dict[str, object]:
        if version.read is not None:
            self.disk.saw(version.read)
        return {**said(version.texts), "disk": self.disk.said(version.texts)}

    def wrote(self, texts: Texts) -> None:
        """Files were written for texts, and `disk` knows of it."""
        self._tell("saved", score=texts.path, disk=self.disk.said(texts))
        if self.watch is not None:
            self.watch.has_changed()  # it was we

    def pump(self) -> None:
        """Hand over what is due, and hear what the engine tells."""
        with self.lock:
            self._hear()
            self._late(self.commits.tick())
            while self.commits.lost:
                one, why = self.commits.lost.pop(0)
                self._messages.append(f"'{one.line}' is lost: {why}")
                self._tell("dropped", number=one.number)
            if (own := self.captures.ready(self.commits)) is not None:
                self._keep_take(own)
            if self.journal is not None and (trouble := self.journal.trouble()):
                self._messages.append(trouble)

    def _hear(self) -> None:
        for told in self.commits.engine.told():
            if told.sentence:
                self._messages.append(f"{self._written(told.frame)} {told.sentence}")
            elif told.ticket is not None and told.is_late:
                self.leads.late(told.ticket)
                self._late(self.commits.late(told.ticket))
            elif told.ticket is not None:
                self._committed(self.commits.done(told.ticket), told.frame)

    def _keep_take(self, own: Capture) -> None:
        """A take that has ended gets its file and its name."""
        folder = Path(self.commits.head.texts.path).parent
        try:
            path = self.captures.write(own, folder, self.commits.engine.every)
            file = path.relative_to(folder).as_posix()

            def deed(version: Version, beat: float) -> Version:
                return deeds.taken(version, own.name, file, own.player)

            self.queue(f"# take {own.name}", deed, NOW, is_read=True)
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
                self._messages.append(f"'{one.line}' came too late; it waits for the next bar")

    def _committed(self, lines: Sequence[Waiting], frame: int) -> None:
        if not self.commits.waiting:  # what a line was made on may have been another version
            running = self.commits.running
            self._messages += [f"{self._written(frame)} {said}" for said in self.felt(running)]
        for one in lines:
            if one.number:  # else only the horizon went on
                self._tell("commit", number=one.number, frame=frame, beat=one.beat)

    def run(self) -> None:
        """Look after the engine in a thread of its own, until the session is closed."""
        self._thread = threading.Thread(target=self._look_on, name="ergon session", daemon=True)
        self._thread.start()

    def _look_on(self) -> None:
        looks = itertools.count()
        while not self._over.wait(_LOOK):
            try:
                self.pump()
                if (led := self.leads.due()) is not None:
                    with self.lock:
                        self.leads.hand(*led)
                if next(looks) % _WATCH == 0 and self.watch and self.watch.has_changed():
                    reply = self.submit("reload")
                    self._messages.append(reply.text if reply.taken else f"not taken: {reply.text}")
            except BaseException as error:  # whatever it was, the next look may succeed
                self._messages.append(f"{type(error).__name__}: {error}")

    def _rescope(self) -> None:
        piece = self.commits.head.piece
        if piece is not self._scope_of:
            self._scope, self._scope_of = names(piece), piece

    def written(self, beat: float) -> str:
        """A beat of the piece as `bar|beat`."""
        return self.commits.head.piece.tempo_map.written(beat)

    def _written(self, frame: int) -> str:
        running: Running = self.commits.running
        return running.version.piece.tempo_map.written(running.beat(frame))

    def drop(self, waiting: Waiting) -> None:
        """Take a line back before it began."""
        self.commits.drop(waiting)
        self._tell("dropped", number=waiting.number)
        self._rescope()

    def _tell(self, event: str, **fields: Any) -> None:
        if self.journal is not None:
            self.journal.tell(event, **fields)


def _not_taken(message: str, try_: str | None = None, help: str | None = None) -> Reply:
    return Reply(False, f"{message} ({help})" if help else message, try_)
