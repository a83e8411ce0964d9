"""Numbers from which another program computes a given number exactly."""

from collections.abc import Callable
from math import inf, nextafter

_TRIES = 8  # neighbours of a number that are tried for one that gives another exactly


def nudge_to_goal(guess: float, evaluate: Callable[[float], float], goal: float) -> float:
    """The number near `guess` from which `evaluate` computes exactly `goal`; `guess` if there is
    none.
    """
    low = high = guess
    for _ in range(_TRIES):
        for candidate in (low, high):
            if evaluate(candidate) == goal:
                return candidate
        low, high = nextafter(low, -inf), nextafter(high, inf)
    return guess
