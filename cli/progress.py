"""The progress of long work: a bar, JSON records, or nothing."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import nan
from typing import Any, Self

from ergon.common.report import Progress

from .colour import may_colour

Record = Callable[..., None]  # an event's name, and its fields by name

_RECORD_INTERVAL = 1.0  # [s]
_WAIT_INTERVAL = 1.0  # [s]; a task that ends sooner is not shown
_DRAW_INTERVAL = 0.1  # [s] more often is flicker


class _Records(Progress):
    def __init__(self, record: Record, task: str, total: int, rate: float) -> None:
        self._record, self._task, self._total, self._rate = record, task, total, rate
        self._start_instant = self._last_instant = time.monotonic()

    def update(self, n_done: int) -> None:
        now = time.monotonic()
        if now - self._last_instant < _RECORD_INTERVAL:
            return
        self._last_instant = now
        speed, seconds_left = _estimate(n_done, self._total, self._rate, now - self._start_instant)
        fields = {"task": self._task, "frames": n_done, "total": self._total}
        self._record("progress", **fields, x_real_time=speed, left_s=seconds_left)


class _Bar(Progress):
    def __init__(self, task: str, total_steps: int, rate: float) -> None:
        # Imported here, as rich takes as long to import as the rest of the command line.
        from rich.console import Console
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Rich

        bar_columns: list[Any] = [
            TextColumn("{task.description}", markup=False),  # a name may hold brackets
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("{task.fields[speed]}"),
        ]
        console = Console(file=sys.stderr, no_color=not may_colour(sys.stderr))
        self._rich = Rich(*bar_columns, console=console, transient=True, auto_refresh=False)
        self._task = self._rich.add_task(task, total=total_steps, speed="")
        self._total, self._rate = total_steps, rate
        self._start_instant = self._last_instant = time.monotonic()

    def __enter__(self) -> Self:
        self._rich.start()
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._rich.stop()

    def update(self, n_done: int) -> None:
        now = time.monotonic()
        if now - self._last_instant < _DRAW_INTERVAL and n_done < self._total:
            return
        self._last_instant = now
        speed, seconds_left = _estimate(n_done, self._total, self._rate, now - self._start_instant)
        speed_text = (
            f"{speed:.1f} × real time, {seconds_left:.0f} s left"
            if self._rate
            else f"{seconds_left:.0f} s left"
        )
        self._rich.update(self._task, completed=n_done, speed=speed_text, refresh=True)


def _estimate(n_done: int, total_steps: int, rate: float, elapsed: float) -> tuple[float, float]:
    """(speed in times real time, or NaN without a rate; seconds left) from what was done so far."""
    if not n_done or elapsed <= 0:
        return 0.0, 0.0
    return n_done / rate / elapsed if rate else nan, elapsed * (total_steps - n_done) / n_done


def bar(
    task: str, total_steps: int, rate: float, quiet: bool, record_line: Record | None
) -> Progress:
    """A progress for `total_steps` frames at `rate` [Hz], or, with rate 0, for `total_steps` items
    of any kind.

    `record_line` writes JSON records for another program.
    """
    if quiet:
        return Progress()
    if record_line is not None:
        return _Records(record_line, task, total_steps, rate)
    return _Bar(task, total_steps, rate) if _can_redraw() else Progress()


@contextmanager
def waiting(task: str, quiet: bool) -> Iterator[None]:
    """Show a task of unknown length, and the seconds that it has taken, until it ends."""
    if quiet or not _can_redraw():
        yield
        return
    ended, start_time = threading.Event(), time.monotonic()

    def show() -> None:
        while not ended.wait(_WAIT_INTERVAL):
            sys.stderr.write(f"\r{task}: {time.monotonic() - start_time:.0f} s\x1b[K")
            sys.stderr.flush()

    thread = threading.Thread(target=show, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        if time.monotonic() - start_time >= _WAIT_INTERVAL:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def _can_redraw() -> bool:
    """Whether a line on stderr may be drawn again."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
