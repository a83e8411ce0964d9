"""Sweeps: a few of their cases run in `make test`, all of them in `make test-long`."""

from collections.abc import Collection, Iterable, Sequence
from itertools import product
from typing import Any

import pytest


def few(cases: Iterable[Any], shown: Collection[Any] | int) -> list[Any]:
    """Cases for `parametrize`: all are marked slow except those in `shown`, or the first few.

    A case that is a tuple has a value for each of several arguments.
    """
    cases = list(cases)
    if isinstance(shown, int):
        shown = cases[:shown]
    assert shown, "a test that never runs"
    assert all(one in cases for one in shown), "a case that the sweep does not have"
    return [one if one in shown else _slow(one) for one in cases]


def crossed(first: Sequence[Any], *others: Sequence[Any]) -> list[Any]:
    """Every combination; one is shown for each value of the first, with the others in turn."""
    shown = [(one, *(each[at % len(each)] for each in others)) for at, one in enumerate(first)]
    return few(product(first, *others), shown)


def _slow(case: Any) -> Any:
    # A tuple with one value is the value of an argument that takes tuples.
    values = case if isinstance(case, tuple) and len(case) > 1 else (case,)
    return pytest.param(*values, marks=pytest.mark.slow)
