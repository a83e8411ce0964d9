"""Searching beats that are worked out one by one: as few as possible are asked for."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from math import isfinite


def n_before(beats: Sequence[float], beat: float) -> int:
    """How many of some rising beats lie before another."""
    return first_from(beats.__getitem__, len(beats), beat)


def first_from(at: Callable[[int], float], count: int, wanted: float) -> int:
    """The first of `count` numbers whose value is not below the one that is wanted.

    `at` rises with its number; the search begins where an even line has the value. Returns `count`
    where all are below.
    """
    if not count or (first := at(0)) >= wanted:
        return 0
    if (last := at(count - 1)) < wanted:
        return count
    low, high = 1, count - 1  # at(low - 1) < wanted <= at(high)
    span = last - first
    share = (wanted - first) / span if isfinite(span) else 0.0
    guess, width = min(max(low, round(share * (count - 1))), high), 1
    if at(guess) < wanted:
        low = guess + 1
        while guess + width < high:
            if at(guess + width) >= wanted:
                high = guess + width
                break
            low, width = guess + width + 1, 2 * width
    else:
        high = guess
        while guess - width >= low:
            if at(guess - width) < wanted:
                low = guess - width + 1
                break
            high, width = guess - width, 2 * width
    return low + bisect_left(range(low, high), True, key=lambda number: at(number) >= wanted)
