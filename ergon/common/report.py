"""Messages and progress of long work, for its caller."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import TYPE_CHECKING, Self

from ergon.common.terminal import clean

if TYPE_CHECKING:
    from ergon.notation.text.errors import Diagnostic, Severity, Source


class Progress:
    """The progress of a piece of work; this base class shows nothing."""

    def __enter__(self) -> Self:
        """Begin."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End, however the work ended."""

    def update(self, n_done: int) -> None:
        """Set how much is done so far, in the unit of the total."""


class Report:
    """Receives the messages of long work; this base class drops them."""

    __slots__ = ()

    def say(self, message: str) -> None:
        """A sentence: an event, or something that a person has to do now."""

    def warn(self, message: str) -> None:
        """A warning: the work goes on."""

    def event(self, name: str, **fields: object) -> None:
        """The same as `say`, as a record for another program."""

    def diagnostics(
        self,
        diagnostics: Iterable[Diagnostic],
        sources: Mapping[str, Source],
        left_out: Mapping[Severity, int],
    ) -> None:
        """Show mistakes, warnings and notes of a score. `sources` are the texts of its files by
        name, `left_out` counts the diagnostics of each severity that are not in `diagnostics`.
        """

    def progress(self, task: str, total: int, rate: float) -> Progress:
        """Begin to show the progress of `task`: `total` frames at `rate` [Hz]; with rate 0, `total`
        items of any kind.
        """
        return Progress()

    def waiting(self, task: str) -> AbstractContextManager[None]:
        """Begin a task of unknown length; it lasts as long as this context."""
        return nullcontext()


class PrintedReport(Report):
    """Prints sentences on stderr."""

    __slots__ = ()

    def say(self, message: str) -> None:
        """A sentence: an event, or something that a person has to do now."""
        print(clean(message), file=sys.stderr)

    def warn(self, message: str) -> None:
        """A warning: the work goes on."""
        self.say(f"warning: {message}")
