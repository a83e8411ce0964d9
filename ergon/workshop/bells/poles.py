"""Damped exponentials in a band: their number, and their poles.

ESPRIT (Roy and Kailath, 1989), its order by ESTER (Badeau, David and Richard, 2006), polished by
variable projection (Golub and Pereyra, 1973).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ergon.workshop.bells.bands import Array, Complex

NOISE_RATIO_MIN = 24.0  # power of an exponential over that of the noise in it: below, it is none
_POLISHING_STEPS = 8  # steps
_RESIDUAL_TOLERANCE = 1e-10  # relative fall of the residual at which polishing ends
_FIRST_STEP_MAX = 0.02  # most change of a logarithm of a pole in the first step
_MODULUS_MIN = 0.3  # |z| of exponentials that are over within three samples


def fit_exponentials(signal: Complex, n_max: int) -> tuple[Complex, Complex]:
    """Poles z and amplitudes c of Σ c·z^k in a signal (n,), at most `n_max`.

    Each is far above the residual noise.
    """
    z: Complex = _esprit(signal, n_max)
    z = z[(np.abs(z) < 1.0) & (np.abs(z) > _MODULUS_MIN)]
    while z.size:  # the worst goes first, before the others are polished
        amplitudes, residual = _amplitudes(signal, z)
        signal_to_noise = _signal_to_noise(z, amplitudes, residual)
        weakest = int(np.argmin(signal_to_noise))
        if signal_to_noise[weakest] >= NOISE_RATIO_MIN:
            break
        z = _to_complex(np.delete(z, weakest))
    while z.size:
        z, amplitudes, residual = polish_poles(signal, z)
        signal_to_noise = _signal_to_noise(z, amplitudes, residual)
        weakest = int(np.argmin(signal_to_noise))
        if signal_to_noise[weakest] >= NOISE_RATIO_MIN:
            return z, amplitudes
        z = _to_complex(np.delete(z, weakest))
    return z, np.zeros(0, complex)


def _esprit(signal: Complex, n_max: int) -> Complex:
    n_samples = signal.size
    n_rows = n_samples // 2
    hankel = np.lib.stride_tricks.sliding_window_view(signal, n_samples - n_rows + 1)[:n_rows]
    _, vectors = np.linalg.eigh(hankel @ hankel.conj().T)
    vectors = vectors[:, ::-1][:, :n_max]
    # The violation of shift invariance by each order; the highest order that is nearly as good as
    # the best is chosen.
    shift_errors = np.array(
        [_shift_error(vectors[:, : order + 1]) for order in range(vectors.shape[1])]
    )
    order = int(np.flatnonzero(shift_errors.min() >= 0.1 * shift_errors).max()) + 1
    signal_vectors = vectors[:, :order]
    shift_matrix = np.linalg.lstsq(signal_vectors[:-1], signal_vectors[1:], rcond=None)[0]
    return _to_complex(np.linalg.eigvals(shift_matrix))


def _shift_error(vectors: Complex) -> float:
    upper_rows, lower_rows = vectors[:-1], vectors[1:]
    last_row = vectors[-1]
    remainder = 1.0 - float(np.vdot(last_row, last_row).real)
    shift_matrix = upper_rows.conj().T @ lower_rows
    if remainder > 1e-12:  # the pseudo-inverse of orthonormal columns without their last row
        shift_matrix = _to_complex(
            shift_matrix + np.outer(last_row.conj(), last_row @ shift_matrix) / remainder
        )
    else:
        shift_matrix = _to_complex(np.linalg.lstsq(upper_rows, lower_rows, rcond=None)[0])
    error = _to_complex(lower_rows - upper_rows @ shift_matrix)
    # The largest singular value of a narrow matrix, squared, from its Gram matrix.
    return max(float(np.linalg.eigvalsh(error.conj().T @ error)[-1]), 1e-30)


def _to_complex(values: NDArray[Any]) -> Complex:
    return values.astype(np.complex128, copy=False)


def _powers(z: Complex, n: int) -> Complex:
    return np.exp(np.arange(n)[:, None] * np.log(z))


def _amplitudes(signal: Complex, z: Complex) -> tuple[Complex, Complex]:
    basis = _powers(z, signal.size)
    amplitudes = _to_complex(np.linalg.lstsq(basis, signal, rcond=None)[0])
    return amplitudes, _to_complex(signal - basis @ amplitudes)


def _signal_to_noise(z: Complex, amplitudes: Complex, residual: Complex) -> Array:
    """Power of each amplitude over that of its noise."""
    basis = _powers(z, residual.size)
    variance = np.vdot(residual, residual).real / max(1, residual.size - 2 * z.size)
    variances = np.linalg.pinv(basis.conj().T @ basis).diagonal().real * variance
    return np.asarray(np.abs(amplitudes) ** 2 / np.maximum(variances, 1e-300))


def polish_poles(signal: Complex, z: Complex) -> tuple[Complex, Complex, Complex]:
    """Gauss-Newton on the logarithms of the poles alone, with the amplitudes projected out."""
    k = np.arange(signal.size)[:, None]
    log_poles, last_cost = np.log(z), np.inf
    best_log_poles = log_poles
    amplitudes, residual = _amplitudes(signal, z)
    for step_index in range(_POLISHING_STEPS):
        basis = np.exp(k * log_poles)
        q, _ = np.linalg.qr(basis)
        trial_c = _to_complex(np.linalg.lstsq(basis, signal, rcond=None)[0])
        trial_residual = _to_complex(signal - basis @ trial_c)
        cost = float(np.vdot(trial_residual, trial_residual).real)
        if not cost < last_cost * (1.0 - _RESIDUAL_TOLERANCE):
            break
        last_cost, best_log_poles, amplitudes, residual = (cost, log_poles, trial_c, trial_residual)
        jacobian = k * basis * trial_c
        jacobian = jacobian - q @ (q.conj().T @ jacobian)
        steps = np.linalg.lstsq(jacobian, trial_residual, rcond=None)[0]
        if step_index == 0:
            steps *= min(1.0, _FIRST_STEP_MAX / max(1e-300, float(np.abs(steps).max())))
        log_poles = log_poles + steps
        log_poles = _to_complex(np.minimum(log_poles.real, 1e-4) + 1j * log_poles.imag)
    return _to_complex(np.exp(best_log_poles)), amplitudes, residual
