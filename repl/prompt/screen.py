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
from ergon.repl.session_protocol import Reply, SignalWatch

from .assist import STYLE, Colours, Completions
from .error_boundary import ErrorBoundary
from .history import LineHistory
from .keyboard import TEXT_MAX, bindings, keyboard
from .message_throttle import MessageThrottle
from .output import INDENT, continuation, echo, reply_lines, valid_unicode
from .signals import interrupt_ends_forces
from .status import status

_REDRAW_PERIOD = 0.25  # s between two drawings while nobody types
_CHECK_PERIOD = 0.05  # s between two looks at what happened
_END_TIMEOUT = 2.0  # s; a terminal may take 1 s to report where its cursor is
_WRITE_PERIOD = 0.005  # s of output that are written together: each write redraws the prompt


class ScreenPrompt:
    """A session in a terminal."""

    def __init__(self, session: ErrorBoundary, history: Path | None, watch: SignalWatch) -> None:
        """Show a session, with the lines of earlier sessions from a file."""
        self._session = session
        self._watch = watch
        self._queue: LineQueue[None] = LineQueue(session)
        self._is_computing = False
        self._throttle = MessageThrottle()
        self._last_refusal = ("", "")  # the line, and what to type instead
        self._n_refused = 0
        self._is_leaving = False
        self._position_text = ""
        self._drawn_instant = 0.0
        self._prompt: PromptSession[None] = PromptSession(
            self._prompt_text,
            multiline=True,
            prompt_continuation=lambda width, _, wraps: "" if wraps else continuation(width),
            lexer=Colours(self._session),
            completer=Completions(self._session),
            complete_while_typing=False,
            style=STYLE,
            include_default_pygments_style=False,
            history=InMemoryHistory() if history is None else LineHistory(history),
            key_bindings=bindings(self),
            bottom_toolbar=self._toolbar,
            input=keyboard(self._on_characters),
        )
        self._app = self._prompt.app
        self._prompt.default_buffer.accept_handler = self._queue_entered

    def _toolbar(self) -> str:
        """The status line, with the drawing of a traced key above it if there is room."""
        session_state, terminal_size = self._session.state(), self._app.output.get_size()
        rows = session_state.drawing if len(session_state.drawing) < terminal_size.rows // 2 else ()
        drawing_rows = [clean(row)[: terminal_size.columns] for row in rows]
        return "\n".join([*drawing_rows, status(session_state, terminal_size.columns)])

    def run(self) -> int:
        """Serve until it is left; the number of refused lines."""
        self._watch([signal.SIGINT], ends=None)  # Ctrl-C clears what is typed
        asyncio.run(self._run())
        self._watch([signal.SIGINT], ends=True)
        for line in self._throttle.pop_all():
            print(clean(line))
        return self._n_refused

    def end(self) -> None:
        """Leave at once; may be called by a signal."""
        if loop := self._app.loop:
            loop.call_soon_threadsafe(self._exit)

    async def _run(self) -> None:
        event_loop = asyncio.get_running_loop()
        event_loop.set_exception_handler(lambda _, context: self._report_error(context))
        worker = threading.Thread(
            target=self._do_lines, args=(event_loop,), name="ergon-lines", daemon=True
        )
        with (
            StdoutProxy(_WRITE_PERIOD) as proxy,
            contextlib.redirect_stdout(proxy),
            contextlib.redirect_stderr(proxy),
        ):
            worker.start()
            app_task = event_loop.create_task(self._app.run_async(set_exception_handler=False))
            while not app_task.done():
                await asyncio.wait({app_task}, timeout=_CHECK_PERIOD)
                self._show_messages()
                if self._app.is_done:
                    # If the terminal was closed while text was printed, prompt_toolkit waits for
                    # ever.
                    await asyncio.wait({app_task}, timeout=_END_TIMEOUT)
                    app_task.cancel()
            proxy.close()
            # The loop still has to print the last output.
            if pending_tasks := asyncio.all_tasks() - {asyncio.current_task()}:
                await asyncio.wait(pending_tasks, timeout=_END_TIMEOUT)
            with contextlib.suppress(EOFError, asyncio.CancelledError), _hangup_is_end():
                await app_task

    def _show_messages(self) -> None:
        """Show new messages, and redraw the status from time to time."""
        self._throttle.add(self._session.messages())
        now = time.monotonic()
        for line in self._throttle.pop_due(now):
            print(clean(line))
        if now - self._drawn_instant >= _REDRAW_PERIOD:
            self._drawn_instant = now
            self._app.invalidate()

    # --- actions of keys ------------------------------------------------------------------------

    def panic(self) -> None:
        """End sound and force at once."""
        self._queue.panic()

    def clear(self) -> None:
        """Clear the typed text; while a line is computed, also cancel it and end all forces."""
        if self._is_computing:
            self._session.let_go()
            self._session.cancel()
        self._buffer.reset()

    def leave(self) -> None:
        """Leave when all lines are done; if pressed again, at once."""
        if self._is_leaving:
            self._exit()
        self._is_leaving = True
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
        refused_line, suggestion = self._last_refusal
        if suggestion and self._buffer.text.strip() in ("", refused_line.strip()):
            self._buffer.document = Document(suggestion)
        elif self._buffer.complete_state:
            self._buffer.complete_next()
        else:
            self._buffer.start_completion(insert_common_part=True)

    def report_too_long(self, length: int) -> None:
        """Report that a paste of `length` characters did not fit."""
        message = (
            f"not taken: a paste of {length:,} characters (a block has {TEXT_MAX:,} at most; "
            "`load` and `reload` read files)"
        )
        self._throttle.add([INDENT + message])

    def _on_characters(self, characters: str) -> None:
        """Let a stop in the typed characters act before they become keys, which takes too long."""
        typed_line, enter_key, _ = characters.partition("\r")
        if enter_key:
            self._queue.stop_now(valid_unicode(self._buffer.text + typed_line))

    # --- lines and replies ----------------------------------------------------------------------

    @property
    def _buffer(self) -> Buffer:
        return self._prompt.default_buffer

    def _prompt_text(self) -> str:
        """The prompt: it shows the present beat until text is typed, which would move if it
        changed.
        """
        if not self._position_text or not self._buffer.text:
            self._position_text = self._session.state().where
        return f"{self._position_text} > "

    def _queue_entered(self, buffer: Buffer) -> bool:
        """Queue the entered line, after those before it."""
        typed_text = valid_unicode(buffer.text)
        print(echo(f"{self._session.state().where} > ", typed_text))
        if typed_text.strip():
            self._queue.enter(typed_text, None)
        return False  # the buffer is emptied

    def _do_lines(self, loop: asyncio.AbstractEventLoop) -> None:
        """Do lines, in a separate thread, because a line may take a while."""
        with contextlib.suppress(RuntimeError):  # the loop is closed: the user left at once
            while (queued := self._queue.next()) is not None:
                self._is_computing = True
                with interrupt_ends_forces(self._watch):
                    reply = self._session.submit(queued.text, releases=queued.releases)
                self._is_computing = False
                loop.call_soon_threadsafe(self._show_reply, queued.text, reply)
                if reply.leaves:
                    return
            loop.call_soon_threadsafe(self._exit)

    def _show_reply(self, typed_text: str, reply: Reply) -> None:
        if lines := reply_lines(reply, plain=False):
            print("\n".join(lines))
        self._n_refused += not reply.taken
        self._last_refusal = (typed_text, reply.try_ or "")
        if reply.leaves:
            self._exit()

    def _exit(self) -> None:
        if self._app.is_running and not self._app.is_done:
            self._app.exit()

    def _report_error(self, context: dict[str, Any]) -> None:
        """Report an error in a key or a drawing; the prompt goes on."""
        self._session.add_error(context.get("exception") or RuntimeError(context["message"]))


@contextlib.contextmanager
def _hangup_is_end() -> Iterator[None]:
    """Treat a terminal that was closed as the end, not as an error."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.EIO:
            raise
