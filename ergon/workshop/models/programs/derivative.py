"""Speed and acceleration of a sampled signal, by the polynomial through the newest samples."""

from __future__ import annotations

from fractions import Fraction
from math import prod

_SIDE = 8  # samples on each side


def weights(order: int) -> list[float]:
    """Weights of pairs of samples that lie symmetrically about a middle, the innermost first
    [1/frame^order] (8,).

    For order 1, the pair is a difference of the samples 1/2, 3/2, … frames from the middle. For
    order 2, it is the sum of the samples 1, 2, … frames from the middle, minus twice the middle
    sample.
    """
    first_factor = Fraction(1, 2) if order == 1 else Fraction(1)
    offsets = [first_factor + k for k in range(_SIDE)]
    squares = [t * t for t in offsets]
    rows = []
    for t, square in zip(offsets, squares, strict=True):
        shares = prod(
            (node / (node - square) for node in squares if node != square), start=Fraction(1)
        )
        rows.append(float(shares / (2 * t if order == 1 else square)))
    return rows


def differentiated(name: str, order: int, rate: float) -> str:
    """A Faust signal, constant before it begins, differentiated `order` times with respect to
    time.
    """
    if order == 0:
        return name
    terms = []
    for k, weight in enumerate(weights(order)):
        sample_before, sample_after = f"{name}@{_SIDE + k + order - 1}", f"{name}@{_SIDE - 1 - k}"
        pair = (
            f"{sample_after} - {sample_before}"
            if order == 1
            else f"{sample_after} + {sample_before} - 2.0*{name}@{_SIDE}"
        )
        terms.append(f"({weight * rate**order!r})*({pair})")
    return " + ".join(terms)
