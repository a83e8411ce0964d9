"""Searches in rising sequences of beats that are computed on demand: as few as possible are asked
for.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from math import isfinite


def n_before(beats: Sequence[float], beat: float) -> int:
    """The number of `beats`, which rise, that lie before `beat`."""
    return first_index_from(beats.__getitem__, len(beats), beat)


def first_index_from(value_at: Callable[[int], float], n_items: int, threshold: float) -> int:
    """The first index below `n_items` at which `value_at` is not below `threshold`.

    `value_at` must rise with the index; the search begins where linear interpolation puts
    the value. Returns `n_items` if all values are below.
    """
    if not n_items or (first_value := value_at(0)) >= threshold:
        return 0
    if (last_value := value_at(n_items - 1)) < threshold:
        return n_items
    low_index, high_index = 1, n_items - 1  # at(low - 1) < wanted <= at(high)
    span = last_value - first_value
    share = (threshold - first_value) / span if isfinite(span) else 0.0
    guess, search_width = min(max(low_index, round(share * (n_items - 1))), high_index), 1
    if value_at(guess) < threshold:
        low_index = guess + 1
        while guess + search_width < high_index:
            if value_at(guess + search_width) >= threshold:
                high_index = guess + search_width
                break
            low_index, search_width = guess + search_width + 1, 2 * search_width
    else:
        high_index = guess
        while guess - search_width >= low_index:
            if value_at(guess - search_width) < threshold:
                low_index = guess - search_width + 1
                break
            high_index, search_width = guess - search_width, 2 * search_width
    return low_index + bisect_left(
        range(low_index, high_index), True, key=lambda number: value_at(number) >= threshold
    )
