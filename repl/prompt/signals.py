"""Signals while a session runs: none stops it, and those that end the program end it well."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import Protocol

# By name: not every system has all of them.
_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
_STOPPING = [getattr(signal, name) for name in ("SIGTSTP", "SIGQUIT") if hasattr(signal, name)]
Handler = Callable[[int, FrameType | None], object]


class Watch(Protocol):
    """Makes signals end forces before Python handles them, as `_core.stop_on_signals` does.

    It is to be asked whenever a handler was set, for that takes the signal over.
    """

    def __call__(self, signals: Sequence[int], *, ends: bool | None) -> None:
        """End every force and sound where the program `ends`, else every force; None: nothing."""


def unwatched(signals: Sequence[int], *, ends: bool | None) -> None:
    """Do nothing: no force is near."""


@contextlib.contextmanager
def at_work(watch: Watch) -> Iterator[None]:
    """While a line is being done, Ctrl-C ends every force instead of clearing what is typed."""
    watch([signal.SIGINT], ends=False)
    try:
        yield
    finally:
        watch([signal.SIGINT], ends=None)


@contextlib.contextmanager
def handled(handler: Handler, *signals: signal.Signals) -> Iterator[None]:
    """Set a handler for signals in this block; do nothing outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


@contextlib.contextmanager
def left_to_me() -> Iterator[None]:
    """Let threads that begin in this block leave signals to the thread that begins them.

    Where two come at once the system may give the second to another thread; then the first alone
    wakes whoever waits for a line, who goes back to wait.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, *_STOPPING, *_ENDING])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def unstopped(watch: Watch) -> Iterator[None]:
    r"""Ctrl-Z and Ctrl-\ stop nothing, also where the terminal makes signals of them."""
    # A handler rather than SIG_IGN, which programs that are started from here would inherit.
    with handled(lambda number, frame: None, *_STOPPING):
        watch(_STOPPING, ends=None)
        yield
    watch(_STOPPING, ends=True)


class Ended(BaseException):
    """SIGTERM or SIGHUP came."""


@contextlib.contextmanager
def put_off(end: Callable[[], None], watch: Watch) -> Iterator[None]:
    """SIGTERM and SIGHUP call `end`, which may raise Ended; after the block they act as ever.

    So the block has cleaned up by then; a second one does not wait for that. Forces and sound end
    at once, whatever Python does meanwhile.
    """
    came: list[int] = []

    def handler(number: int, frame: FrameType | None) -> None:
        came.append(number)
        if len(came) > 1:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        end()

    # A signal that the caller ignores (nohup) stays ignored.
    ending = [number for number in _ENDING if signal.getsignal(number) is not signal.SIG_IGN]
    with handled(handler, *ending), contextlib.suppress(Ended):
        watch(ending, ends=True)
        yield
    watch(ending, ends=True)
    for number in came:
        signal.raise_signal(number)
