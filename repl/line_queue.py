"""The queue of entered lines, in which `panic` and `quit` act before their turn."""

from __future__ import annotations

from queue import SimpleQueue
from typing import Generic, NamedTuple, TypeVar

from .session_protocol import SessionProtocol, stop_of

Sender = TypeVar("Sender")


class QueuedLine(NamedTuple, Generic[Sender]):
    """A line whose turn has come; see `SessionProtocol.submit` for `releases`."""

    sender: Sender
    text: str
    releases: bool


class LineQueue(Generic[Sender]):
    """A queue of lines: one thread enters them, another does them in order.

    `panic` and `quit` act when they are entered, even while another line is being computed. They
    act again in their own turn; the lines entered before them switch neither sound nor force on
    again.
    """

    def __init__(self, session: SessionProtocol) -> None:
        """Begin with an empty queue of lines for a session."""
        self._session = session
        self._n_stops = 0  # stops that were entered
        self._last_seen_line = ""  # by `stop_now`
        self._waiting_lines: SimpleQueue[tuple[Sender, str, int] | str | None] = SimpleQueue()

    def enter(self, text: str, sender: Sender) -> None:
        """Queue a line; `panic` and `quit` act now, unless `stop_now` has already seen the line."""
        if text != self._last_seen_line:
            self.stop_now(text)
        self._last_seen_line = ""
        self._waiting_lines.put((sender, text, self._n_stops))

    def stop_now(self, line_text: str) -> None:
        """Let `panic` or `quit` act now, in a line that is about to be entered."""
        self._last_seen_line = line_text
        match stop_of(line_text):
            case "panic":
                self._n_stops += 1
                self._session.panic()
            case "quit":
                self.let_go()

    def panic(self) -> None:
        """End sound and force now, and again after the waiting lines."""
        self._n_stops += 1
        self._session.panic()
        if not self._waiting_lines.empty():
            self._waiting_lines.put("panic")

    def let_go(self) -> None:
        """End all forces now; lines that wait do not switch them on again."""
        self._n_stops += 1
        self._session.let_go()

    def end(self) -> None:
        """End the queue: no further line comes."""
        self._n_stops += 1
        self._session.end_input()
        self._waiting_lines.put(None)

    def next(self) -> QueuedLine[Sender] | None:
        """Wait for the next line; None at the end."""
        while (queued_line := self._waiting_lines.get()) is not None:
            if isinstance(queued_line, str):  # a panic also ends what lines before it began
                self._session.panic()
                continue
            sender, text, n_stops = queued_line
            return QueuedLine(sender, text, n_stops == self._n_stops)
        return None
