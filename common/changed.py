"""What has changed between two nearly equal sequences."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress, count
from operator import is_not
from typing import TypeVar

_Item = TypeVar("_Item")


def changed_part(
    before: Sequence[_Item], now: Sequence[_Item]
) -> tuple[Sequence[_Item], Sequence[_Item]]:
    """What one part of a sequence was, and what it is now; before and after it the items are the
    same objects.
    """
    shared = min(len(before), len(now))
    first = next(compress(count(), map(is_not, before, now)), shared)
    if first == len(before) == len(now):
        return (), ()
    last = next(compress(count(), map(is_not, reversed(before), reversed(now))), shared)
    last = min(last, shared - first)
    return before[first : len(before) - last], now[first : len(now) - last]
