"""Exact reference for linear bodies: their modes in closed form, and their free motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_CHUNK = 256  # times whose exponentials are kept


@dataclass(frozen=True, slots=True)
class Body:
    """Modes of masses m: q'' = -w2·q - 2·sigma·q', and x = shapes·q with mass-normalised shapes."""

    w2: Floats
    sigma: Floats
    shapes: Floats  # (points, modes): the points that are listened to or struck

    @property
    def pole(self) -> NDArray[np.complex128]:
        """s of q = Re(c·exp(s·t))."""
        result: NDArray[np.complex128] = -self.sigma + 1j * np.sqrt(self.w2 - self.sigma**2)
        return result

    def phasor(self, q: Floats, v: Floats) -> NDArray[np.complex128]:
        """c of q = Re(c·exp(s·t)) for positions and speeds at t = 0."""
        result: NDArray[np.complex128] = q - 1j * (v + self.sigma * q) / self.pole.imag
        return result


def row(n: int) -> tuple[Floats, Floats]:
    """Eigenvalues of n unit masses between held ends, and shapes (masses, modes) of norm 1."""
    i = np.arange(1, n + 1)
    return (
        4.0 * np.sin(i * math.pi / (2 * (n + 1))) ** 2,
        math.sqrt(2.0 / (n + 1)) * np.sin(np.outer(i, i) * math.pi / (n + 1)),
    )


def tuned(lowest: float, m: float, f: float, t60: float) -> tuple[float, float]:
    """k and z of all links for which the lowest mode has frequency f and decay t60, as generators
    tune them.
    """
    sigma = 3.0 * math.log(10.0) / t60
    w2 = (2.0 * math.pi * f) ** 2 + sigma**2
    k = m * w2 / lowest
    return k, 2.0 * sigma * k / w2


def ring(body: Body, c: NDArray[np.complex128], times: Floats, weights: Floats) -> Floats:
    """weights·q at evenly spaced times from 0 on: (times, weights)."""
    out = np.empty((len(times), len(weights)))
    step = times[1] - times[0] if len(times) > 1 else 0.0
    turn = np.exp(np.outer(np.arange(_CHUNK) * step, body.pole))
    for i in range(0, len(times), _CHUNK):
        now = c * np.exp(body.pole * times[i])
        n = min(_CHUNK, len(times) - i)
        out[i : i + n] = ((turn[:n] * now) @ weights.T).real
    return out
