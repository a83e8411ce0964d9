"""Signals as exceptions, so that whatever ends a run early also cleans up."""

from __future__ import annotations

import _thread
import contextlib
import signal
import sys
import threading
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
    arrived: list[BaseException] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        arrived.append(KeyboardInterrupt())
        raise arrived[-1]

    def terminate(number: int, frame: FrameType | None) -> None:
        arrived.append(Terminated(number))
        raise arrived[-1]

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
        # The core looks for numpy when it is first given an array. A signal that arrives meanwhile
        # ends that import, and the core panics.
        raise arrived[-1] if arrived else panic from None
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
        number = error.number if isinstance(error, Terminated) else signal.SIGINT
        signal.signal(number, handlers[number])
        # Not from here, where it would be dropped as well.
        again = threading.Timer(_AGAIN, _interrupt, (number,))
        again.daemon = True
        again.start()

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
