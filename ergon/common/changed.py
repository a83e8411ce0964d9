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

    def put(self, old_values: Sequence[_Value], new: Sequence[_Value]) -> list[_Value]:
        """The values of all items: those `old_values` of the sequence before, `new` for its changed
        part.
        """
        return [*old_values[: self.start], *new, *old_values[self.start + len(self.before) :]]


def changed_part(old_values: Sequence[_Item], new_values: Sequence[_Item]) -> Changed[_Item]:
    """The part in which two sequences differ; before and after it the items are the same
    objects.
    """
    if old_values is new_values:
        return Changed(len(new_values), (), ())
    shared_count = min(len(old_values), len(new_values))
    first_changed = next(compress(count(), map(is_not, old_values, new_values)), shared_count)
    if first_changed == len(old_values) == len(new_values):
        return Changed(first_changed, (), ())
    n_same_at_end = next(
        compress(count(), map(is_not, reversed(old_values), reversed(new_values))), shared_count
    )
    n_same_at_end = min(n_same_at_end, shared_count - first_changed)
    return Changed(
        first_changed,
        old_values[first_changed : len(old_values) - n_same_at_end],
        new_values[first_changed : len(new_values) - n_same_at_end],
    )
