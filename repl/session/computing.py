"""What a line may take: it is computed within a time, and can be dropped from another thread."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from ergon._core import StoppedError, Work

LINE = 2.0  # [s] for a line
FILES = 30.0  # [s] for one that reads files, goes back to a version, or lets a piece begin


class Computing:
    """The computations of a session, the innermost last."""

    def __init__(self) -> None:
        """Begin with none."""
        self.seconds: float | None = None  # that the last one had
        self._works: list[Work] = []

    @contextlib.contextmanager
    def within(self, seconds: float | None) -> Iterator[None]:
        """Compute for so long at most [s]; what takes longer raises StoppedError."""
        self.seconds = seconds
        work = Work(seconds)
        self._works.append(work)
        try:
            with work:
                yield
        finally:
            self._works.remove(work)

    def cancel(self) -> bool:
        """End what is being computed, from any thread; whether anything is."""
        works = self._works[:]
        for work in works:
            work.cancel()
        return bool(works)

    def refusal(self, error: StoppedError) -> str:
        """Why a line that was stopped is not taken."""
        if error.why == "cancelled":
            return "cancelled; nothing has changed"
        said = f"this line takes more than {self.seconds:g} s to compute; nothing has changed"
        if self.seconds != LINE:
            return said
        return (
            f"{said} (make it smaller, or write it into the score and type "
            f"`reload`, which has {FILES:g} s)"
        )
