"""Spherical harmonics and decoders: ACN order; SN3D in files, as in AmbiX, N3D inside computations.

Sources: C. Nachbar et al., "AmbiX" (Ambisonics Symposium, 2011); F. Zotter and M. Frank,
"All-round ambisonic panning and decoding", J. Audio Eng. Soc. 60 (2012), eq. 10 (max-rE
weights), section 4.
"""

from __future__ import annotations

from math import fsum, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from .directions import spread_directions
from .panning import vbap

if TYPE_CHECKING:
    from numpy.typing import NDArray

ORDER_MAX = 7  # order: 64 channels
_VIRTUAL_DIRECTIONS = (
    5200  # directions by which a decoder is made, as many as a t-design of order 100 has
)


def channels(order: int) -> int:
    """Channels of an order."""
    return (order + 1) * (order + 1)


def harmonics(ambisonic_order: int, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Real N3D harmonics in ACN order, (n_directions, (order + 1)²), of unit vectors (n, 3).

    AmbiX has its x to the front and its y to the left. The recurrences are those of associated
    Legendre functions divided by cos^m of the elevation, so that no angle has to be computed.
    """
    x, y, z = directions[:, 1], -directions[:, 0], directions[:, 2]
    basis = np.zeros((len(directions), channels(ambisonic_order)))
    cosine, sine = (
        np.ones(len(directions)),
        np.zeros(len(directions)),
    )  # cos and sin of m·azimuth, times cos^m of the elevation
    diagonal = 1.0  # P_m^m divided by cos^m of the elevation
    for m in range(ambisonic_order + 1):
        legendre_before, legendre = np.zeros(len(directions)), np.full(len(directions), diagonal)
        for n in range(m, ambisonic_order + 1):
            scale = _n3d(n, m)
            basis[:, n * n + n + m] = scale * legendre * cosine
            if m:
                basis[:, n * n + n - m] = scale * legendre * sine
            legendre_after = ((2 * n + 1) * z * legendre - (n + m) * legendre_before) / (n - m + 1)
            legendre_before, legendre = legendre, legendre_after
        cosine, sine = cosine * x - sine * y, sine * x + cosine * y
        diagonal *= 2 * m + 1
    return basis


def _n3d(n: int, m: int) -> float:
    ratio = 1.0  # (n - m)! / (n + m)!
    for k in range(n - m + 1, n + m + 1):
        ratio /= k
    return sqrt((2 * n + 1) * (2.0 if m else 1.0) * ratio)


def sn3d(order: int) -> NDArray[np.float64]:
    """Factors that turn N3D channels into SN3D, ((order + 1)²,)."""
    return np.array([1.0 / sqrt(2 * n + 1) for n in _degrees(order)])


def _degrees(order: int) -> list[int]:
    return [n for n in range(order + 1) for _ in range(2 * n + 1)]


def max_re_weights(ambisonic_order: int) -> NDArray[np.float64]:
    """Weights of the degrees, (order + 1,), that maximise the length of the energy vector (eq.
    10).
    """
    x = _core.cos(137.9 / (ambisonic_order + 1.51) * pi / 180.0)
    legendre_before, legendre = 0.0, 1.0
    degree_weights = []
    for n in range(ambisonic_order + 1):
        degree_weights.append(legendre)
        legendre_before, legendre = (
            legendre,
            ((2 * n + 1) * x * legendre - n * legendre_before) / (n + 1),
        )
    return np.array(degree_weights)


def encoder(order: int, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """SN3D gains of each channel for each direction, (n_directions, (order + 1)²)."""
    return harmonics(order, directions) * sn3d(order)


def allrad(
    ambisonic_order: int, array: NDArray[np.float64], virtual: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """All-round decoder with max-rE weights, (n_loudspeakers, (order + 1)²), for N3D channels.

    `virtual` directions are panned between the loudspeakers. Averaged over the directions that
    the array covers, a source has energy 1. Raises ArrayError.
    """
    virtual = spread_directions(_VIRTUAL_DIRECTIONS) if virtual is None else virtual
    gains = vbap(virtual, array, keeps_imaginary=True)
    weights = max_re_weights(ambisonic_order)[_degrees(ambisonic_order)]
    basis = harmonics(ambisonic_order, virtual)
    decoder = np.zeros((len(array), channels(ambisonic_order)))
    # Summed direction by direction: the bits of a matrix product would depend on the machine's
    # library.
    for row, harmonic in zip(gains, basis, strict=True):
        active = np.flatnonzero(row)
        decoder[active] += row[active, None] * harmonic
    decoder *= weights
    played_gains = np.zeros((len(array), len(virtual)))
    for column, harmonic in zip(decoder.T, basis.T, strict=True):
        played_gains += column[:, None] * harmonic
    covered_energies, played_energies = np.zeros(len(virtual)), np.zeros(len(virtual))
    for gain, speaker_gains in zip(gains.T, played_gains, strict=True):
        covered_energies += gain * gain
        played_energies += speaker_gains * speaker_gains
    mean_energy = fsum((covered_energies * played_energies).tolist()) / fsum(
        covered_energies.tolist()
    )
    return decoder / sqrt(mean_energy)
