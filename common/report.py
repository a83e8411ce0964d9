"""Messages and progress of long work, for whoever calls it."""

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
    """How far a piece of work is; this one shows nothing."""

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

    def at(self, done: int) -> None:
        """So many frames are done."""


class Report:
    """Receives the sentences of long work; this one drops them."""

    __slots__ = ()

    def say(self, message: str) -> None:
        """A sentence: an event, or something that a person has to do now."""

    def warn(self, message: str) -> None:
        """A warning: the work goes on."""

    def event(self, name: str, **fields: object) -> None:
        """The same as `say`, as a record for another program."""

    def diagnostics(
        self,
        found: Iterable[Diagnostic],
        sources: Mapping[str, Source],
        left_out: Mapping[Severity, int],
    ) -> None:
        """Mistakes, warnings and notes of a score, the texts of its files by name, and how many
        more of each there are."""

    def progress(self, task: str, total: int, rate: float) -> Progress:
        """How far `task` is, of `total` frames at `rate` [Hz]; without a rate (0) of whatever."""
        return Progress()

    def waiting(self, task: str) -> AbstractContextManager[None]:
        """A task begins whose length nobody knows; it lasts as long as this context."""
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
