"""Numbers from which another program computes a given number exactly."""

from collections.abc import Callable
from math import inf, nextafter

_TRIES = 8  # neighbours of a number that are tried for one that gives another exactly


def nudge_to_goal(guess: float, made: Callable[[float], float], goal: float) -> float:
    """The number near `guess` from which `made` computes exactly `goal`; `guess` if there is
    none.
    """
    low = high = guess
    for _ in range(_TRIES):
        for one in (low, high):
            if made(one) == goal:
                return one
        low, high = nextafter(low, -inf), nextafter(high, inf)
    return guess
