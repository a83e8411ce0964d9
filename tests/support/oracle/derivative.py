"""Speed and acceleration of a sampled signal, from the conditions that define their formulas.

Both use the 16 or 17 newest samples and are exact for every polynomial that so many samples
determine: their weights solve that system, in rational numbers. Before the first sample the
signal is constant.
"""

from fractions import Fraction

import numpy as np

SIDE = 8


def weights(order: int) -> list[Fraction]:
    """Weights of samples from the oldest to the newest, a frame apart, for the derivative in their
    middle.
    """
    middle = Fraction(2 * SIDE - 1, 2) if order == 1 else Fraction(SIDE)
    index = [Fraction(i) - middle for i in range(2 * SIDE if order == 1 else 2 * SIDE + 1)]
    # Σ w·t^p is the derivative of t^p at 0, for every power p.
    rows = [
        [t**p for t in index] + [Fraction(order if p == order else 0)] for p in range(len(index))
    ]
    for i in range(len(rows)):  # Gauss and Jordan
        pivot = next(j for j in range(i, len(rows)) if rows[j][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for j in range(len(rows)):
            if j != i and rows[j][i]:
                factor = rows[j][i]
                rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    return [row[-1] for row in rows]


def differentiated(x: np.ndarray, order: int, rate: float) -> np.ndarray:
    """The samples (n_frames,) at `rate` [Hz], differentiated `order` times (0 to 2) by time."""
    if order == 0:
        return x
    taps = np.array([float(w) for w in weights(order)])
    before = np.full(len(taps) - 1, x[0])
    # Differences from the first sample: the weights of a derivative add up to 0.
    padded = np.concatenate([before, x]) - x[0]
    return np.convolve(padded, taps[::-1], "valid") * rate**order
