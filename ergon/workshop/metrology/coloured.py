"""Covariance of fitted parameters where the residuals are correlated from tick to tick."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .gesture import Floats

# s over which residuals may be correlated: a window that is too short misses correlations, and one
# that is too long has too few independent parts to tell a variance from.
_WINDOW_DURATIONS = (0.0, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0)
_REFERENCE_WINDOW_INDEX = 2  # the window whose correlations of parameters count
N_WINDOWS = len(_WINDOW_DURATIONS)


def long_run_covariances(scores: Floats, rate: float, n_scores_total: int) -> Floats:
    """Covariances (windows, p, p) of the sum of scores (n, p), which are correlated in time.

    Bartlett's kernel (Newey and West 1987, equation 5), as the mean square of the sums over all
    stretches of its length. A long window sees few independent stretches of the `n_scores_total`
    scores of all gestures, so that variances are too small; they are lifted by the square of
    `_critical_value` over that of a normal distribution.
    """
    n_ticks, n_parameters = scores.shape
    sums = np.concatenate([np.zeros((1, n_parameters)), np.cumsum(scores, axis=0)])
    covariances = []
    for window in _WINDOW_DURATIONS:
        window_length = max(1, min(round(window * rate), n_ticks // 2))
        window_ends = np.arange(1, n_ticks + window_length)
        window_sums = (
            sums[np.minimum(window_ends, n_ticks)]
            - sums[np.maximum(window_ends - window_length, 0)]
        )
        variance_factor = (
            _critical_value(window_length / n_scores_total) / _critical_value(0.0)
        ) ** 2
        covariances.append(variance_factor * (window_sums.T @ window_sums) / window_length)
    return np.array(covariances)


def _critical_value(kernel_share: float) -> float:
    """The critical value of a two-sided test at 5 %, by the share of the data that Bartlett's
    kernel covers (Kiefer and Vogelsang 2005, table 1).
    """
    return float(np.polyval([-0.5324, 0.4160, 2.9694, 1.9600], kernel_share))


def covariance(normal_matrix: Floats, score_covariances: Floats) -> Floats:
    """Covariance (p, p) of least squares with the normal matrix `normal_matrix` (p, p), by
    covariances of its scores (windows, p, p).

    The variance of each parameter is the largest that a window gives.
    """
    inverse = np.linalg.pinv(normal_matrix, hermitian=True)
    covariances = inverse @ score_covariances @ inverse
    deviations = np.sqrt(np.einsum("wii->wi", covariances))
    reference_deviations = np.where(
        deviations[_REFERENCE_WINDOW_INDEX] > 0, deviations[_REFERENCE_WINDOW_INDEX], 1.0
    )
    deviation_ratios = deviations.max(axis=0) / reference_deviations
    return np.asarray(
        covariances[_REFERENCE_WINDOW_INDEX] * np.outer(deviation_ratios, deviation_ratios)
    )
