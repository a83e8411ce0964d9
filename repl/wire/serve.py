"""Serves a session at a socket: prompts come and go, and none can block the session."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from ergon.repl.line_queue import LineQueue
from ergon.repl.session_protocol import Reply, SessionProtocol, SignalWatch, Sounding

from . import local_socket
from .protocol import (
    MAX_LINE,
    PROTOCOL_VERSION,
    ProtocolError,
    decode_message,
    encode,
    encode_reply,
    encode_sounding,
    encode_state,
    parse_request,
    read_request_id,
)

MAX_PROMPTS = 16
_MESSAGES_MAX = 1000  # messages that wait for a prompt; older ones are dropped
_LINES_MAX = 64  # waiting lines of one prompt
_CHECK_PERIOD = 0.05  # [s] between two checks for messages
_UNREAD_MAX = 4 * MAX_LINE  # [bytes] that a prompt may leave unread before it is dropped
_KEY_TIMEOUT = 5.0  # [s] for the first line of who joins at a port
_CLOSE_TIMEOUT = 1.0  # [s] for a prompt to read its last line
_LINE_SHOWN_MAX = 200  # characters of a line that other prompts see


class PromptConnection:
    """A connected prompt."""

    def __init__(self, number: int, writer: asyncio.StreamWriter) -> None:
        """Keep the number of the prompt and the writer to it."""
        self.number = number
        self.messages: deque[str] = deque(maxlen=_MESSAGES_MAX)
        self.n_waiting_lines = 0  # lines
        self.read_sounding: Callable[[], Sounding] | None = None  # since it first asked what sounds
        self._writer = writer

    def send(self, **message_fields: Any) -> None:
        """Send a line without waiting; a prompt that does not read is disconnected."""
        if self._writer.is_closing():
            return
        self._writer.write(encode(**message_fields))
        if self._writer.transport.get_write_buffer_size() > _UNREAD_MAX:
            self._writer.transport.abort()

    async def close(self) -> None:
        """Disconnect when the last line is read, or after a second."""
        try:
            async with asyncio.timeout(_CLOSE_TIMEOUT):
                await self._writer.drain()
                self._writer.close()
                await self._writer.wait_closed()
        except (OSError, TimeoutError):
            pass  # the prompt does not read, or has disconnected
        finally:
            self._writer.transport.abort()


class SessionServer:
    """Serves a session; `about` is sent to each prompt when it connects."""

    def __init__(
        self,
        session: SessionProtocol,
        server_socket: local_socket.ServerSocket,
        about: Mapping[str, str],
        watch: SignalWatch | None = None,
        follow: Callable[[], Callable[[], Sounding]] = lambda: _no_sound,
    ) -> None:
        """Serve a session to which no other program submits lines; `watch` receives the signals
        that end it.

        `follow` begins to look at what sounds, for a prompt that asks for it.
        """
        self._session = session
        self._watch = watch
        self._follow = follow
        self._server_socket = server_socket
        self._about = dict(about)
        self._prompts: dict[int, PromptConnection] = {}
        self._n_accepted = 0
        self._n_unidentified = 0  # connections whose key has not come
        self._queue: LineQueue[tuple[PromptConnection, Any, bool]] = LineQueue(session)
        self._end_reason = ""  # why the session ended
        self._current_prompt: PromptConnection | None = None  # the prompt whose line is being done
        self._has_ended = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._handlers: Mapping[str, Callable[..., Any]] = {
            "state": lambda prompt: encode_state(self._session.state()),
            "messages": _pop_messages,
            "sounding": self._sounding,
            "panic": lambda prompt: self._panic(prompt),
            "cancel": self._cancel,
            "let_go": lambda prompt: self._let_go(),
            "complete": self._complete,
            "tokens": lambda prompt, line: [list(token) for token in self._session.tokens(line)],
            "is_whole": lambda prompt, text: bool(self._session.is_whole(text)),
            "leave": lambda prompt: True,
            "end": lambda prompt: self._end(f"ended by prompt {prompt.number}"),
        }

    def run(self) -> None:
        """Serve until the session ends, then close it; in the main thread, SIGTERM and Ctrl-C end
        it too.
        """
        try:
            asyncio.run(self._run())
        finally:
            self._session.close()
            self._server_socket.close()

    def end(self, reason: str) -> None:
        """End the session, from any thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop has ended already
                self._loop.call_soon_threadsafe(self._end, reason)

    # --- the loop ---------------------------------------------------------------------------------

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        with _ended_by_signals(self._loop, self._end, self._watch):
            self._server_socket.listen()
            is_port = self._server_socket.address is not None
            start_server = asyncio.start_server if is_port else asyncio.start_unix_server
            server = await start_server(
                self._accept, sock=self._server_socket.socket, limit=MAX_LINE
            )
            worker = threading.Thread(target=self._do_lines, name="ergon lines", daemon=True)
            worker.start()
            message_task = asyncio.create_task(self._broadcast_messages())
            await self._has_ended.wait()
            message_task.cancel()
            # The server stays open for a moment, so that a prompt that is just connecting gets the
            # last line too.
            with contextlib.suppress(NotImplementedError):  # Windows
                self._loop.remove_reader(self._server_socket.socket)
            await asyncio.sleep(_CHECK_PERIOD)
            server.close()
            for prompt in self._prompts.values():
                prompt.send(ended=self._end_reason)
            await asyncio.gather(*(prompt.close() for prompt in self._prompts.values()))
            self._queue.end()

    def _end(self, reason: str) -> bool:
        self._end_reason = self._end_reason or reason
        self._has_ended.set()
        return True

    async def _broadcast_messages(self) -> None:
        while True:
            await asyncio.sleep(_CHECK_PERIOD)
            for message in self._read_messages():
                self._broadcast(message)

    def _read_messages(self) -> list[str]:
        try:
            return list(self._session.messages())
        except Exception as error:
            return [f"internal error: {type(error).__name__}: {error}"]

    def _broadcast(self, message: str, excluded: PromptConnection | None = None) -> None:
        for prompt in self._prompts.values():
            if prompt is not excluded:
                prompt.messages.append(message)

    # --- one prompt -------------------------------------------------------------------------------

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._n_accepted += 1
        prompt = PromptConnection(self._n_accepted, writer)
        try:
            if refusal := await self._refusal_of(reader, writer):
                prompt.send(error=refusal)
                return
            self._prompts[prompt.number] = prompt
            address = self._server_socket.address
            answer_field = {} if address is None else {"answer": address.answer}
            prompt.send(ergon=PROTOCOL_VERSION, prompt=prompt.number, **answer_field, **self._about)
            await self._serve(prompt, reader)
        except OSError:
            pass  # the prompt disconnected
        finally:
            self._prompts.pop(prompt.number, None)
            if self._has_ended.is_set():  # `_run` closes all prompts together
                writer.transport.abort()
            else:
                await prompt.close()

    async def _refusal_of(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> str:
        if self._server_socket.address is not None:
            is_ours = await self._has_key(reader)
        else:
            is_ours = local_socket.is_same_user(writer.get_extra_info("socket"))
        if not is_ours:
            return "this session belongs to another user"
        if len(self._prompts) >= MAX_PROMPTS:
            return f"{MAX_PROMPTS} prompts are connected, which is the maximum"
        return ""

    async def _has_key(self, reader: asyncio.StreamReader) -> bool:
        """Whether the first line is the key of the session's port. Few may be asked at once."""
        if self._n_unidentified >= MAX_PROMPTS:
            return False
        self._n_unidentified += 1
        try:
            async with asyncio.timeout(_KEY_TIMEOUT):
                return self._server_socket.is_client_key(await reader.readline())
        except (TimeoutError, ValueError):  # the prompt sends nothing, or a line without an end
            return False
        finally:
            self._n_unidentified -= 1

    async def _serve(self, prompt: PromptConnection, reader: asyncio.StreamReader) -> None:
        while True:
            try:
                request_line = await reader.readline()
            except ValueError:  # the rest of the long line could not be told from a new one
                prompt.send(id=None, error=f"a line has {MAX_LINE:,} bytes at most")
                return
            if not request_line.endswith(b"\n"):  # the end of input
                return
            if self._answer(prompt, request_line) == "leave":
                return

    def _answer(self, prompt: PromptConnection, line: bytes) -> str:
        """Do the request of a line; returns its name, or "" if it was refused."""
        request_id = None
        try:
            fields = decode_message(line)
            request_id = read_request_id(fields)
            request_name, request_arguments = parse_request(fields)
            if request_name == "submit":
                self._queue_line(prompt, request_id, **request_arguments)
            else:
                prompt.send(
                    id=request_id,
                    **{"is": self._handlers[request_name](prompt, **request_arguments)},
                )
            return request_name
        except ProtocolError as error:
            prompt.send(id=request_id, error=str(error))
        except Exception as error:  # an error of the session, which goes on
            prompt.send(id=request_id, error=f"internal error: {type(error).__name__}: {error}")
        return ""

    def _complete(self, prompt: PromptConnection, line: str, cursor: int) -> list[list[Any]]:
        cursor = max(0, min(cursor, len(line)))
        return [
            [completion.text, completion.start, completion.hint]
            for completion in self._session.complete(line, cursor)
        ]

    def _sounding(self, prompt: PromptConnection) -> dict[str, Any]:
        if prompt.read_sounding is None:
            prompt.read_sounding = self._follow()
        return encode_sounding(prompt.read_sounding())

    def _let_go(self) -> bool:
        self._queue.let_go()
        return True

    def _panic(self, prompt: PromptConnection) -> bool:
        self._queue.panic()
        self._broadcast(f"panic, by prompt {prompt.number}", excluded=prompt)
        return True

    def _cancel(self, prompt: PromptConnection) -> bool:
        """Cancel the line that is being done, if it is from this prompt."""
        return self._current_prompt is prompt and self._session.cancel()

    # --- lines ------------------------------------------------------------------------------------

    def _queue_line(
        self, prompt: PromptConnection, request_id: Any, text: str, releases: bool
    ) -> None:
        if prompt.n_waiting_lines >= _LINES_MAX:
            raise ProtocolError(f"{_LINES_MAX} lines of this prompt are waiting already")
        prompt.n_waiting_lines += 1
        self._queue.enter(text, (prompt, request_id, releases))

    def _do_lines(self) -> None:
        """Do lines, in a separate thread, because a line may take a while."""
        while (queued := self._queue.next()) is not None:
            (prompt, request_id, releases), line_text = queued.sender, queued.text
            self._current_prompt = prompt
            reply = self._submit(line_text, releases and queued.releases)
            self._current_prompt = None
            assert self._loop is not None
            with contextlib.suppress(RuntimeError):  # the loop is closed: the session has ended
                self._loop.call_soon_threadsafe(
                    self._send_reply, prompt, request_id, line_text, reply
                )
            if reply.leaves:
                return

    def _submit(self, text: str, releases: bool) -> Reply:
        try:
            return self._session.submit(text, releases=releases)
        except (
            BaseException
        ) as error:  # a session raises nothing; if it does, the other prompts go on
            return Reply(False, f"internal error: {type(error).__name__}: {error}")

    def _send_reply(
        self, prompt: PromptConnection, request_id: Any, line_text: str, reply: Reply
    ) -> None:
        prompt.n_waiting_lines -= 1
        prompt.send(id=request_id, **{"is": encode_reply(reply)})
        if line_text.strip():
            outcome = f"{'' if reply.taken else 'not taken: '}{reply.text}"
            line = " / ".join(line_text.split("\n"))
            shown_line = line if len(line) <= _LINE_SHOWN_MAX else f"{line[:_LINE_SHOWN_MAX]} …"
            self._broadcast(
                f"prompt {prompt.number} > {shown_line}   {outcome}".rstrip(), excluded=prompt
            )
        if reply.leaves:
            self._end(f"prompt {prompt.number}: {line_text.strip()[:_LINE_SHOWN_MAX]}")


def _no_sound() -> Sounding:
    return Sounding(0.0, ())


def _pop_messages(prompt: PromptConnection) -> list[str]:
    messages = list(prompt.messages)
    prompt.messages.clear()
    return messages


@contextlib.contextmanager
def _ended_by_signals(
    event_loop: asyncio.AbstractEventLoop,
    end_session: Callable[[str], object],
    watch: SignalWatch | None,
) -> Iterator[None]:
    """Let SIGTERM and Ctrl-C end the session in order, and ignore SIGHUP."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = (signal.SIGTERM, signal.SIGINT)
    if not hasattr(signal, "SIGHUP"):  # Windows, whose loop hears no signals
        with _ended_by_handlers(event_loop, end_session, signals):
            yield
        return
    old_handler = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    for signal_number in signals:
        event_loop.add_signal_handler(signal_number, end_session, f"ended by {signal_number.name}")
    if watch is not None:
        watch(signals, ends=True)
    try:
        yield
    finally:
        for signal_number in signals:
            event_loop.remove_signal_handler(signal_number)
        signal.signal(signal.SIGHUP, old_handler)


@contextlib.contextmanager
def _ended_by_handlers(
    loop: asyncio.AbstractEventLoop,
    end_session: Callable[[str], object],
    signals: tuple[signal.Signals, ...],
) -> Iterator[None]:
    def handle(number: int, _frame: object) -> None:
        loop.call_soon_threadsafe(end_session, f"ended by {signal.Signals(number).name}")

    old_handlers = [signal.signal(number, handle) for number in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, old_handlers, strict=True):
            signal.signal(number, handler)
