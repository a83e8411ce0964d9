"""What was read of a text, kept for the next reading: what has not changed is read once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from ergon.notation.text.document import Line
from ergon.notation.text.errors import Collector

_Made = TypeVar("_Made")


class Memory:
    """Belongs to whoever reads one text again and again; keeps what the last two readings needed.

    What is kept may report later through the collector that it was read with, so all readings share
    one. Of a memory that `is_loose` items of long lists are read once, and keep the places where
    they stood then: such a list may grow without end.
    """

    def __init__(self, *, is_loose: bool = False) -> None:
        """Start with nothing read."""
        self.is_loose = is_loose
        self._collector = Collector()
        self._now: dict[Hashable, Any] = {}
        self._before: dict[Hashable, Any] = {}
        self.last: tuple[Any, Any] | None = None  # what was read last as a whole, and what it is
        # The lines of lists of each section, by their texts.
        self.lines: dict[tuple[str, str], dict[str, Line]] = {}
        self._held: dict[str, tuple[Any, Any]] = {}

    def begin(self, *, is_whole: bool = True) -> Collector:
        """Another reading; where it reports.

        One that is not whole, of names alone, needs little: what it leaves aside is not forgotten.
        """
        if is_whole:
            self._before, self._now = self._now, {}
        self._collector.clear()
        return self._collector

    def held(self, name: str, condition: Any) -> Any:
        """What is held under a name, if it was under an equal condition; else None."""
        known = self._held.get(name)
        return known[1] if known is not None and known[0] == condition else None

    def hold(self, name: str, condition: Any, what: Any) -> None:
        """Hold something under a name, in place of what was."""
        self._held[name] = condition, what

    def made(self, key: Hashable, make: Callable[[], _Made]) -> _Made:
        """What was made under a key, or is made now; what gave reason to report is not kept."""
        made: _Made
        if key in self._now:
            made = self._now[key]
        elif key in self._before:
            made = self._now[key] = self._before[key]
        else:
            n_reports = self._collector.told
            made = make()
            if self._collector.told == n_reports:
                self._now[key] = made
        return made
