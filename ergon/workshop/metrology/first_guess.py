"""A first estimate of a key by linear least squares on filtered derivatives; it is biased but
close.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .parameters import INDEX, N_KEY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .gesture import Floats, Gesture

_CUTOFF_FREQUENCY = 25.0  # Hz: below modes, above strokes
_DELAY_CUTOFF_FREQUENCY = 100.0  # Hz: where a delay of a tick is seen
_EDGE_DURATION = 0.2  # s at both ends, where a filter rings
_SLIDING_SPEED = 2e-3  # [m/s] above which dry friction has its full level
_DELAYS = np.arange(0.0, 8.5, 0.5)  # ticks


def _derivatives(
    signal: Floats, rate: float, cutoff_frequency: float
) -> tuple[Floats, Floats, Floats]:
    """A signal through a zero-phase low-pass, and its first and second derivative, each (n,)."""
    n_samples = signal.size
    trend = np.linspace(signal[0], signal[-1], n_samples)  # makes the end meet the beginning
    spectrum = np.fft.rfft(signal - trend)
    frequency = np.fft.rfftfreq(n_samples, 1 / rate)
    spectrum /= 1 + (frequency / cutoff_frequency) ** 8
    differentiator = 2j * np.pi * frequency
    trend_slope = (trend[-1] - trend[0]) / (n_samples - 1) * rate
    return (
        np.fft.irfft(spectrum, n_samples) + trend,
        np.fft.irfft(differentiator * spectrum, n_samples) + trend_slope,
        np.fft.irfft(differentiator * differentiator * spectrum, n_samples),
    )


def _regression(
    gestures: Sequence[Gesture], delay: float, cutoff_frequency: float
) -> tuple[Floats, Floats]:
    """The regressors of mass, damping, stiffness, weight and dry friction, (n, 5); forces (n,)."""
    regressor_blocks, force_blocks = [], []
    for gesture in gestures:
        x, v, acceleration = _derivatives(gesture.position, gesture.rate, cutoff_frequency)
        # A force is held for one tick, so its middle is half a tick after the position of that
        # tick.
        ticks = np.arange(x.size)
        delayed_forces = np.interp(ticks - delay - 0.5, ticks, gesture.force)
        delayed_forces = _derivatives(delayed_forces, gesture.rate, cutoff_frequency)[0]
        n_edge = int(_EDGE_DURATION * gesture.rate)
        inside = slice(n_edge, -n_edge if x.size > 4 * n_edge else None)
        regressor_blocks.append(
            np.stack([acceleration, v, x, np.ones_like(x), np.tanh(v / _SLIDING_SPEED)], 1)[inside]
        )
        force_blocks.append(delayed_forces[inside])
    regressors: Floats = np.concatenate(regressor_blocks)
    forces: Floats = np.concatenate(force_blocks)
    return regressors, forces


def _least_squares(
    gestures: Sequence[Gesture], delay: float, cutoff_frequency: float
) -> tuple[Floats, float]:
    """Mass, damping, stiffness, weight and dry friction for a delay in ticks; the residual."""
    regressors, forces = _regression(gestures, delay, cutoff_frequency)
    solution = np.asarray(np.linalg.lstsq(regressors, forces, rcond=None)[0], np.float64)
    return solution, float(np.sum((forces - regressors @ solution) ** 2))


def first_guess(gestures: Sequence[Gesture]) -> Floats:
    """The parameters of a key without modes, (10,)."""
    delay = min(
        _DELAYS,
        key=lambda ticks: _least_squares(gestures, float(ticks), _DELAY_CUTOFF_FREQUENCY)[1],
    )
    mass, damping, stiffness, weight, dry = _least_squares(
        gestures, float(delay), _CUTOFF_FREQUENCY
    )[0]
    parameters = np.zeros(N_KEY)
    parameters[:3] = max(mass, 1e-3), max(stiffness, 0.0), max(damping, 1e-3)
    parameters[INDEX["weight"]] = weight
    parameters[INDEX["dry"]] = max(dry, 5e-3)
    parameters[INDEX["delay"]] = delay / gestures[0].rate
    return parameters


def signed_mass(gesture: Gesture) -> tuple[float, float]:
    """The mass [kg] of a key, negative if the motor pushes the wrong way; and its certainty.

    The certainty is the mass over its standard deviation.
    """
    delay = min(
        _DELAYS,
        key=lambda ticks: _least_squares([gesture], float(ticks), _DELAY_CUTOFF_FREQUENCY)[1],
    )
    regressors, forces = _regression([gesture], float(delay), _CUTOFF_FREQUENCY)
    column_norms = np.sqrt(np.mean(regressors**2, axis=0))
    column_norms[column_norms == 0] = 1.0
    scaled_regressors = regressors / column_norms
    normal_matrix = scaled_regressors.T @ scaled_regressors + 1e-9 * len(
        scaled_regressors
    ) * np.eye(5)
    solution = np.linalg.solve(normal_matrix, scaled_regressors.T @ forces)
    residual = forces - scaled_regressors @ solution
    n_independent = max(len(forces) * 2 * _CUTOFF_FREQUENCY / gesture.rate - 5, 1.0)
    variance = (
        np.linalg.inv(normal_matrix)[0, 0] * len(forces) * np.mean(residual**2) / n_independent
    )
    return float(solution[0] / column_norms[0]), float(
        abs(solution[0]) / np.sqrt(max(variance, 1e-300))
    )
