"""A wrapper that turns a session's errors into messages, so that the prompt survives them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from ergon.repl.session_protocol import Reply, SessionProtocol, State, Suggestion

Answer = TypeVar("Answer")


class ErrorBoundary:
    """A session whose calls never raise an error; it becomes a message instead."""

    def __init__(self, session: SessionProtocol) -> None:
        """Wrap a session."""
        self._session = session
        self._error_sentences: list[str] = []
        self._state = State(bar=1, beat=1.0, tempo=60.0)

    def submit(self, text: str, *, releases: bool = True) -> Reply:
        """Do a line."""
        try:
            return self._session.submit(text, releases=releases)
        except BaseException as error:
            if not _is_code_fault(error):
                raise
            return Reply(False, _error_sentence(error))

    def state(self) -> State:
        """The state, or if that fails the last known one."""
        self._state = self._try(self._session.state, self._state)
        return self._state

    def messages(self) -> Sequence[str]:
        """Messages since the last call, with the errors that were caught."""
        no_messages: Sequence[str] = ()
        messages = [*self._try(self._session.messages, no_messages), *self._error_sentences]
        self._error_sentences.clear()
        return messages

    def panic(self) -> None:
        """End sound and force at once."""
        self._try(self._session.panic, None)

    def cancel(self) -> bool:
        """Cancel the line that is being computed."""
        return self._try(self._session.cancel, False)

    def let_go(self) -> None:
        """End every force at once."""
        self._try(self._session.let_go, None)

    def end_input(self) -> None:
        """Note that no further line comes."""
        self._try(self._session.end_input, None)

    def close(self) -> None:
        """End the session."""
        self._session.close()

    def complete(self, line: str, cursor: int) -> Sequence[Suggestion]:
        """Completions of a line."""
        return self._try(lambda: self._session.complete(line, cursor), ())

    def tokens(self, line: str) -> Sequence[tuple[int, int, str]]:
        """The kinds of a line's words."""
        return self._try(lambda: self._session.tokens(line), ())

    def is_whole(self, text: str) -> bool:
        """Whether Enter ends the text."""
        return self._try(lambda: self._session.is_whole(text), True)

    def add_error(self, error: BaseException) -> None:
        """Add an error to the messages."""
        self._error_sentences.append(_error_sentence(error))

    def _try(self, call: Callable[[], Answer], fallback: Answer) -> Answer:
        try:
            return call()
        except BaseException as error:
            if not _is_code_fault(error):
                raise
            self.add_error(error)
            return fallback


def _is_code_fault(error: BaseException) -> bool:
    """Whether an error is a fault in the code; what a signal raises (Ctrl-C, SIGTERM) is not
    caught.
    """
    is_panic = type(error).__name__ == "PanicException"  # pyo3's panic, which is not an Exception
    return is_panic or isinstance(error, (Exception, SystemExit))


def _error_sentence(error: BaseException) -> str:
    return f"internal error: {type(error).__name__}: {error}".replace("\n", " ")
