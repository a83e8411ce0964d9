"""Time limits of lines: a computation ends at its limit, or when another thread cancels it."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from ergon._core import StoppedError, Work

LINE_SECONDS = 2.0  # [s] for a line
FILES_SECONDS = 30.0  # [s] for a line that reads files, restores a version or starts the piece


class Computing:
    """The computations of a session, the innermost last."""

    def __init__(self) -> None:
        """Begin with no computation."""
        self._limit = threading.local()  # of the last computation of each thread [s]
        self._works: list[Work] = []

    @contextlib.contextmanager
    def limited(self, seconds: float | None) -> Iterator[None]:
        """Limit the computation in this block [s]. Raises StoppedError beyond the limit."""
        self._limit.seconds = seconds
        work = Work(seconds)
        self._works.append(work)
        try:
            with work:
                yield
        finally:
            self._works.remove(work)

    def cancel(self) -> bool:
        """Cancel all running computations, from any thread; False if there are none."""
        works = self._works[:]
        for work in works:
            work.cancel()
        return bool(works)

    def refusal(self, error: StoppedError) -> str:
        """Why a line is not taken whose computation was stopped."""
        if error.why == "cancelled":
            return "cancelled; nothing has changed"
        seconds: float = self._limit.seconds
        said = f"this line takes more than {seconds:g} s to compute; nothing has changed"
        if seconds != LINE_SECONDS:
            return said
        return (
            f"{said} (make it smaller, or write it into the score and type "
            f"`reload`, which has {FILES_SECONDS:g} s)"
        )
