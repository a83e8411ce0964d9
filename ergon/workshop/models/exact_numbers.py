"""Numbers from which another program computes a given number exactly."""

from collections.abc import Callable
from math import inf, nextafter

_TRIES = 8  # neighbours of a number that are tried for one that gives another exactly


def nudge_to_goal(guess: float, evaluate: Callable[[float], float], goal: float) -> float:
    """The number near `guess` from which `evaluate` computes exactly `goal`; `guess` if there is
    none.
    """
    low_guess = high_guess = guess
    for _ in range(_TRIES):
        for candidate in (low_guess, high_guess):
            if evaluate(candidate) == goal:
                return candidate
        low_guess, high_guess = nextafter(low_guess, -inf), nextafter(high_guess, inf)
    return guess
