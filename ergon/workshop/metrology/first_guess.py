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

_CUTOFF = 25.0  # Hz: below modes, above strokes
_BAND_HZ = 100.0  # Hz: where a delay of a tick is seen
_EDGE = 0.2  # s at both ends, where a filter rings
_SLIDING_SPEED = 2e-3  # [m/s] above which dry friction has its full level
_DELAYS = np.arange(0.0, 8.5, 0.5)  # ticks


def _derivatives(signal: Floats, rate: float, cutoff_hertz: float) -> tuple[Floats, Floats, Floats]:
    """A signal through a zero-phase low-pass, and its first and second derivative, each (n,)."""
    n = signal.size
    trend = np.linspace(signal[0], signal[-1], n)  # makes the end meet the beginning
    spectrum = np.fft.rfft(signal - trend)
    frequency = np.fft.rfftfreq(n, 1 / rate)
    spectrum /= 1 + (frequency / cutoff_hertz) ** 8
    differentiator = 2j * np.pi * frequency
    trend_slope = (trend[-1] - trend[0]) / (n - 1) * rate
    return (
        np.fft.irfft(spectrum, n) + trend,
        np.fft.irfft(differentiator * spectrum, n) + trend_slope,
        np.fft.irfft(differentiator * differentiator * spectrum, n),
    )


def _equations(
    gestures: Sequence[Gesture], delay: float, cutoff_hertz: float
) -> tuple[Floats, Floats]:
    """The regressors of mass, damping, stiffness, weight and dry friction, (n, 5); forces (n,)."""
    equation_rows, equation_forces = [], []
    for gesture in gestures:
        x, v, acceleration = _derivatives(gesture.position, gesture.rate, cutoff_hertz)
        # A force is held for one tick, so its middle is half a tick after the position of that
        # tick.
        tick_numbers = np.arange(x.size)
        delayed_forces = np.interp(tick_numbers - delay - 0.5, tick_numbers, gesture.force)
        delayed_forces = _derivatives(delayed_forces, gesture.rate, cutoff_hertz)[0]
        edge_ticks = int(_EDGE * gesture.rate)
        inside = slice(edge_ticks, -edge_ticks if x.size > 4 * edge_ticks else None)
        equation_rows.append(
            np.stack([acceleration, v, x, np.ones_like(x), np.tanh(v / _SLIDING_SPEED)], 1)[inside]
        )
        equation_forces.append(delayed_forces[inside])
    regressors: Floats = np.concatenate(equation_rows)
    forces: Floats = np.concatenate(equation_forces)
    return regressors, forces


def _solved(gestures: Sequence[Gesture], delay: float, cutoff_hertz: float) -> tuple[Floats, float]:
    """Mass, damping, stiffness, weight and dry friction for a delay in ticks; the residual."""
    regressors, forces = _equations(gestures, delay, cutoff_hertz)
    solution = np.asarray(np.linalg.lstsq(regressors, forces, rcond=None)[0], np.float64)
    return solution, float(np.sum((forces - regressors @ solution) ** 2))


def first_guess(gestures: Sequence[Gesture]) -> Floats:
    """The parameters of a key without modes, (10,)."""
    delay = min(_DELAYS, key=lambda ticks: _solved(gestures, float(ticks), _BAND_HZ)[1])
    mass, damping, stiffness, weight, dry = _solved(gestures, float(delay), _CUTOFF)[0]
    guessed_row = np.zeros(N_KEY)
    guessed_row[:3] = max(mass, 1e-3), max(stiffness, 0.0), max(damping, 1e-3)
    guessed_row[INDEX["weight"]] = weight
    guessed_row[INDEX["dry"]] = max(dry, 5e-3)
    guessed_row[INDEX["delay"]] = delay / gestures[0].rate
    return guessed_row


def signed_mass(gesture: Gesture) -> tuple[float, float]:
    """The mass [kg] of a key, negative if the motor pushes the wrong way; and its certainty.

    The certainty is the mass over its standard deviation.
    """
    delay = min(_DELAYS, key=lambda ticks: _solved([gesture], float(ticks), _BAND_HZ)[1])
    matrix, equation_forces = _equations([gesture], float(delay), _CUTOFF)
    column_norms = np.sqrt(np.mean(matrix**2, axis=0))
    column_norms[column_norms == 0] = 1.0
    unit_matrix = matrix / column_norms
    square = unit_matrix.T @ unit_matrix + 1e-9 * len(unit_matrix) * np.eye(5)
    solution = np.linalg.solve(square, unit_matrix.T @ equation_forces)
    residual = equation_forces - unit_matrix @ solution
    independent = max(len(equation_forces) * 2 * _CUTOFF / gesture.rate - 5, 1.0)
    variance = (
        np.linalg.inv(square)[0, 0] * len(equation_forces) * np.mean(residual**2) / independent
    )
    return float(solution[0] / column_norms[0]), float(
        abs(solution[0]) / np.sqrt(max(variance, 1e-300))
    )
