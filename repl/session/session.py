"""A session: it takes lines, answers each with a reply, and keeps the engine running."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ergon import _core
from ergon.live.display import decibels_of
from ergon.notation.text.edit import EditError
from ergon.notation.text.without_gc import without_gc
from ergon.repl.language.complete import complete
from ergon.repl.language.highlight import highlighted_tokens
from ergon.repl.language.lines import is_complete
from ergon.repl.language.parse import parse
from ergon.repl.language.refusal import Refusal
from ergon.repl.session import session_commands
from ergon.repl.session.core import Closable, SessionCore
from ergon.repl.session.version import NotTakenError
from ergon.repl.session_protocol import Reply, State
from ergon.scores.staging.refusals import StageError

if TYPE_CHECKING:
    from ergon.repl.language.commands import Command
    from ergon.repl.session_protocol import Suggestion

_CHECK_PERIOD = 0.02  # [s] between two turns of a thread
_CHECKS_PER_FILE_CHECK = 15  # turns between two looks at the score's files
_NO_REFUSALS: Mapping[type[Command], str] = MappingProxyType({})
_LONE_SURROGATE = re.compile("[\ud800-\udfff]")


class Session(SessionCore):
    """A session as a prompt sees it, and the threads that keep it going.

    Any thread may call its methods. While a line is computed, one thread hands over what is due,
    one makes what will be due, and one extends the timeline; none of them waits for another.
    """

    def __init__(self, *arguments: Any, **keyword_arguments: Any) -> None:
        """Begin as `SessionCore` does; `run` starts the threads."""
        super().__init__(*arguments, **keyword_arguments)
        self._attached_ports: list[Closable] = []
        self._port_turns: list[Callable[[float], object]] = []
        self._is_closed = threading.Event()
        self._threads: list[threading.Thread] = []
        self._n_turns = 0
        self._thread_work = _core.Work()  # computations of threads end with the session

    def attach(self, port: Closable, attend: Callable[[float], object] | None = None) -> None:
        """Let a port or a socket be closed when the session ends.

        Until then, a thread of the session calls its `attend` some 50 times a second with the
        present instant [s, time.monotonic].
        """
        self._attached_ports.append(port)
        if attend is not None:
            self._port_turns.append(attend)

    @without_gc  # garbage is collected when the line has its answer
    def submit(
        self,
        text: str,
        *,
        releases: bool = True,
        refusal_by_command: Mapping[type[Command], str] = _NO_REFUSALS,
    ) -> Reply:
        """Do a line, or a block of lines as one version. Raises nothing; the music goes on.

        A text with a command of a kind in `refusal_by_command` is refused with its sentence.
        """
        self.stops.begin_line(releases)
        try:
            reply = self._do_lines(text, refusal_by_command)
        except Refusal as refusal:
            reply = _refused_reply(refusal.message, refusal.try_)
        except NotTakenError as error:
            reply = _refused_reply(str(error), error.try_)
        except StageError as error:
            first_error = error.diagnostics[0]
            reply = _refused_reply(first_error.message, None, first_error.help)
        except _core.StoppedError as error:
            reply = _refused_reply(self.computing.refusal_text(error))
        except (EditError, _core.EngineError) as error:
            reply = _refused_reply(str(error))
        except BaseException as error:  # also pyo3's panics and SystemExit
            reply = _refused_reply(f"internal error: {type(error).__name__}; nothing has changed")
        self._write_reply(text, reply)
        return reply

    def _write_reply(self, line_text: str, reply: Reply) -> None:
        with self.schedule.lock:
            engine_frame = (
                self.schedule.engine.frame
            )  # so that `--resume` knows how far the session went
            self.hand_over_due()  # a journal that names a frame has all that happened before it
            self.log.write(
                "said",
                line=line_text[:10_000],
                taken=reply.taken,
                reply=reply.text,
                frame=engine_frame,
            )

    def _do_lines(self, text: str, refusal_by_command: Mapping[type[Command], str]) -> Reply:
        if _LONE_SURROGATE.search(text):  # a journal with it could not be read
            raise NotTakenError("this line contains half of a character (a lone surrogate)")
        commands = parse(text, self.scope)
        if not commands:
            return Reply(True, "")
        for command in commands:
            if type(command) in refusal_by_command:
                raise NotTakenError(refusal_by_command[type(command)])
        known_commands = session_commands.SESSION_COMMANDS
        version_commands = [command for command in commands if type(command) not in known_commands]
        other_commands = [command for command in commands if type(command) in known_commands]
        replies = [self.make_version(text, version_commands)] if version_commands else []
        replies += [known_commands[type(command)](self, command) for command in other_commands]
        reply_texts = [reply.text for reply in replies if reply.text]
        lines = tuple(line for reply in replies for line in reply.lines)
        is_taken = all(reply.taken for reply in replies)
        return Reply(
            is_taken,
            "; ".join(reply_texts),
            None,
            lines,
            any(line_reply.leaves for line_reply in replies),
        )

    def state(self) -> State:
        """Position, tempo, what plays, load and level."""
        running, engine = self.schedule.running, self.schedule.engine
        engine_frame, engine_status = engine.frame, engine.status()
        tempo = running.version.piece.tempo_map
        engine_beat = running.beat(engine_frame)
        bar, beat_in_bar = tempo.bar_beat(engine_beat)
        peak = max(engine_status.peaks, default=0.0)
        has_failed = self.journal is not None and self.journal.has_failed
        capture = self.captures.current
        return State(
            bar=bar,
            beat=beat_in_bar,
            tempo=tempo.bpm(engine_beat),
            playing=running.ongoing_gestures(engine_frame),
            load=engine_status.load,
            late=engine_status.late_ticks,
            level=decibels_of(peak),
            quant=self.quant_text,
            recording=None
            if capture is None
            else capture.seconds(engine_frame, running.stage.rate),
            panicked=self.stops.panicked,
            let_go=engine_status.is_let_go,
            drawing=self.drawing,
            troubles=(*(("JOURNAL NOT WRITTEN",) if has_failed else ()), *engine_status.troubles),
        )

    def messages(self) -> Sequence[str]:
        """Messages since the last call, one sentence each."""
        return self.log.pop_messages()

    def panic(self) -> None:
        """End sound and force at once; a line that is being computed is cancelled."""
        self.stops.panic()

    def let_go(self) -> None:
        """End every force at once, until `release`; the sound goes on."""
        self.stops.let_go()

    def end_input(self) -> None:
        """End all forces, because no further line can stop one."""
        self.stops.let_go()

    def cancel(self) -> bool:
        """Cancel the line that is being computed, from any thread; False if there is none."""
        return self.computing.cancel()

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """Completions of a line at a column."""
        return complete(line, cursor, self.scope)

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """The kinds of a line's words, for colours."""
        return highlighted_tokens(line, self.scope)

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends the text."""
        return is_complete(text)

    def run(self) -> None:
        """Start the threads that keep the session going until it is closed."""
        for thread_name, do_turn in (
            ("ergon session", self._attend),
            ("ergon feeder", self.extend_timeline),
            ("ergon maker", self.make_due),
            ("ergon files", self._do_slow_turn),
        ):
            thread = threading.Thread(
                target=self._repeat, args=(do_turn,), name=thread_name, daemon=True
            )
            self._threads.append(thread)
            thread.start()

    def _repeat(self, do_turn: Callable[[], object]) -> None:
        while not self._is_closed.wait(_CHECK_PERIOD):
            try:
                with self._thread_work:
                    do_turn()
            except _core.StoppedError:  # the session is closed
                return
            except BaseException as error:  # the next turn may succeed
                self.say(f"{type(error).__name__}: {error}")

    def _attend(self) -> None:
        self.hand_over_due()
        for do_turn in self._port_turns:
            do_turn(time.monotonic())

    def _do_slow_turn(self) -> None:
        """Guide hands, find the names of the next line, and read the score again if its file has
        changed.
        """
        _ = self.scope  # for the next line, which then need not wait for it
        if (paths := self.guidance.due_paths()) is not None:
            with self.schedule.lock:
                self.guidance.send(*paths)
        self._n_turns += 1
        if (
            self._n_turns % _CHECKS_PER_FILE_CHECK == 0
            and self.file_watch
            and self.file_watch.has_changed()
        ):
            name, reply = Path(self.schedule.head.texts.path).name, self.submit("reload")
            reload_text = "reloaded" if reply.taken else "not reloaded"
            self.say(f"{name} has changed and is {reload_text}: {reply.text}")

    def close(self) -> None:
        """End the session, its engine and its journal."""
        if self._is_closed.is_set():
            return
        self._is_closed.set()
        for port in self._attached_ports:
            port.close()
        self._thread_work.cancel()
        for thread in self._threads:
            thread.join()
        with self.schedule.lock:
            self._take_events()
            self.schedule.engine.close()
            # Lines may take effect until the engine is closed: the end is written after all of
            # them.
            self._take_events()
            self.log.take_reports()
            self._report_sound_file()
            self.log.write("end", frame=self.schedule.engine.frame)
            self.is_over = True
            if self.journal is not None:
                self.journal.close()
                if journal_error := self.journal.pop_failure():
                    self.say(journal_error)


def _refused_reply(
    message: str, suggested_line: str | None = None, help_text: str | None = None
) -> Reply:
    return Reply(False, f"{message} ({help_text})" if help_text else message, suggested_line)
