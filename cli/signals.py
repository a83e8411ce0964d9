"""Signals as exceptions, so that whatever ends a run early also cleans up."""

from __future__ import annotations

import _thread
import contextlib
import signal
import socket
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from types import FrameType

Handler = Callable[[int, FrameType | None], None]
_AGAIN = 0.01  # [s] until a signal that was lost comes again


class Terminated(BaseException):
    """SIGTERM or SIGHUP arrived; `number` is the signal's."""

    def __init__(self, number: int) -> None:
        """Keep the signal's number: the exit code is 128 more."""
        super().__init__(number)
        self.number = number


@contextlib.contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """SIGTERM and SIGHUP raise Terminated, so clean-up runs; a second Ctrl-C skips clean-up."""
    arrived: list[int] = []
    returning: list[threading.Timer] = []  # signals that were lost, and come again
    watched: list[weakref.finalize[[int], Terminated]] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        arrived.append(number)
        raise KeyboardInterrupt

    def terminate(number: int, frame: FrameType | None) -> None:
        arrived.append(number)
        raise watch(Terminated(number))

    def watch(error: Terminated) -> Terminated:
        # What looks whether an attribute is there, as while it imports, may swallow any exception.
        watched.append(weakref.finalize(error, come_again, error.number))
        return error

    def come_again(number: int) -> None:
        returning.append(_again(number))

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if (core := sys.modules.get("ergon._core")) is not None:  # this process has outlived a signal
        core.begin_again()
    handlers: dict[int, Handler] = {signal.SIGINT: interrupt, signal.SIGTERM: terminate}
    if hasattr(signal, "SIGHUP"):
        handlers[signal.SIGHUP] = terminate
    # A signal that the caller ignores (nohup) stays ignored.
    before = {
        number: signal.signal(number, handler)
        for number, handler in handlers.items()
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        with _not_lost(handlers):
            yield
    except (KeyboardInterrupt, Terminated, Exception):
        raise
    except BaseException as panic:
        # What a signal ends inside the core may be a panic of the core.
        if not arrived:
            raise
        ended = KeyboardInterrupt() if arrived[-1] == signal.SIGINT else Terminated(arrived[-1])
        raise ended from panic
    finally:
        for lost in watched:
            lost.detach()
        for timer in returning:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def until_interrupted() -> None:
    """Wait until a signal's handler raises.

    A wait that only the signal itself interrupts may last for ever: the signal can come before the
    wait begins, or to another thread. The byte that Python writes for each signal is never missed.
    """
    ours, pythons = socket.socketpair()
    with ours, pythons:
        pythons.setblocking(False)
        before = signal.set_wakeup_fd(pythons.fileno(), warn_on_full_buffer=False)
        try:
            while True:
                ours.recv(1)
        finally:
            signal.set_wakeup_fd(before)


def _again(number: int) -> threading.Timer:
    """Let a signal come again, not from here, where its exception would be dropped as well."""
    timer = threading.Timer(_AGAIN, _interrupt, (number,))
    timer.daemon = True
    timer.start()
    return timer


def _interrupt(number: int) -> None:
    """Let a signal come to the main thread, and wake it."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:
        _thread.interrupt_main(signal.Signals(number))


@contextlib.contextmanager
def _not_lost(handlers: Mapping[int, Handler]) -> Iterator[None]:
    """Raise a signal's exception again where Python has dropped it.

    It drops what is raised in a finaliser or a weak reference's callback, as while it imports.
    """
    before = sys.unraisablehook

    def hook(dropped: sys.UnraisableHookArgs) -> None:
        error = dropped.exc_value
        if not isinstance(error, (KeyboardInterrupt, Terminated)):
            before(dropped)
            return
        if isinstance(error, KeyboardInterrupt):  # Terminated comes again by itself
            signal.signal(signal.SIGINT, handlers[signal.SIGINT])
            _again(signal.SIGINT)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
