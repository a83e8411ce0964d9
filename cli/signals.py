"""Signals as exceptions, so that whatever ends a run early also cleans up."""

from __future__ import annotations

import _thread
import contextlib
import signal
import socket
import sys
import threading
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from types import FrameType

Handler = Callable[[int, FrameType | None], None]
_RESEND_SECONDS = 0.01  # [s] until a signal that was lost comes again
_sending: list[int] = []  # signals that threads are sending at this moment


class Terminated(BaseException):
    """SIGTERM or SIGHUP arrived; `number` is the signal's."""

    def __init__(self, number: int) -> None:
        """Keep the signal's number: the exit code is 128 more."""
        super().__init__(number)
        self.number = number


@contextlib.contextmanager
def signals_as_exceptions(
    is_unexpected: Callable[[BaseException], bool] = lambda error: not isinstance(error, Exception),
) -> Iterator[None]:
    """SIGTERM and SIGHUP raise Terminated, so clean-up runs; a second Ctrl-C skips clean-up.

    After a signal, an exception that `is_unexpected` counts as the signal's.
    """
    arrived: list[int] = []
    over: list[bool] = []  # has an item once no signal is to come again
    finalisers: list[weakref.finalize[[int], Terminated]] = []

    def interrupt(signal_number: int, signal_frame: FrameType | None) -> None:
        if over:  # one that came again too late
            return
        if _is_rescued(signal_frame):  # an exception raised there is dropped too
            _send_again(signal_number, over)
            return
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        arrived.append(signal_number)
        raise KeyboardInterrupt

    def terminate(signal_number: int, frame: FrameType | None) -> None:
        if over:
            return
        arrived.append(signal_number)
        raise watch(Terminated(signal_number))

    def watch(error: Terminated) -> Terminated:
        # Code that looks for an attribute, as during an import, may swallow any exception: let the
        # signal come again when the exception is dropped.
        finalisers.append(weakref.finalize(error, come_again, error.number))
        return error

    def come_again(number: int) -> None:
        _send_again(number, over)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if (core := sys.modules.get("ergon._core")) is not None:  # after an earlier signal
        core.begin_again()
    handlers: dict[int, Handler] = {signal.SIGINT: interrupt, signal.SIGTERM: terminate}
    if hasattr(signal, "SIGHUP"):
        handlers[signal.SIGHUP] = terminate
    # A signal that the caller ignores (nohup) stays ignored.
    handlers_before = {
        number: signal.signal(number, handler)
        for number, handler in handlers.items()
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        with _with_rescue(handlers, over):
            yield
    except (KeyboardInterrupt, Terminated):
        raise
    except BaseException as error:
        # What a signal raises may arrive here as another exception: a panic of the core, or what an
        # import makes of it.
        if not arrived or not (is_unexpected(error) or _is_caused_by_signal(error)):
            raise
        signal_exception = (
            KeyboardInterrupt() if arrived[-1] == signal.SIGINT else Terminated(arrived[-1])
        )
        raise signal_exception from error
    finally:
        over.append(True)
        while _sending:  # signals under way must not reach the former handlers
            time.sleep(_RESEND_SECONDS)
        for finaliser in finalisers:
            finaliser.detach()
        for number, handler in handlers_before.items():
            signal.signal(number, handler)


def _is_caused_by_signal(error: BaseException) -> bool:
    """Whether an exception was made of a signal's, or raised while that was on its way."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, (KeyboardInterrupt, Terminated)):
        cause = cause.__cause__ or (None if cause.__suppress_context__ else cause.__context__)
    return cause is not None


def until_interrupted() -> None:
    """Wait until a signal's handler raises.

    A wait that only the signal itself interrupts may last for ever: the signal can arrive before
    the wait begins, or in another thread. The byte that Python writes for each signal is never
    missed.
    """
    signal_socket, wakeup_socket = socket.socketpair()
    with signal_socket, wakeup_socket:
        wakeup_socket.setblocking(False)
        wakeup_before = signal.set_wakeup_fd(wakeup_socket.fileno(), warn_on_full_buffer=False)
        try:
            while True:
                signal_socket.recv(1)
        finally:
            signal.set_wakeup_fd(wakeup_before)


def _send_again(signal_number: int, over: list[bool]) -> None:
    """Send a signal again later from a thread: here its exception would be dropped as well."""

    def send_later() -> None:
        time.sleep(_RESEND_SECONDS)
        _sending.append(signal_number)
        try:
            if not over:
                _interrupt(signal_number)
        finally:
            _sending.pop()

    # Take no lock of `threading`: a handler may have interrupted the holder of that lock.
    _thread.start_new_thread(send_later, ())


def _interrupt(signal_number: int) -> None:
    """Send a signal to the main thread, and wake it."""
    main_thread = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main_thread is not None:
        signal.pthread_kill(main_thread, signal_number)
    else:
        _thread.interrupt_main(signal.Signals(signal_number))


class _Rescue:
    """Raises a signal's exception again after Python has dropped it."""

    def __init__(self, handlers: Mapping[int, Handler], over: list[bool]) -> None:
        """`handlers` are those of the signals; once `over` has an item, no signal comes again."""
        self.handlers, self.over = handlers, over
        self.before = sys.unraisablehook

    def __call__(self, dropped: sys.UnraisableHookArgs) -> None:
        """Called by Python with an exception that it has dropped."""
        error = dropped.exc_value
        if not isinstance(error, (KeyboardInterrupt, Terminated)):
            self.before(dropped)
        elif isinstance(error, KeyboardInterrupt):  # Terminated comes again by itself
            signal.signal(signal.SIGINT, self.handlers[signal.SIGINT])
            _send_again(signal.SIGINT, self.over)


def _is_rescued(signal_frame: FrameType | None) -> bool:
    """Whether a signal came while `_Rescue` was handling a dropped exception."""
    while signal_frame is not None:
        if signal_frame.f_code is _Rescue.__call__.__code__:
            return True
        signal_frame = signal_frame.f_back
    return False


@contextlib.contextmanager
def _with_rescue(handlers: Mapping[int, Handler], over: list[bool]) -> Iterator[None]:
    """Raise a signal's exception again after Python has dropped it.

    Python drops exceptions that are raised in a finaliser or in the callback of a weak
    reference, for example during an import.
    """
    rescue = _Rescue(handlers, over)
    sys.unraisablehook = rescue
    try:
        yield
    finally:
        sys.unraisablehook = rescue.before
