"""A prompt without a screen: for screen readers, pipes and scripts. It only appends lines."""

from __future__ import annotations

import contextlib
import io
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from types import FrameType
from typing import TextIO

from ergon.common.terminal import clean
from ergon.repl.line_queue import LineQueue, QueuedLine
from ergon.repl.session_protocol import Reply, SignalWatch

from .error_boundary import ErrorBoundary
from .line_reader import LineReader
from .message_throttle import MessageThrottle
from .output import echo, reply_lines
from .signals import Terminated, interrupt_ends_forces, signals_blocked_in_threads, with_handler

_CHECK_PERIOD = 0.1  # s between two looks at what happened


class PlainPrompt:
    """A prompt that reads and prints lines."""

    def __init__(
        self, session: ErrorBoundary, source: TextIO, sink: TextIO, watch: SignalWatch
    ) -> None:
        """Prepare a session's prompt; lines from a file or a pipe are echoed, so that a log has
        them.
        """
        self._session = session
        self._source, self._sink, self._watch = source, sink, watch
        self._is_terminal = source.isatty()
        self._throttle = MessageThrottle()
        self._end_event = threading.Event()
        self._write_lock = threading.Lock()
        self._prompt = ""  # the prompt in the last line
        self._is_reading = False
        self._queue: LineQueue[None] = LineQueue(session)
        self._reader = LineReader(source, self._queue)
        if isinstance(sink, io.TextIOWrapper):  # never fail on a character that the locale lacks
            sink.reconfigure(errors="replace")

    def run(self) -> int:
        """Serve until the input ends or a line leaves; the number of refused lines."""
        n_refused = 0
        message_thread = threading.Thread(
            target=self._print_messages, name="ergon-messages", daemon=True
        )
        with signals_blocked_in_threads():
            message_thread.start()
            self._reader.start()
        try:
            with self._prepared_terminal():
                while (queued := self._next_whole_line()) is not None:
                    if not queued.text.strip():
                        continue
                    reply = self._do_line(queued)
                    n_refused += not reply.taken
                    self._print(reply_lines(reply, plain=True))
                    if reply.leaves:
                        break
        finally:
            self._reader.stop()
            self._end_event.set()
            message_thread.join()
        self._print([clean(line) for line in self._throttle.pop_all()])
        return n_refused

    def end(self) -> None:
        """Leave at once; called by a signal handler."""
        raise Terminated

    def _do_line(self, queued: QueuedLine[None]) -> Reply:
        if not self._is_terminal:
            return self._session.submit(queued.text, releases=queued.releases)
        with interrupt_ends_forces(self._watch):
            return self._session.submit(queued.text, releases=queued.releases)

    def _next_whole_line(self) -> QueuedLine[None] | None:
        """A line together with the lines that continue it; None at the end of input."""
        queued_lines: list[QueuedLine[None]] = []
        while True:
            try:
                queued_line = self._next_line()
            except KeyboardInterrupt:
                if not self._is_terminal:  # Ctrl-C ends a script
                    raise
                queued_lines.clear()
                continue
            if queued_line is not None:
                queued_lines.append(queued_line)
            typed_text = "\n".join(line.text for line in queued_lines)
            if queued_line is None and not typed_text:
                return None
            if queued_line is None or self._session.is_whole(typed_text):
                return QueuedLine(None, typed_text, all(line.releases for line in queued_lines))

    def _next_line(self) -> QueuedLine[None] | None:
        """The next line; None at the end of input."""
        prompt_text = f"{self._session.state().where} > "
        queued = None
        try:
            self._is_reading = True  # before the prompt is visible
            with self._write_lock:
                self._prompt = prompt_text
                self._write(prompt_text)
            queued = self._queue.next()
            self._reader.note_line_taken()
        finally:
            self._is_reading = False
            with self._write_lock:
                self._prompt = ""
                if not (self._is_terminal and queued):  # a terminal echoes by itself
                    self._write(echo("", queued.text.rstrip() if queued else "") + "\n")
        return queued

    def _print(self, lines: Sequence[str]) -> None:
        if lines:
            with self._write_lock:
                # Print below the prompt that waits, and then the prompt again.
                self._write("\n" * bool(self._prompt) + "\n".join(lines) + "\n" + self._prompt)

    def _write(self, text: str) -> None:
        self._sink.write(text)
        self._sink.flush()

    def _print_messages(self) -> None:
        """Print messages, in a thread of its own."""
        with contextlib.suppress(OSError, ValueError):  # the output was closed
            while not self._end_event.wait(_CHECK_PERIOD):
                self._throttle.add(self._session.messages())
                self._print([clean(line) for line in self._throttle.pop_due(time.monotonic())])

    @contextlib.contextmanager
    def _prepared_terminal(self) -> Iterator[None]:
        """Prepare a terminal so that Ctrl-C clears the line, and Ctrl-S does not stop the
        output.
        """
        if not self._is_terminal:
            self._watch([signal.SIGINT], ends=True)
            yield
            return
        with (
            with_handler(self._on_interrupt, signal.SIGINT),
            _without_flow_control(self._source.fileno()),
        ):
            self._watch([signal.SIGINT], ends=None)
            yield
        self._watch([signal.SIGINT], ends=True)

    def _on_interrupt(self, number: int, frame: FrameType | None) -> None:
        if not self._is_reading:
            self._session.let_go()
            self._session.cancel()  # a line is dropped as a whole, never half done
            return
        _flush_input(self._source.fileno())
        self._reader.drop_typed()
        raise KeyboardInterrupt


def _flush_input(terminal: int) -> None:
    """Drop typed characters that were not read yet."""
    if sys.platform != "win32":
        import termios

        termios.tcflush(terminal, termios.TCIFLUSH)


@contextlib.contextmanager
def _without_flow_control(terminal: int) -> Iterator[None]:
    """Let Ctrl-S and Ctrl-Q be ordinary characters, and let Ctrl-C discard no output."""
    if sys.platform == "win32":
        yield
        return
    import termios

    old_attributes = termios.tcgetattr(terminal)
    attributes = termios.tcgetattr(terminal)
    attributes[0] &= ~termios.IXON
    # Without this, Ctrl-C also discards output, sometimes the next prompt.
    attributes[3] |= termios.NOFLSH
    termios.tcsetattr(terminal, termios.TCSANOW, attributes)
    try:
        yield
    finally:
        termios.tcsetattr(terminal, termios.TCSANOW, old_attributes)
