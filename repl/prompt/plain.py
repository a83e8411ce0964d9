"""Lines without a screen: for screen readers, pipes and scripts. Nothing is drawn twice."""

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

from .calm import Calm
from .folded import Folded
from .signals import Ended, handled, left_to_me
from .words import F12, echo, lines_of, typed

_LISTENED = 0.1  # s between two looks at what happened


class Plain:
    """A session by lines that come in and lines that go out."""

    def __init__(self, face: Calm, source: TextIO, sink: TextIO) -> None:
        """Over a face; what a file or a pipe says is repeated, so that a log tells it too."""
        self._face = face
        self._source, self._sink = source, sink
        self._by_hand = source.isatty()
        self._folded = Folded()
        self._over = threading.Event()
        self._writing = threading.Lock()
        self._prompt = ""  # that waits in the last line
        self._reading = False
        for stream in (source, sink):  # no byte and no locale is an error here
            if isinstance(stream, io.TextIOWrapper):
                stream.reconfigure(errors="replace")

    def run(self) -> int:
        """Serve until the end of input, or somebody leaves; the number of lines refused."""
        refusals = 0
        listener = threading.Thread(target=self._listen, name="ergon-messages", daemon=True)
        with left_to_me():
            listener.start()
        try:
            with self._terminal():
                while (text := self._whole_line()) is not None:
                    if F12 in text:  # a terminal gives it with the line
                        self._face.panic()
                        text = text.replace(F12, "")
                    if not text.strip():
                        continue
                    reply = self._face.submit(text)
                    refusals += not reply.taken
                    self._print(lines_of(reply, plain=True))
                    if reply.leaves:
                        break
        finally:
            self._over.set()
            listener.join()
        self._print([clean(line) for line in self._folded.rest()])
        return refusals

    def end(self) -> None:
        """Leave at once, from a signal's handler."""
        raise Ended

    def _whole_line(self) -> str | None:
        """A line with those that go on from it; None at the end of input."""
        lines: list[str] = []
        while True:
            try:
                line = self._line()
            except KeyboardInterrupt:
                if not self._by_hand:  # a script is ended by it
                    raise
                lines.clear()
                continue
            if not line:
                return "\n".join(lines) or None
            lines.append(typed(line).rstrip("\r\n"))
            text = "\n".join(lines)
            if self._face.is_whole(text):
                return text

    def _line(self) -> str:
        """One line with its end; empty at the end of input."""
        where = f"{self._face.state().where} > "
        line = ""
        try:
            self._reading = True  # before anybody sees that it does
            with self._writing:
                self._prompt = where
                self._write(where)
            line = self._source.readline()
        finally:
            self._reading = False
            with self._writing:
                self._prompt = ""
                if not (self._by_hand and line):  # a terminal shows by itself what is typed
                    self._write(echo("", typed(line).rstrip()) + "\n")
        return line

    def _print(self, lines: Sequence[str]) -> None:
        if lines:
            with self._writing:
                # Below a prompt that waits, which then stands again below them.
                self._write("\n" * bool(self._prompt) + "\n".join(lines) + "\n" + self._prompt)

    def _write(self, text: str) -> None:
        self._sink.write(text)
        self._sink.flush()

    def _listen(self) -> None:
        """A thread of its own: it tells what happens while nothing is typed."""
        with contextlib.suppress(OSError, ValueError):  # nobody reads any more
            while not self._over.wait(_LISTENED):
                self._folded.take(self._face.messages())
                self._print([clean(line) for line in self._folded.due(time.monotonic())])

    @contextlib.contextmanager
    def _terminal(self) -> Iterator[None]:
        """A hand's terminal in which Ctrl-C clears the line and Ctrl-S freezes nothing."""
        if not self._by_hand:
            yield
            return
        with handled(self._interrupted, signal.SIGINT), _unfrozen(self._source.fileno()):
            yield

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        if self._reading:
            _forget(self._source.fileno())
            raise KeyboardInterrupt
        self._face.cancel()  # a line is dropped as a whole, never in the middle of what it does


def _forget(terminal: int) -> None:
    """What is typed and not yet entered is gone."""
    if sys.platform != "win32":
        import termios

        termios.tcflush(terminal, termios.TCIFLUSH)


@contextlib.contextmanager
def _unfrozen(terminal: int) -> Iterator[None]:
    """Ctrl-S and Ctrl-Q are letters, not the terminal's own brake; Ctrl-C takes no output away."""
    if sys.platform == "win32":
        yield
        return
    import termios

    before = termios.tcgetattr(terminal)
    changed = termios.tcgetattr(terminal)
    changed[0] &= ~termios.IXON
    # By itself a terminal throws away what is being printed too, and so the next prompt at times.
    changed[3] |= termios.NOFLSH
    termios.tcsetattr(terminal, termios.TCSANOW, changed)
    try:
        yield
    finally:
        termios.tcsetattr(terminal, termios.TCSANOW, before)
