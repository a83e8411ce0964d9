"""Covariance of fitted parameters where the residuals are correlated from tick to tick."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .gesture import Floats

# s over which residuals may be correlated: a window that is too short misses correlations, and one
# that is too long has too few independent parts to tell a variance from.
_WINDOWS = (0.0, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0)
_REFERENCE_WINDOW = 2  # the window whose correlations of parameters count
N_WINDOWS = len(_WINDOWS)


def long_run(scores: Floats, rate: float, lag_total: int) -> Floats:
    """Covariances (windows, p, p) of the sum of scores (n, p), which are correlated in time.

    Bartlett's kernel (Newey and West 1987, equation 5), as the mean square of the sums over all
    stretches of its length. A long window sees few independent stretches of the `lag_total` scores
    of all gestures, so that variances are too small; they are lifted by the square of
    `_critical_value` over that of a normal distribution.
    """
    tick_count, parameter_count = scores.shape
    sums = np.concatenate([np.zeros((1, parameter_count)), np.cumsum(scores, axis=0)])
    covariances = []
    for window in _WINDOWS:
        window_length = max(1, min(round(window * rate), tick_count // 2))
        stretch_ends = np.arange(1, tick_count + window_length)
        stretches = (
            sums[np.minimum(stretch_ends, tick_count)]
            - sums[np.maximum(stretch_ends - window_length, 0)]
        )
        variance_factor = (_critical_value(window_length / lag_total) / _critical_value(0.0)) ** 2
        covariances.append(variance_factor * (stretches.T @ stretches) / window_length)
    return np.array(covariances)


def _critical_value(tail_share: float) -> float:
    """The critical value of a two-sided test at 5 %, by the share of the data that Bartlett's
    kernel covers (Kiefer and Vogelsang 2005, table 1).
    """
    return float(np.polyval([-0.5324, 0.4160, 2.9694, 1.9600], tail_share))


def covariance(square: Floats, scores: Floats) -> Floats:
    """Covariance (p, p) of least squares with the normal matrix `square` (p, p), by covariances of
    its scores (windows, p, p).

    The variance of each parameter is the largest that a window gives.
    """
    inverse_square = np.linalg.pinv(square, hermitian=True)
    covariances = inverse_square @ scores @ inverse_square
    deviations = np.sqrt(np.einsum("wii->wi", covariances))
    reference_deviations = np.where(
        deviations[_REFERENCE_WINDOW] > 0, deviations[_REFERENCE_WINDOW], 1.0
    )
    deviation_ratios = deviations.max(axis=0) / reference_deviations
    return np.asarray(covariances[_REFERENCE_WINDOW] * np.outer(deviation_ratios, deviation_ratios))
