"""Signals while a session runs: none suspends it, and those that end the program end it in
order.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType

from ergon.repl.session_protocol import SignalWatch

# Looked up by name: not every system has all of them.
_TERMINATING_SIGNALS = [
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
]
_SUSPENDING_SIGNALS = [
    getattr(signal, name) for name in ("SIGTSTP", "SIGQUIT") if hasattr(signal, name)
]
Handler = Callable[[int, FrameType | None], object]


def watch_nothing(signals: Sequence[int], *, ends: bool | None) -> None:
    """Do nothing: there is no force to end."""


@contextlib.contextmanager
def interrupt_ends_forces(watch: SignalWatch) -> Iterator[None]:
    """While a line is computed, let Ctrl-C end every force instead of clearing the typed text."""
    watch([signal.SIGINT], ends=False)
    try:
        yield
    finally:
        watch([signal.SIGINT], ends=None)


@contextlib.contextmanager
def with_handler(handler: Handler, *signals: signal.Signals) -> Iterator[None]:
    """Set a handler for signals in this block; do nothing outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    old_handlers = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, old_handler in old_handlers.items():
            signal.signal(number, old_handler)


@contextlib.contextmanager
def signals_blocked_in_threads() -> Iterator[None]:
    """Block signals in threads started here, so that only the starting thread receives them.

    Otherwise, of two signals that come at once, the system may give the second to another
    thread; then only the first wakes the thread that waits for a line, which goes back to
    waiting.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    old_mask = signal.pthread_sigmask(
        signal.SIG_BLOCK, [signal.SIGINT, *_SUSPENDING_SIGNALS, *_TERMINATING_SIGNALS]
    )
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, old_mask)


@contextlib.contextmanager
def suspension_disabled(watch: SignalWatch) -> Iterator[None]:
    r"""Ctrl-Z and Ctrl-\ stop nothing, also where the terminal makes signals of them."""
    # Not SIG_IGN: programs that are started from here would inherit that.
    with with_handler(lambda number, frame: None, *_SUSPENDING_SIGNALS):
        watch(_SUSPENDING_SIGNALS, ends=None)
        yield
    watch(_SUSPENDING_SIGNALS, ends=True)


class Terminated(BaseException):
    """Raised when SIGTERM or SIGHUP came."""


@contextlib.contextmanager
def termination_deferred(end_session: Callable[[], None], watch: SignalWatch) -> Iterator[None]:
    """In this block, SIGTERM and SIGHUP call `end_session`, which may raise Terminated; afterwards
    they take effect.

    So the block can clean up first; a second signal acts at once. Forces and sound end at once,
    whatever Python is doing.
    """
    signals_received: list[int] = []

    def handler(signal_number: int, frame: FrameType | None) -> None:
        signals_received.append(signal_number)
        if len(signals_received) > 1:
            signal.signal(signal_number, signal.SIG_DFL)
            signal.raise_signal(signal_number)
        end_session()

    # A signal that the caller ignores (nohup) stays ignored.
    signals = [
        number for number in _TERMINATING_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN
    ]
    with with_handler(handler, *signals), contextlib.suppress(Terminated):
        watch(signals, ends=True)
        yield
    watch(signals, ends=True)
    for number in signals_received:
        signal.raise_signal(number)
