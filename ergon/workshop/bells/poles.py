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
_CLOSE = 1e-10  # relative fall of the residual at which polishing ends
_FIRST_STEP = 0.02  # most change of a logarithm of a pole in the first step
_SHORTEST = 0.3  # |z| of exponentials that are over within three samples


def exponentials(signal: Complex, count_max: int) -> tuple[Complex, Complex]:
    """Poles z and amplitudes c of Σ c·z^k in a signal (n,), at most `count_max`.

    Each is far above the residual noise.
    """
    z: Complex = _esprit(signal, count_max)
    z = z[(np.abs(z) < 1.0) & (np.abs(z) > _SHORTEST)]
    while z.size:  # the worst goes first, before the others are polished
        c, rest = _amplitudes(signal, z)
        score = _scores(z, c, rest)
        worst = int(np.argmin(score))
        if score[worst] >= NOISE_RATIO_MIN:
            break
        z = _complex(np.delete(z, worst))
    while z.size:
        z, c, rest = polish_poles(signal, z)
        score = _scores(z, c, rest)
        worst = int(np.argmin(score))
        if score[worst] >= NOISE_RATIO_MIN:
            return z, c
        z = _complex(np.delete(z, worst))
    return z, np.zeros(0, complex)


def _esprit(signal: Complex, count_max: int) -> Complex:
    n = signal.size
    rows = n // 2
    hankel = np.lib.stride_tricks.sliding_window_view(signal, n - rows + 1)[:rows]
    _, vectors = np.linalg.eigh(hankel @ hankel.conj().T)
    vectors = vectors[:, ::-1][:, :count_max]
    # The violation of shift invariance by each order; the highest order that is nearly as good as
    # the best is chosen.
    left = np.array([_shift_error(vectors[:, : order + 1]) for order in range(vectors.shape[1])])
    order = int(np.flatnonzero(left.min() >= 0.1 * left).max()) + 1
    chosen = vectors[:, :order]
    turn = np.linalg.lstsq(chosen[:-1], chosen[1:], rcond=None)[0]
    return _complex(np.linalg.eigvals(turn))


def _shift_error(vectors: Complex) -> float:
    first, second = vectors[:-1], vectors[1:]
    last = vectors[-1]
    rest = 1.0 - float(np.vdot(last, last).real)
    turn = first.conj().T @ second
    if rest > 1e-12:  # the pseudo-inverse of orthonormal columns without their last row
        turn = _complex(turn + np.outer(last.conj(), last @ turn) / rest)
    else:
        turn = _complex(np.linalg.lstsq(first, second, rcond=None)[0])
    error = _complex(second - first @ turn)
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


def _scores(z: Complex, c: Complex, rest: Complex) -> Array:
    """Power of each amplitude over that of its noise."""
    basis = _powers(z, rest.size)
    variance = np.vdot(rest, rest).real / max(1, rest.size - 2 * z.size)
    variances = np.linalg.pinv(basis.conj().T @ basis).diagonal().real * variance
    return np.asarray(np.abs(c) ** 2 / np.maximum(variances, 1e-300))


def polish_poles(signal: Complex, z: Complex) -> tuple[Complex, Complex, Complex]:
    """Gauss-Newton on the logarithms of the poles alone, with the amplitudes projected out."""
    samples = np.arange(signal.size)[:, None]
    s, last = np.log(z), np.inf
    best = s
    c, rest = _amplitudes(signal, z)
    for step in range(_POLISH):
        basis = np.exp(samples * s)
        q, _ = np.linalg.qr(basis)
        amplitudes = _complex(np.linalg.lstsq(basis, signal, rcond=None)[0])
        left = _complex(signal - basis @ amplitudes)
        cost = float(np.vdot(left, left).real)
        if not cost < last * (1.0 - _CLOSE):
            break
        last, best, c, rest = cost, s, amplitudes, left
        tangents = samples * basis * amplitudes
        tangents = tangents - q @ (q.conj().T @ tangents)
        change = np.linalg.lstsq(tangents, left, rcond=None)[0]
        if step == 0:
            change *= min(1.0, _FIRST_STEP / max(1e-300, float(np.abs(change).max())))
        s = s + change
        s = _complex(np.minimum(s.real, 1e-4) + 1j * s.imag)
    return _complex(np.exp(best)), c, rest
