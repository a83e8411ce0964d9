"""The prompt in a terminal: a single application that runs all the time and gets every key.

If it ended with each line, the terminal would be in its normal mode in between, where Ctrl-C
kills, Ctrl-Z suspends and Ctrl-S freezes. Instead, entered lines are printed above, and the
prompt stays.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from prompt_toolkit import PromptSession
from prompt_toolkit.buffer import Buffer
from prompt_toolkit.document import Document
from prompt_toolkit.history import InMemoryHistory
from prompt_toolkit.patch_stdout import StdoutProxy

from ergon.common.terminal import clean
from ergon.repl.line_queue import LineQueue
from ergon.repl.session_protocol import Reply

from .assist import STYLE, Colours, Completions
from .error_boundary import ErrorBoundary
from .history import LineHistory
from .keyboard import TEXT_MAX, bindings, keyboard
from .message_throttle import MessageThrottle
from .output import INDENT, continuation, echo, lines_of, typed
from .signals import Watch, at_work
from .status import status

_REDRAWN = 0.25  # s between two drawings while nobody types
_LISTENED = 0.05  # s between two looks at what happened
_PATIENCE = 2.0  # s; a terminal may take 1 s to report where its cursor is
_BUNDLED = 0.005  # s of output that are written together: each write redraws the prompt


class Screen:
    """A session in a terminal."""

    def __init__(self, session: ErrorBoundary, history: Path | None, watch: Watch) -> None:
        """Show a session, with the lines of earlier sessions from a file."""
        self._session = session
        self._watch = watch
        self._queue: LineQueue[None] = LineQueue(session)
        self._at_work = False
        self._throttle = MessageThrottle()
        self._refused = ("", "")  # the line, and what to type instead
        self._refusals = 0
        self._leaving = False
        self._where = ""
        self._drawn = 0.0
        self._prompt: PromptSession[None] = PromptSession(
            self._before,
            multiline=True,
            prompt_continuation=lambda width, _, wraps: "" if wraps else continuation(width),
            lexer=Colours(self._session),
            completer=Completions(self._session),
            complete_while_typing=False,
            style=STYLE,
            include_default_pygments_style=False,
            history=InMemoryHistory() if history is None else LineHistory(history),
            key_bindings=bindings(self),
            bottom_toolbar=self._below,
            input=keyboard(self._comes),
        )
        self._app = self._prompt.app
        self._prompt.default_buffer.accept_handler = self._entered

    def _below(self) -> str:
        """The status line, with the drawing of a traced key above it if there is room."""
        state, size = self._session.state(), self._app.output.get_size()
        rows = state.drawing if len(state.drawing) < size.rows // 2 else ()
        drawn = [clean(row)[: size.columns] for row in rows]
        return "\n".join([*drawn, status(state, size.columns)])

    def run(self) -> int:
        """Serve until it is left; the number of refused lines."""
        self._watch([signal.SIGINT], ends=None)  # Ctrl-C clears what is typed
        asyncio.run(self._run())
        self._watch([signal.SIGINT], ends=True)
        for line in self._throttle.rest():
            print(clean(line))
        return self._refusals

    def end(self) -> None:
        """Leave at once; may be called by a signal."""
        if loop := self._app.loop:
            loop.call_soon_threadsafe(self._go)

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: self._went_wrong(context))
        worker = threading.Thread(target=self._work, args=(loop,), name="ergon-lines", daemon=True)
        with (
            StdoutProxy(_BUNDLED) as proxy,
            contextlib.redirect_stdout(proxy),
            contextlib.redirect_stderr(proxy),
        ):
            worker.start()
            serving = loop.create_task(self._app.run_async(set_exception_handler=False))
            while not serving.done():
                await asyncio.wait({serving}, timeout=_LISTENED)
                self._listen()
                if self._app.is_done:
                    # If the terminal was closed while text was printed, prompt_toolkit waits for
                    # ever.
                    await asyncio.wait({serving}, timeout=_PATIENCE)
                    serving.cancel()
            proxy.close()
            # The loop still has to print the last output.
            if under_way := asyncio.all_tasks() - {asyncio.current_task()}:
                await asyncio.wait(under_way, timeout=_PATIENCE)
            with contextlib.suppress(EOFError, asyncio.CancelledError), _hung_up():
                await serving

    def _listen(self) -> None:
        """Show new messages, and redraw the status from time to time."""
        self._throttle.take(self._session.messages())
        now = time.monotonic()
        for line in self._throttle.due(now):
            print(clean(line))
        if now - self._drawn >= _REDRAWN:
            self._drawn = now
            self._app.invalidate()

    # --- actions of keys ------------------------------------------------------------------------

    def panic(self) -> None:
        """End sound and force at once."""
        self._queue.panic()

    def clear(self) -> None:
        """Clear the typed text; while a line is computed, also cancel it and end all forces."""
        if self._at_work:
            self._session.let_go()
            self._session.cancel()
        self._buffer.reset()

    def leave(self) -> None:
        """Leave when all lines are done; if pressed again, at once."""
        if self._leaving:
            self._go()
        self._leaving = True
        self._queue.end()

    def enter(self) -> None:
        """Enter the text if it is complete; else begin another line of it."""
        if self._session.is_whole(self._buffer.text):
            self._buffer.validate_and_handle()
        else:
            self._buffer.insert_text("\n")

    def complete(self) -> None:
        """Insert the suggestion of the last refusal, if no other text is typed; else complete the
        word.
        """
        line, try_ = self._refused
        if try_ and self._buffer.text.strip() in ("", line.strip()):
            self._buffer.document = Document(try_)
        elif self._buffer.complete_state:
            self._buffer.complete_next()
        else:
            self._buffer.start_completion(insert_common_part=True)

    def too_long(self, length: int) -> None:
        """Report that a paste of `length` characters did not fit."""
        why = f"not taken: a paste of {length:,} characters (a line has {TEXT_MAX:,} at most)"
        self._throttle.take([INDENT + why])

    def _comes(self, data: str) -> None:
        """Let a stop in the typed characters act before they become keys, which takes too long."""
        line, enter, _ = data.partition("\r")
        if enter:
            self._queue.stop_now(typed(self._buffer.text + line))

    # --- lines and replies ----------------------------------------------------------------------

    @property
    def _buffer(self) -> Buffer:
        return self._prompt.default_buffer

    def _before(self) -> str:
        """The prompt: it shows the present beat until text is typed, which would move if it
        changed.
        """
        if not self._where or not self._buffer.text:
            self._where = self._session.state().where
        return f"{self._where} > "

    def _entered(self, buffer: Buffer) -> bool:
        """Queue the entered line, after those before it."""
        text = typed(buffer.text)
        print(echo(f"{self._session.state().where} > ", text))
        if text.strip():
            self._queue.enter(text, None)
        return False  # the buffer is emptied

    def _work(self, loop: asyncio.AbstractEventLoop) -> None:
        """Do lines, in a separate thread, because a line may take a while."""
        with contextlib.suppress(RuntimeError):  # the loop is closed: the user left at once
            while (queued := self._queue.next()) is not None:
                self._at_work = True
                with at_work(self._watch):
                    reply = self._session.submit(queued.text, releases=queued.releases)
                self._at_work = False
                loop.call_soon_threadsafe(self._answer, queued.text, reply)
                if reply.leaves:
                    return
            loop.call_soon_threadsafe(self._go)

    def _answer(self, text: str, reply: Reply) -> None:
        if lines := lines_of(reply, plain=False):
            print("\n".join(lines))
        self._refusals += not reply.taken
        self._refused = (text, reply.try_ or "")
        if reply.leaves:
            self._go()

    def _go(self) -> None:
        if self._app.is_running and not self._app.is_done:
            self._app.exit()

    def _went_wrong(self, context: dict[str, Any]) -> None:
        """Report an error in a key or a drawing; the prompt goes on."""
        self._session.mistake(context.get("exception") or RuntimeError(context["message"]))


@contextlib.contextmanager
def _hung_up() -> Iterator[None]:
    """Treat a terminal that was closed as the end, not as an error."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.EIO:
            raise
