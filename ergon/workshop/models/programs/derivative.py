"""Speed and acceleration of a sampled signal, by the polynomial through the newest samples."""

from __future__ import annotations

from fractions import Fraction
from math import prod

_SIDE = 8  # samples on each side


def weights(derivative_order: int) -> list[float]:
    """Weights of pairs of samples that lie symmetrically about a middle, the innermost first
    [1/frame^order] (8,).

    For order 1, the pair is a difference of the samples 1/2, 3/2, … frames from the middle. For
    order 2, it is the sum of the samples 1, 2, … frames from the middle, minus twice the middle
    sample.
    """
    first_factor = Fraction(1, 2) if derivative_order == 1 else Fraction(1)
    offsets = [first_factor + k for k in range(_SIDE)]
    squares = [t * t for t in offsets]
    weight_rows = []
    for t, square in zip(offsets, squares, strict=True):
        shares = prod(
            (node / (node - square) for node in squares if node != square), start=Fraction(1)
        )
        weight_rows.append(float(shares / (2 * t if derivative_order == 1 else square)))
    return weight_rows


def differentiated(signal_name: str, derivative_order: int, rate: float) -> str:
    """A Faust signal, constant before it begins, differentiated `derivative_order` times with
    respect to time.
    """
    if derivative_order == 0:
        return signal_name
    terms = []
    for k, weight in enumerate(weights(derivative_order)):
        sample_before, sample_after = (
            f"{signal_name}@{_SIDE + k + derivative_order - 1}",
            f"{signal_name}@{_SIDE - 1 - k}",
        )
        pair = (
            f"{sample_after} - {sample_before}"
            if derivative_order == 1
            else f"{sample_after} + {sample_before} - 2.0*{signal_name}@{_SIDE}"
        )
        terms.append(f"({weight * rate**derivative_order!r})*({pair})")
    return " + ".join(terms)
