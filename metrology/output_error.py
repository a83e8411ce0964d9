"""Least squares of the output error: the key whose path is nearest to what was read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from .parameters import START, moved, scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .gesture import Floats, Gesture

_DAMPING = (1e-3, 1e-7)  # of Levenberg and Marquardt: at first, at least
_TRIALS = 12
_CLOSE = 1e-7  # relative fall of the cost below which it has converged


@dataclass(frozen=True, slots=True)
class Fit:
    """A key fitted to gestures; sizes: p parameters that were fitted.

    `row` holds its parameters; `columns` the indices of those that were fitted, but for the starts,
    one for each gesture, which `starts` holds [m]. `covariance` (p, p) is in SI units (the bound of
    Cramér and Rao at the noise that is left), `rms` [m] what is left, `n` the number of positions.
    """

    row: Floats
    columns: tuple[int, ...]
    starts: tuple[float, ...]
    covariance: Floats
    rms: float
    n: int

    @property
    def bic(self) -> float:
        """Bayesian information criterion; less is better."""
        n_fitted = len(self.columns) + len(self.starts)
        return self.n * float(np.log(self.rms**2)) + n_fitted * float(np.log(self.n))

    def deviation(self, index: int) -> float:
        """Standard deviation of a parameter that was fitted, in its SI unit."""
        at = self.columns.index(index)
        return float(np.sqrt(self.covariance[at, at]))


def path(row: Floats, gesture: Gesture, start: float) -> Floats:
    """Where a key goes under the forces of a gesture, (n,) [m]."""
    row = row.copy()
    row[START] = start
    return _core.key_path(row, gesture.force, gesture.rate, columns=())[0]


def errors(row: Floats, gesture: Gesture, start: float) -> Floats:
    """The positions that count less those of the model [m]."""
    counts = gesture.counts
    return gesture.position[counts] - path(row, gesture, start)[counts]


def _cost(row: Floats, gestures: Sequence[Gesture], starts: Floats) -> float:
    try:
        each = [errors(row, g, x) for g, x in zip(gestures, starts, strict=True)]
    except _core.EngineError:
        return np.inf  # no such key, or too fast a one
    cost = sum(float(e @ e) for e in each)
    return cost if np.isfinite(cost) else np.inf


def _normal(
    row: Floats, columns: Sequence[int], gestures: Sequence[Gesture], starts: Floats
) -> tuple[Floats, Floats]:
    """JᵀJ and Jᵀe on the scales of the fit; the starts of all gestures are last."""
    p, own = len(columns), [*columns, START]
    square, slope = np.zeros((p + len(starts),) * 2), np.zeros(p + len(starts))
    for i, (gesture, start) in enumerate(zip(gestures, starts, strict=True)):
        row = row.copy()
        row[START] = start
        x, jacobian = _core.key_path(row, gesture.force, gesture.rate, columns=own)
        jacobian = jacobian[gesture.counts] * scale(row, own)
        error = (gesture.position - x)[gesture.counts]
        at = np.array([*range(p), p + i])
        square[np.ix_(at, at)] += jacobian.T @ jacobian
        slope[at] += jacobian.T @ error
    return square, slope


def fit(
    gestures: Sequence[Gesture],
    row: Floats,
    columns: Sequence[int],
    starts: Sequence[float] | None = None,
    iterations: int = 30,
) -> Fit:
    """Fit the parameters of these indices, from `row` on, by Levenberg and Marquardt's method.

    Raises EngineError where `row` is no key.
    """
    from_ = np.array([g.start for g in gestures] if starts is None else starts)
    p, damping, least = len(columns), *_DAMPING
    n = sum(int(g.counts.sum()) for g in gestures)
    cost = _cost(row, gestures, from_)
    for _ in range(iterations):
        _core.poll()
        square, slope = _normal(row, columns, gestures, from_)
        size = np.sqrt(np.diag(square))
        size[size == 0] = 1.0
        unit = square / np.outer(size, size)
        for _ in range(_TRIALS):
            lifted = unit + damping * np.eye(len(unit))
            step = np.linalg.solve(lifted, slope / size) / size
            to, at = moved(row, columns, step[:p]), from_ + step[p:]
            new = _cost(to, gestures, at)
            if new < cost:
                break
            damping *= 10
        else:
            break
        fall, row, from_, cost = (cost - new) / cost, to, at, new
        damping = max(damping / 10, least)
        if fall < _CLOSE:
            break
    square, _ = _normal(row, columns, gestures, from_)
    free = max(n - len(square), 1)
    covariance = np.linalg.pinv(square, hermitian=True)[:p, :p] * (cost / free)
    size = scale(row, columns)
    rms = float(np.sqrt(cost / n))
    return Fit(
        row, tuple(columns), tuple(map(float, from_)), covariance * np.outer(size, size), rms, n
    )
