"""Numbers from which a program computes another number exactly."""

from collections.abc import Callable
from math import inf, nextafter

_TRIES = 8  # neighbours of a number that are tried for one that gives another exactly


def nudged(guess: float, made: Callable[[float], float], goal: float) -> float:
    """The number next to a guess of which `goal` is made exactly; the guess where there is none."""
    low = high = guess
    for _ in range(_TRIES):
        for one in (low, high):
            if made(one) == goal:
                return one
        low, high = nextafter(low, -inf), nextafter(high, inf)
    return guess
