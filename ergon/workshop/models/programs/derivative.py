"""Speed and acceleration of a sampled signal, by the polynomial through the newest samples."""

from __future__ import annotations

from fractions import Fraction
from math import prod

_HALF_WIDTH = 8  # samples on each side


def derivative_weights(derivative_order: int) -> list[float]:
    """Weights of pairs of samples that lie symmetrically about a middle, the innermost first
    [1/frame^order] (8,).

    For order 1, the pair is a difference of the samples 1/2, 3/2, … frames from the middle. For
    order 2, it is the sum of the samples 1, 2, … frames from the middle, minus twice the middle
    sample.
    """
    first_offset = Fraction(1, 2) if derivative_order == 1 else Fraction(1)
    offsets = [first_offset + k for k in range(_HALF_WIDTH)]
    squared_offsets = [offset * offset for offset in offsets]
    pair_weights = []
    for offset, squared_offset in zip(offsets, squared_offsets, strict=True):
        lagrange_factor = prod(
            (
                other_square / (other_square - squared_offset)
                for other_square in squared_offsets
                if other_square != squared_offset
            ),
            start=Fraction(1),
        )
        pair_weights.append(
            float(lagrange_factor / (2 * offset if derivative_order == 1 else squared_offset))
        )
    return pair_weights


def differentiated(signal_name: str, derivative_order: int, rate: float) -> str:
    """A Faust signal, constant before it begins, differentiated `derivative_order` times with
    respect to time.
    """
    if derivative_order == 0:
        return signal_name
    terms = []
    for pair_index, pair_weight in enumerate(derivative_weights(derivative_order)):
        earlier, later = (
            f"{signal_name}@{_HALF_WIDTH + pair_index + derivative_order - 1}",
            f"{signal_name}@{_HALF_WIDTH - 1 - pair_index}",
        )
        pair = (
            f"{later} - {earlier}"
            if derivative_order == 1
            else f"{later} + {earlier} - 2.0*{signal_name}@{_HALF_WIDTH}"
        )
        terms.append(f"({pair_weight * rate**derivative_order!r})*({pair})")
    return " + ".join(terms)
