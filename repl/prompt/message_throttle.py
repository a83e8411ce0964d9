"""Messages at a readable pace: a limited number a second, with repeated messages combined."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

PER_SECOND = 10
SECOND = 1.0
HELD_MAX = 100  # different messages that wait: ten seconds of them


class MessageThrottle:
    """Collects messages as they come and returns lines when they may be shown."""

    def __init__(self) -> None:
        """Begin without messages."""
        self._counts_by_message: dict[str, int] = {}
        self._n_dropped = 0
        self._shown_messages: deque[tuple[float, str]] = deque()  # within the last second

    def add(self, messages: Iterable[str]) -> None:
        """Keep messages until they may be shown."""
        for message in messages:
            if message in self._counts_by_message or len(self._counts_by_message) < HELD_MAX:
                self._counts_by_message[message] = self._counts_by_message.get(message, 0) + 1
            else:
                self._n_dropped += 1

    def pop_due(self, now: float) -> list[str]:
        """The lines to show now [s]: at most ten in any second, and no message twice."""
        while self._shown_messages and now - self._shown_messages[0][0] >= SECOND:
            self._shown_messages.popleft()
        recent_messages = {message for _, message in self._shown_messages}
        due_messages: list[str] = []
        for message in [
            message for message in self._counts_by_message if message not in recent_messages
        ]:
            if len(self._shown_messages) >= PER_SECOND:
                return due_messages
            due_messages.append(_with_count(message, self._counts_by_message.pop(message)))
            self._shown_messages.append((now, message))
        if (
            self._n_dropped
            and not self._counts_by_message
            and len(self._shown_messages) < PER_SECOND
        ):
            due_messages.append(f"… {self._n_dropped} more messages")
            self._shown_messages.append((now, due_messages[-1]))
            self._n_dropped = 0
        return due_messages

    def pop_all(self) -> list[str]:
        """All messages that were not shown yet."""
        message_lines = [
            _with_count(message, count) for message, count in self._counts_by_message.items()
        ]
        if self._n_dropped:
            message_lines.append(f"… {self._n_dropped} more messages")
        self._counts_by_message.clear()
        self._n_dropped = 0
        return message_lines


def _with_count(message: str, count: int) -> str:
    return message if count == 1 else f"{message} … {count - 1} more like it"
