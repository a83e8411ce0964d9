"""What is drawn: curves over time, and the round numbers on their axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite

CURVES_MAX = 3  # more cannot be told apart without colour
_MARGIN_RATIO = 0.04  # margin as a share of the range, so that extremes are visible


@dataclass(frozen=True, slots=True)
class Curve:
    """Values `x` at the instants `t`, both (n,); a value that is not finite leaves a gap."""

    name: str
    t: Sequence[float]
    x: Sequence[float]


@dataclass(frozen=True, slots=True)
class Axis:
    """A range with ticks at round numbers within it; `tick_labels` are shown in place of the
    numbers.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    digits: int
    tick_labels: tuple[str, ...] = ()

    def text(self, tick: float) -> str:
        """The label of a tick, in the same format for all ticks of the axis."""
        if self.tick_labels:
            return self.tick_labels[self.ticks.index(tick)]
        return f"{tick:.{self.digits}f}".replace("-", "−")

    def fraction(self, value: float) -> float:
        """Where the value lies, 0 at `low` and 1 at `high`."""
        return (value - self.low) / (self.high - self.low)


def axis(values: Sequence[float], n_ticks: int, *, tight: bool = False) -> Axis:
    """An axis over all finite `values` with about `n_ticks` ticks a 1-2-5 step apart.

    `tight` ends at the values (time); otherwise there is a little room round them.
    """
    finite_values = [value for value in values if isfinite(value)]
    low, high = (min(finite_values), max(finite_values)) if finite_values else (0.0, 1.0)
    if high - low <= 1e-12 * max(abs(low), abs(high)):  # a flat line gets room on both sides
        margin = abs(low) * 0.1 or 1.0
        low, high = low - margin, high + margin
        tight = False
    tick_step, digits = _round_step((high - low) / max(n_ticks, 1))
    margin = 0.0 if tight else _MARGIN_RATIO * (high - low)
    low, high = low - margin, high + margin
    # A small tolerance, because 3 steps of 0.1 are above 0.3 in floating point.
    first_tick, last_tick = ceil(low / tick_step - 1e-9), floor(high / tick_step + 1e-9)
    ticks = tuple(index * tick_step for index in range(first_tick, last_tick + 1))
    return Axis(low, high, ticks, digits)


def _round_step(step_min: float) -> tuple[float, int]:
    """The smallest of 1, 2, 5 times a power of ten that is not below `step_min`, and its
    decimals.
    """
    exponent = 0
    while 10.0**exponent > step_min and exponent > -18:
        exponent -= 1
    while 10.0 ** (exponent + 1) <= step_min and exponent < 18:
        exponent += 1
    for step_factor in (1, 2, 5, 10):
        # Division by a whole number gives the double nearest to 0.2; multiplication by 0.1 does
        # not.
        step = step_factor * 10.0**exponent if exponent >= 0 else step_factor / 10.0**-exponent
        if step >= step_min * (1 - 1e-9):
            break
    return step, max(0, -exponent - (step_factor == 10))
