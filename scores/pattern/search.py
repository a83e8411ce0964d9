"""Searches in rising sequences of beats that are computed on demand: as few as possible are asked
for.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from math import isfinite


def n_before(beats: Sequence[float], beat: float) -> int:
    """The number of `beats`, which rise, that lie before `beat`."""
    return first_from(beats.__getitem__, len(beats), beat)


def first_from(value_of_index: Callable[[int], float], count: int, least_value: float) -> int:
    """The first index below `count` at which `value_of_index` is not below `least_value`.

    `value_of_index` must rise with the index; the search begins where linear interpolation puts
    the value. Returns `count` if all values are below.
    """
    if not count or (first_value := value_of_index(0)) >= least_value:
        return 0
    if (last_value := value_of_index(count - 1)) < least_value:
        return count
    low, high = 1, count - 1  # at(low - 1) < wanted <= at(high)
    span = last_value - first_value
    share = (least_value - first_value) / span if isfinite(span) else 0.0
    guess, width = min(max(low, round(share * (count - 1))), high), 1
    if value_of_index(guess) < least_value:
        low = guess + 1
        while guess + width < high:
            if value_of_index(guess + width) >= least_value:
                high = guess + width
                break
            low, width = guess + width + 1, 2 * width
    else:
        high = guess
        while guess - width >= low:
            if value_of_index(guess - width) < least_value:
                low = guess - width + 1
                break
            high, width = guess - width, 2 * width
    return low + bisect_left(
        range(low, high), True, key=lambda number: value_of_index(number) >= least_value
    )
