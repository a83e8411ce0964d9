"""A terminal for tests: a program in a pseudo-terminal, and the screen that a user sees."""

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import pexpect
import pyte
from patience import PATIENCE

CTRL_C, CTRL_D, CTRL_Q, CTRL_S, CTRL_Z = "\x03", "\x04", "\x11", "\x13", "\x1a"
F12, UP, TAB, ENTER = "\x1b[24~", "\x1b[A", "\t", "\r"


class Screen(pyte.HistoryScreen):
    """Answers the program's queries to the terminal, such as the position of the cursor."""

    answers: Callable[[str], object]

    def write_process_input(self, data: str) -> None:
        self.answers(data)


class Terminal:
    """A program and its screen; `with` ends it."""

    def __init__(
        self,
        command: list[str],
        rows: int = 24,
        columns: int = 80,
        cwd: Path | None = None,
        **environment: str,
    ):
        clean = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
        self.child = pexpect.spawn(
            command[0],
            command[1:],
            env=clean | {"TERM": "xterm-256color", "LANG": "C.UTF-8"} | environment,
            cwd=cwd,
            dimensions=(rows, columns),
            echo=True,  # as terminals are; the program turns it off
        )
        os.set_blocking(self.child.child_fd, False)
        self.screen = Screen(columns, rows, history=10_000)
        self._unsent = bytearray()
        self.screen.answers = lambda text: self._unsent.extend(text.encode())
        self._stream = pyte.ByteStream(self.screen)
        self.output = b""  # all bytes that came

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self.child.close(force=True)
        except pexpect.ExceptionPexpect:  # killed; where the machine is busy that takes a while
            self.child.wait()

    def type(self, text: str | bytes) -> None:
        """Type keys; output is read meanwhile, as a terminal does, so that neither side blocks."""
        data = text.encode() if isinstance(text, str) else text
        for index in range(0, len(data), 1024):
            self._unsent += data[index : index + 1024]
            self.look(0)
            while self._unsent:
                self.look(0.005)

    def paste(self, text: str) -> None:
        self.type(f"\x1b[200~{text}\x1b[201~")

    def resize(self, rows: int, columns: int) -> None:
        self.screen.resize(rows, columns)
        self.child.setwinsize(rows, columns)  # the kernel sends SIGWINCH

    def look(self, seconds: float = 0.05) -> bool:
        """Show the output of some time; False if the program has closed its terminal."""
        # The write never blocks: a full buffer takes less, or nothing.
        with contextlib.suppress(BlockingIOError):
            del self._unsent[: os.write(self.child.child_fd, self._unsent)]
        try:
            text = self.child.read_nonblocking(65536, timeout=seconds)
        except pexpect.TIMEOUT:
            return True
        except pexpect.EOF:
            return False
        self.output += text
        self._stream.feed(text)
        return True

    def until(self, true: Callable[[], object], what: str = "") -> None:
        """Wait until a condition holds on a complete screen: a program that is drawing hides its
        cursor.
        """
        end = time.monotonic() + PATIENCE
        while self.screen.cursor.hidden or not true():
            assert time.monotonic() < end, f"{what or true} never came:\n{self.text}"
            assert self.look() or true(), f"the program ended before {what}:\n{self.text}"

    def sees(self, text: str) -> None:
        """Wait until a text is on the screen or above it."""
        self.until(lambda: text in self.text, repr(text))

    def ends(self) -> int:
        """The exit code, or the negative number of the signal that ended it."""
        end = time.monotonic() + PATIENCE
        while self.look():
            assert time.monotonic() < end, f"it never ended:\n{self.text}"
        self.child.wait()
        return -self.child.signalstatus if self.child.signalstatus else self.child.exitstatus

    @property
    def lines(self) -> list[str]:
        """The screen, without the blanks at the ends of lines."""
        return [line.rstrip() for line in self.screen.display]

    @property
    def text(self) -> str:
        """The text that has scrolled away and the text on the screen."""
        columns = range(self.screen.columns)
        above = ["".join(row[x].data for x in columns) for row in self.screen.history.top]
        return "\n".join([*(line.rstrip() for line in above), *self.lines])

    @property
    def cursor_line(self) -> str:
        return self.lines[self.screen.cursor.y]
