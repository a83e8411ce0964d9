"""Memory of what was read from a text, so that the next reading reads only what has changed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from operator import is_
from typing import Any, Protocol, TypeVar

from ergon.notation.text.document import Line
from ergon.notation.text.errors import Collector

_Value = TypeVar("_Value")


class Recall(Protocol):
    """Gives the stored value of a key, or makes it."""

    def __call__(self, key: Hashable, make: Callable[[], _Value], /) -> _Value:
        """The value of the key."""
        ...


def make_anew(_key: Hashable, make: Callable[[], _Value], /) -> _Value:
    """Make a value without any memory."""
    return make()


class Memory:
    """The memory of a reader that reads one text repeatedly; it keeps what the last two readings
    needed.

    A kept value may report later through the collector with which it was read, so all readings
    share one collector. If `is_loose`, sections, and items and entries of long lists, keep the
    line numbers that they had when they were read, so that the text above them can grow.
    """

    def __init__(self, *, is_loose: bool = False) -> None:
        """Start with nothing read."""
        self.is_loose = is_loose
        self.lock = threading.RLock()  # one reading at a time: all share the collector
        self._collector = Collector()
        self._new_values: dict[Hashable, Any] = {}
        self._old_values: dict[Hashable, Any] = {}
        # What was read last as a whole, and what it is.
        self.last_reading: tuple[Any, Any] | None = None
        # For each section (file, name): the lines of its lists, by their texts.
        self.lines: dict[tuple[str, str], dict[str, Line]] = {}
        self._held_values: dict[str, tuple[Any, Any]] = {}
        self._conditions: dict[str, Any] = {}

    def begin(self, *, is_whole: bool = True) -> Collector:
        """Begin another reading; returns its collector.

        A reading that is not whole, such as one of names alone, uses little: values that it does
        not use are not forgotten.
        """
        if is_whole:
            self._old_values, self._new_values = self._new_values, {}
        self._collector.clear()
        return self._collector

    def set_condition(self, file_name: str, condition: Any) -> None:
        """Forget all values of a file if its condition has changed. The meaning of its texts
        depends on the condition, as that of notes depends on the tuning. The condition of a new
        file is None.
        """
        if self._conditions.get(file_name) == condition:
            return
        self._conditions[file_name] = condition
        self._new_values, self._old_values, self._held_values, self.last_reading = {}, {}, {}, None
        for lines in self.lines.values():
            for line in lines.values():
                line.values.clear()

    def held(self, name: str, condition: Any) -> Any:
        """The value held under a name; None if there is none, or if its condition differs."""
        condition_and_value = self._held_values.get(name)
        return (
            condition_and_value[1]
            if condition_and_value is not None and condition_and_value[0] == condition
            else None
        )

    def hold(self, name: str, condition: Any, stored_value: Any) -> None:
        """Hold a value and its condition under a name, in place of the value before."""
        self._held_values[name] = condition, stored_value

    def held_for(self, name: str, *objects: Any) -> Any:
        """The value held under a name for the same objects; None if it is held for other
        objects.
        """
        condition_and_value = self._held_values.get(name)
        if condition_and_value is None or len(condition_and_value[0]) != len(objects):
            return None
        return condition_and_value[1] if all(map(is_, condition_and_value[0], objects)) else None

    def recall(self, key: Hashable, make: Callable[[], _Value]) -> _Value:
        """The stored value of a key, or a new one by `make`. A value is not stored if `make`
        reported a mistake.
        """
        new_value: _Value
        if key in self._new_values:
            new_value = self._new_values[key]
        elif key in self._old_values:
            new_value = self._new_values[key] = self._old_values[key]
        else:
            n_reports = self._collector.n_reports
            new_value = make()
            if self._collector.n_reports == n_reports:
                self._new_values[key] = new_value
        return new_value
