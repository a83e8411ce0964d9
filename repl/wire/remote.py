"""A session in another process; the prompt stays when that process ends."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, TypeVar

from ergon.repl.session_protocol import Reply, State, Suggestion

from .connection import Connection, ConnectionLostError, RequestRefusedError
from .local_socket import SocketError
from .protocol import MAX_TEXT, ProtocolError, decode_reply, decode_state, too_long_message

_CHECK_PERIOD = 0.05  # [s] between two looks at state and messages
_RECONNECT_PERIOD = 0.5  # [s] between two tries to connect again
_SHORT_TIMEOUT = 0.2  # [s] to wait for answers while a line is typed
_ANSWER_TIMEOUT = 5.0  # [s] without an answer before a message says so
Answer = TypeVar("Answer")


class RemoteSession:
    """A session at a socket; closing this leaves the session running."""

    def __init__(self, path: Path, command: str) -> None:
        """Connect; `command` is the shell command that connects again.

        Raises NoSessionError, SocketError, ProtocolError.
        """
        self._path = path
        self._join_command = command
        self._connection = Connection(path)
        self.about = self._connection.about
        self._messages: deque[str] = deque(maxlen=1000)
        self._end_event = threading.Event()
        self._end_reason = ""
        self._is_slow = False  # a quick request timed out; none is sent until one is answered
        self._is_lost = False
        try:
            self._state = decode_state(self._connection.ask("state").result(_ANSWER_TIMEOUT))
        except (ConnectionLostError, RequestRefusedError, TimeoutError) as error:
            self._connection.close()
            raise ProtocolError("the process at the socket does not answer") from error
        self._thread = threading.Thread(target=self._poll, name="ergon remote", daemon=True)
        self._thread.start()

    # --- the session's protocol ------------------------------------------------------------------

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line; waits until it is done or the connection is lost."""
        if len(text) > MAX_TEXT:
            return Reply(False, too_long_message(text))
        if self._end_reason:
            return Reply(False, "the session has ended", leaves=True)
        if self._connection.is_closed:
            return Reply(False, f"no session answers at {self._path}; ergon tries to connect again")
        try:
            reply = decode_reply(
                self._connection.ask("submit", text=text, releases=releases).result()
            )
            if reply.leaves:
                self._end_reason = text
            return reply
        except ConnectionLostError:
            if self._connection.end_reason:
                return Reply(False, "the session has ended", leaves=True)
            return Reply(
                False,
                "the connection broke before the answer came; the line may have been taken or not",
            )
        except (RequestRefusedError, ProtocolError) as error:
            return Reply(False, str(error))

    def state(self) -> State:
        """The last state that the session sent."""
        return self._state

    def messages(self) -> Sequence[str]:
        """Events since the last call."""
        messages = []
        while self._messages:
            messages.append(self._messages.popleft())
        return messages

    def panic(self) -> None:
        """End sound and force at once."""
        if self._connection.is_closed:
            self._messages.append("panic: no session answers; a session that was killed is silent")
        else:
            self._connection.ask("panic")

    def cancel(self) -> bool:
        """Ask to cancel the line of this prompt that is being computed; False if no session
        answers.
        """
        if self._connection.is_closed:
            return False
        self._connection.ask("cancel")
        return True

    def let_go(self) -> None:
        """End every force at once."""
        if not self._connection.is_closed:
            self._connection.ask("let_go")

    def end_input(self) -> None:
        """Do nothing: the session goes on, with other prompts or with none."""

    def close(self) -> None:
        """Disconnect; the session goes on."""
        if self._end_event.is_set():
            return
        self._end_event.set()
        self._thread.join()
        if not self._end_reason and self._ask_briefly(False, "leave"):
            self._messages.append(f"the music goes on; `{self._join_command}` connects to it again")
        self._connection.close()

    def end(self) -> None:
        """End the session, for all prompts."""
        if not self._connection.is_closed:
            self._ask_briefly(True, "end")

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """Completions of a line at a column."""
        suggestions: list[tuple[str, int, str]] = self._ask_briefly(
            [], "complete", line=line, cursor=cursor
        )
        return [Suggestion(text, start, hint) for text, start, hint in suggestions]

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """The kinds of a line's words, for colours."""
        tokens: list[tuple[int, int, str]] = self._ask_briefly([], "tokens", line=line)
        return [(start, end, kind) for start, end, kind in tokens]

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends the text."""
        return self._ask_briefly(True, "is_whole", text=text)

    def _ask_briefly(self, fallback: Answer, request_name: str, **request_fields: Any) -> Answer:
        """The answer to a short request, or `fallback` if it does not come soon."""
        if self._connection.is_closed or self._is_slow:
            return fallback
        try:
            answer: Answer = self._connection.ask(request_name, **request_fields).result(
                _SHORT_TIMEOUT
            )
        except TimeoutError:
            self._is_slow = True
            return fallback
        except (ConnectionLostError, RequestRefusedError):
            return fallback
        return answer

    # --- the watching thread -------------------------------------------------------------------

    def _poll(self) -> None:
        pending_state = pending_messages = _PendingAnswer()
        while (
            not self._end_event.wait(_RECONNECT_PERIOD if self._is_lost else _CHECK_PERIOD)
            and not self._end_reason
        ):
            if self._connection.is_closed:
                self._reconnect()
                continue
            connection = self._connection
            if pending_state.is_due(self._messages.append):
                pending_state = _PendingAnswer(connection.ask("state"), self._set_state)
            if pending_messages.is_due():
                pending_messages = _PendingAnswer(connection.ask("messages"), self._messages.extend)

    def _set_state(self, state_data: Any) -> None:
        self._state = decode_state(state_data)
        self._is_slow = False

    def _reconnect(self) -> None:
        """Report a lost connection, and try to connect again."""
        if self._connection.end_reason:
            self._end_reason = self._connection.end_reason
            self._messages.append(f"the session has ended ({self._end_reason})")
            return
        if not self._is_lost:
            self._is_lost = True
            journal = self.about.get("journal", "JOURNAL")
            resume_advice = (
                f"`{self._join_command} --resume {journal}` in another terminal restores it"
            )
            self._messages.append(f"the session no longer answers; {resume_advice}")
        try:
            connection = Connection(self._path)
        except (SocketError, ProtocolError):
            return
        self._connection, self.about = connection, connection.about
        self._is_lost = self._is_slow = False
        self._messages.append("the session answers again")


class _PendingAnswer:
    """A request under way, and the function that uses its answer."""

    def __init__(
        self, answer: Future[Any] | None = None, use_answer: Callable[[Any], object] | None = None
    ) -> None:
        self._answer, self._use_answer = answer, use_answer
        self._asked_instant = time.monotonic()
        self._is_reported = False

    def is_due(self, report: Callable[[str], object] | None = None) -> bool:
        """Use the answer if it has come; whether the next request can be sent."""
        if self._answer is None:
            return True
        if not self._answer.done():
            if (
                report
                and not self._is_reported
                and time.monotonic() - self._asked_instant > _ANSWER_TIMEOUT
            ):
                self._is_reported = True
                report(f"the session has not answered for {_ANSWER_TIMEOUT:.0f} s")
            return False
        if self._answer.exception() is None and self._use_answer is not None:
            with contextlib.suppress(ProtocolError, TypeError):  # the next one may be better
                self._use_answer(self._answer.result())
        return True
