"""What has changed between two nearly equal sequences."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress, count
from operator import is_not
from typing import Generic, NamedTuple, TypeVar

_Item = TypeVar("_Item")
_Value = TypeVar("_Value")


class Changed(NamedTuple, Generic[_Item]):
    """The part of a sequence from index `start` on that has changed: its items `before`, and
    `now`.
    """

    start: int
    before: Sequence[_Item]
    now: Sequence[_Item]

    def __bool__(self) -> bool:
        """Whether there is such a part."""
        return bool(self.before or self.now)

    def put(self, known: Sequence[_Value], new: Sequence[_Value]) -> list[_Value]:
        """The values of all items: those `known` of the sequence before, `new` for its changed
        part.
        """
        return [*known[: self.start], *new, *known[self.start + len(self.before) :]]


def changed_part(before: Sequence[_Item], now: Sequence[_Item]) -> Changed[_Item]:
    """The part in which two sequences differ; before and after it the items are the same
    objects.
    """
    if before is now:
        return Changed(len(now), (), ())
    shared = min(len(before), len(now))
    first = next(compress(count(), map(is_not, before, now)), shared)
    if first == len(before) == len(now):
        return Changed(first, (), ())
    last = next(compress(count(), map(is_not, reversed(before), reversed(now))), shared)
    last = min(last, shared - first)
    return Changed(first, before[first : len(before) - last], now[first : len(now) - last])
