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
_POLISH = 8  # steps
_RESIDUAL_TOLERANCE = 1e-10  # relative fall of the residual at which polishing ends
_FIRST_STEP = 0.02  # most change of a logarithm of a pole in the first step
_MODULUS_MIN = 0.3  # |z| of exponentials that are over within three samples


def exponentials(band_signal: Complex, count_max: int) -> tuple[Complex, Complex]:
    """Poles z and amplitudes c of Σ c·z^k in a signal (n,), at most `count_max`.

    Each is far above the residual noise.
    """
    z: Complex = _esprit(band_signal, count_max)
    z = z[(np.abs(z) < 1.0) & (np.abs(z) > _MODULUS_MIN)]
    while z.size:  # the worst goes first, before the others are polished
        pole_amplitudes, residual = _amplitudes(band_signal, z)
        scores = _scores(z, pole_amplitudes, residual)
        worst_pole = int(np.argmin(scores))
        if scores[worst_pole] >= NOISE_RATIO_MIN:
            break
        z = _complex(np.delete(z, worst_pole))
    while z.size:
        z, pole_amplitudes, residual = polish_poles(band_signal, z)
        scores = _scores(z, pole_amplitudes, residual)
        worst_pole = int(np.argmin(scores))
        if scores[worst_pole] >= NOISE_RATIO_MIN:
            return z, pole_amplitudes
        z = _complex(np.delete(z, worst_pole))
    return z, np.zeros(0, complex)


def _esprit(signal: Complex, count_max: int) -> Complex:
    n = signal.size
    rows = n // 2
    hankel = np.lib.stride_tricks.sliding_window_view(signal, n - rows + 1)[:rows]
    _, vectors = np.linalg.eigh(hankel @ hankel.conj().T)
    vectors = vectors[:, ::-1][:, :count_max]
    # The violation of shift invariance by each order; the highest order that is nearly as good as
    # the best is chosen.
    shift_errors = np.array(
        [_shift_error(vectors[:, : order + 1]) for order in range(vectors.shape[1])]
    )
    order = int(np.flatnonzero(shift_errors.min() >= 0.1 * shift_errors).max()) + 1
    signal_vectors = vectors[:, :order]
    shift_matrix = np.linalg.lstsq(signal_vectors[:-1], signal_vectors[1:], rcond=None)[0]
    return _complex(np.linalg.eigvals(shift_matrix))


def _shift_error(vectors: Complex) -> float:
    upper_rows, lower_rows = vectors[:-1], vectors[1:]
    last_row = vectors[-1]
    remainder = 1.0 - float(np.vdot(last_row, last_row).real)
    shift_matrix = upper_rows.conj().T @ lower_rows
    if remainder > 1e-12:  # the pseudo-inverse of orthonormal columns without their last row
        shift_matrix = _complex(
            shift_matrix + np.outer(last_row.conj(), last_row @ shift_matrix) / remainder
        )
    else:
        shift_matrix = _complex(np.linalg.lstsq(upper_rows, lower_rows, rcond=None)[0])
    error = _complex(lower_rows - upper_rows @ shift_matrix)
    # The largest singular value of a narrow matrix, squared, from its Gram matrix.
    return max(float(np.linalg.eigvalsh(error.conj().T @ error)[-1]), 1e-30)


def _complex(values: NDArray[Any]) -> Complex:
    return values.astype(np.complex128, copy=False)


def _powers(z: Complex, n: int) -> Complex:
    return np.exp(np.arange(n)[:, None] * np.log(z))


def _amplitudes(signal: Complex, z: Complex) -> tuple[Complex, Complex]:
    basis = _powers(z, signal.size)
    c = _complex(np.linalg.lstsq(basis, signal, rcond=None)[0])
    return c, _complex(signal - basis @ c)


def _scores(z: Complex, c: Complex, residual: Complex) -> Array:
    """Power of each amplitude over that of its noise."""
    basis = _powers(z, residual.size)
    variance = np.vdot(residual, residual).real / max(1, residual.size - 2 * z.size)
    variances = np.linalg.pinv(basis.conj().T @ basis).diagonal().real * variance
    return np.asarray(np.abs(c) ** 2 / np.maximum(variances, 1e-300))


def polish_poles(band_signal: Complex, z: Complex) -> tuple[Complex, Complex, Complex]:
    """Gauss-Newton on the logarithms of the poles alone, with the amplitudes projected out."""
    sample_indices = np.arange(band_signal.size)[:, None]
    pole_logarithms, last_cost = np.log(z), np.inf
    best_logarithms = pole_logarithms
    pole_amplitudes, residual = _amplitudes(band_signal, z)
    for polish_step in range(_POLISH):
        basis = np.exp(sample_indices * pole_logarithms)
        orthonormal_basis, _ = np.linalg.qr(basis)
        trial_amplitudes = _complex(np.linalg.lstsq(basis, band_signal, rcond=None)[0])
        trial_residual = _complex(band_signal - basis @ trial_amplitudes)
        cost = float(np.vdot(trial_residual, trial_residual).real)
        if not cost < last_cost * (1.0 - _RESIDUAL_TOLERANCE):
            break
        last_cost, best_logarithms, pole_amplitudes, residual = (
            cost,
            pole_logarithms,
            trial_amplitudes,
            trial_residual,
        )
        tangents = sample_indices * basis * trial_amplitudes
        tangents = tangents - orthonormal_basis @ (orthonormal_basis.conj().T @ tangents)
        logarithm_changes = np.linalg.lstsq(tangents, trial_residual, rcond=None)[0]
        if polish_step == 0:
            logarithm_changes *= min(
                1.0, _FIRST_STEP / max(1e-300, float(np.abs(logarithm_changes).max()))
            )
        pole_logarithms = pole_logarithms + logarithm_changes
        pole_logarithms = _complex(
            np.minimum(pole_logarithms.real, 1e-4) + 1j * pole_logarithms.imag
        )
    return _complex(np.exp(best_logarithms)), pole_amplitudes, residual
