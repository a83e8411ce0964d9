"""The contact of a hammer: its stiffness, and the attenuation of high modes by a push of some
length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergon.workshop.bells.bands import Array

HAMMER_MASS = 0.008  # mass [kg]
HAMMER_SPEED = 1.0  # speed of the hammer [m/s]
DEFAULT_CONTACT_DURATION = 1e-4  # contact time if strokes do not reveal it; barely audible [s]
_TRIED_DURATIONS = np.geomspace(2e-5, 2e-2, 90)  # lengths [s]
_REACH_CYCLES = 1.2  # f·length up to which the spectrum of a push is that of half a sine
# Standard deviations of ln(attenuation) for pulses other than half-sines: at the reach, and beyond
# it, where their spectra have zeros of their own.
_REACH_DEVIATION = 0.15
_BEYOND_DEVIATION = 0.8
_LEVEL_ERROR_MIN = 0.03  # levels are no better than this, relatively
_MODES_MIN = 5  # modes within reach: fewer do not tell a length
_COST_RANGE = 4.0  # cost above the least: two standard deviations
_RANGE_RATIO_MIN = (
    2.0  # a length is told where the longest in that range is so many times the shortest
)


def spectrum(f: Array, length: float) -> Array:
    """|spectrum| of a push of half a sine `length` [s] long over that at 0 Hz, at each f [Hz]."""
    x = f * length
    near_pole = np.abs(x - 0.5) < 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.cos(np.pi * x) / (1.0 - 4.0 * x * x)
    return np.abs(np.where(near_pole, np.pi / 4.0, value))


def stiffness(
    contact_duration: float, hammer_mass: float = HAMMER_MASS, speed: float = HAMMER_SPEED
) -> float:
    """K [N/m^1.5] of a Hertz contact that stays closed for `contact_duration` [s] when a mass [kg]
    hits it at a speed [m/s].
    """
    return 1.25 * hammer_mass * float((2.943 / (contact_duration * speed**0.2)) ** 2.5)


@dataclass(frozen=True)
class Strokes:
    """Strokes at one place: levels of modes (n,), and the impulse and length [s] of each stroke.

    Impulses are relative to the hardest. Lengths are None if they cannot be determined: with a
    single stroke, with strokes that are alike, or with contacts so long that few modes are
    within reach.
    """

    levels: Array
    impulses: Array
    lengths: tuple[float | None, ...]


def fit_levels(f: Array, amplitudes: Array, errors: Array) -> Strokes:
    """The common levels of strokes at one place, from `amplitudes` and relative errors (strokes,
    n).
    """
    n_strokes = len(amplitudes)
    hardest_stroke = int(np.argmax(np.sum(amplitudes**2, axis=1)))
    if n_strokes == 1:
        return Strokes(amplitudes[0], np.ones(1), (None,))
    with np.errstate(divide="ignore"):
        stroke_log_amplitudes = np.where(
            amplitudes > 0.0, np.log(np.maximum(amplitudes, 1e-300)), -700.0
        )
    variance = np.minimum(errors, 1e3) ** 2 + _LEVEL_ERROR_MIN**2
    log_spectra, spectrum_variances = _log_spectra(f)
    # For each other stroke: the cost (tried, tried) of each pair of lengths of the hardest stroke
    # and this one.
    costs = {
        s: _length_costs(
            stroke_log_amplitudes[s] - stroke_log_amplitudes[hardest_stroke],
            variance[s] + variance[hardest_stroke],
            log_spectra,
            spectrum_variances,
        )
        for s in range(n_strokes)
        if s != hardest_stroke
    }
    total_costs = np.sum([cost.min(axis=1) for cost in costs.values()], axis=0)
    likely_indices = np.flatnonzero(total_costs <= total_costs.min() + _COST_RANGE)
    is_determined = (
        _TRIED_DURATIONS[likely_indices[-1]]
        <= _RANGE_RATIO_MIN * _TRIED_DURATIONS[likely_indices[0]]
    )
    hardest_index = int(np.argmin(total_costs)) if is_determined else int(likely_indices[0])
    length_indices = [
        hardest_index if s == hardest_stroke else int(np.argmin(costs[s][hardest_index]))
        for s in range(n_strokes)
    ]
    is_determined &= all(
        np.count_nonzero(f * _TRIED_DURATIONS[length_index] < _REACH_CYCLES) >= _MODES_MIN
        for length_index in length_indices
    )
    weights = 1.0 / (variance + spectrum_variances[length_indices])
    log_levels = stroke_log_amplitudes - log_spectra[length_indices]
    mode_log_impulses = log_levels - log_levels[hardest_stroke]
    joint_weights = weights * weights[hardest_stroke] / (weights + weights[hardest_stroke])
    impulses = np.sum(joint_weights * mode_log_impulses, axis=1) / np.sum(joint_weights, axis=1)
    log_amplitudes = np.sum(weights * (log_levels - impulses[:, None]), axis=0) / np.sum(
        weights, axis=0
    )
    lengths = tuple(
        float(_TRIED_DURATIONS[length_index]) if is_determined else None
        for length_index in length_indices
    )
    return Strokes(np.exp(log_amplitudes), np.exp(impulses), lengths)


def _log_spectra(f: Array) -> tuple[Array, Array]:
    """Logarithm of the attenuation of each mode by a push of each length, and its variance (tried,
    n).
    """
    x = f * _TRIED_DURATIONS[:, None]
    is_near = x < _REACH_CYCLES
    far_spectra = np.sqrt(0.5) / np.maximum(4.0 * x * x - 1.0, 1.0)  # without its zeros
    exact_spectra = np.stack([spectrum(f, length) for length in _TRIED_DURATIONS])
    log_spectra = np.log(np.where(is_near, np.maximum(exact_spectra, 1e-3), far_spectra))
    return log_spectra, np.where(
        is_near, _REACH_DEVIATION * (x / _REACH_CYCLES) ** 2, _BEYOND_DEVIATION
    ) ** 2


def _length_costs(
    log_ratios: Array, variance: Array, log_spectra: Array, spectrum_variances: Array
) -> Array:
    """Twice the negative log-likelihood (tried, tried) of two lengths; infinite if the second is
    shorter, because softer strokes last longer. `log_ratios` (n,) are of the second over the first.
    """
    costs = np.full((len(log_spectra), len(log_spectra)), np.inf)
    for i in range(len(log_spectra)):
        residuals = log_ratios - (log_spectra[i:] - log_spectra[i])
        total_variance = variance + spectrum_variances[i] + spectrum_variances[i:]
        total_variance[0] = variance  # equal lengths leave the same residual
        robust_means = np.median(residuals, axis=1)
        for _ in range(4):  # Huber's: a mode in a zero of the spectrum tells nothing
            weight = (
                1.0
                / np.sqrt(total_variance)
                / np.maximum(
                    np.sqrt(total_variance), _absolute_deviations(residuals, robust_means) / 2.0
                )
            )
            robust_means = np.sum(weight * residuals, axis=1) / np.sum(weight, axis=1)
        deviation = _absolute_deviations(residuals, robust_means) / np.sqrt(total_variance)
        cost = np.where(deviation < 2.0, deviation**2, 4.0 * deviation - 4.0) + np.log(
            total_variance
        )
        costs[i, i:] = np.sum(cost, axis=1)
    return costs


def _absolute_deviations(residuals: Array, means: Array) -> Array:
    return np.asarray(np.abs(residuals - means[:, None]))
