"""What is drawn: curves over time, and the round numbers on their axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, isfinite

CURVES_MAX = 3  # more cannot be told apart without colour
_MARGIN_SHARE = 0.04  # margin as a share of the range, so that extremes are visible


@dataclass(frozen=True, slots=True)
class Curve:
    """Values `x` at the instants `t`, both (n,); a value that is not finite leaves a gap."""

    name: str
    t: Sequence[float]
    x: Sequence[float]


@dataclass(frozen=True, slots=True)
class Axis:
    """A range with ticks at round numbers within it; `names` are labels to show in place of the
    numbers.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    digits: int
    names: tuple[str, ...] = ()

    def text(self, tick: float) -> str:
        """The label of a tick, in the same format for all ticks of the axis."""
        if self.names:
            return self.names[self.ticks.index(tick)]
        return f"{tick:.{self.digits}f}".replace("-", "−")

    def part(self, value: float) -> float:
        """Where the value lies, 0 at `low` and 1 at `high`."""
        return (value - self.low) / (self.high - self.low)


def axis(shown_values: Sequence[float], n_ticks: int, *, tight: bool = False) -> Axis:
    """An axis over all finite `shown_values` with about `n_ticks` ticks a 1-2-5 step apart.

    `tight` ends at the values (time); otherwise there is a little room round them.
    """
    finite_values = [value for value in shown_values if isfinite(value)]
    low_value, high_value = (
        (min(finite_values), max(finite_values)) if finite_values else (0.0, 1.0)
    )
    if high_value - low_value <= 1e-12 * max(
        abs(low_value), abs(high_value)
    ):  # a flat line gets room on both sides
        margin = abs(low_value) * 0.1 or 1.0
        low_value, high_value = low_value - margin, high_value + margin
        tight = False
    tick_step, digits = _step((high_value - low_value) / max(n_ticks, 1))
    margin = 0.0 if tight else _MARGIN_SHARE * (high_value - low_value)
    low_value, high_value = low_value - margin, high_value + margin
    # A small tolerance, because 3 steps of 0.1 are above 0.3 in floating point.
    first_tick, last_tick = ceil(low_value / tick_step - 1e-9), floor(high_value / tick_step + 1e-9)
    ticks = tuple(index * tick_step for index in range(first_tick, last_tick + 1))
    return Axis(low_value, high_value, ticks, digits)


def _step(step_min: float) -> tuple[float, int]:
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
