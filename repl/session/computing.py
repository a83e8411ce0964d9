"""Limits of what lines compute: a computation ends at a number of steps, or when another thread
cancels it.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from ergon._core import StoppedError, Work

# Steps of work, which are counted: some two seconds and half a minute on a machine of 2024.
LINE_STEPS = 1_500_000_000  # steps for a line
FILES_STEPS = 20_000_000_000  # steps for one that reads files, restores a version or starts


class Computations:
    """The computations of a session, the innermost last."""

    def __init__(self) -> None:
        """Begin with no computation."""
        self._thread_limit = threading.local()  # limit of each thread's last computation
        self._running_work: list[Work] = []

    @contextlib.contextmanager
    def limited(self, steps: int | None) -> Iterator[None]:
        """Limit the computation in this block. Raises StoppedError beyond the limit."""
        self._thread_limit.steps = steps
        limited_work = Work(steps)
        self._running_work.append(limited_work)
        try:
            with limited_work:
                yield
        finally:
            self._running_work.remove(limited_work)

    def cancel(self) -> bool:
        """Cancel all running computations, from any thread; False if there are none."""
        running_work = self._running_work[:]
        for work in running_work:
            work.cancel()
        return bool(running_work)

    def refusal_text(self, error: StoppedError) -> str:
        """Why a line is not taken whose computation was stopped."""
        if error.why == "cancelled":
            return "cancelled; nothing has changed"
        step_limit: int = self._thread_limit.steps
        refusal_sentence = (
            f"this line takes more than {_millions_text(step_limit)} steps to compute (visits of "
            "modules, numbers of matrices, points); nothing has changed"
        )
        if step_limit != LINE_STEPS:
            return refusal_sentence
        return (
            f"{refusal_sentence}: make it smaller, or write it into the score and type `reload`, "
            f"which has {_millions_text(FILES_STEPS)}"
        )


def _millions_text(steps: int) -> str:
    return f"{steps / 1e6:,.0f} million"
