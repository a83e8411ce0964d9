"""Modes and levels as one chain of masses and springs; the motion of its end has these modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergon.common.decay import LN_1000
from ergon.workshop.bells.bands import Array

PARTIALS_MAX = 15  # partials
_NEIGHBOUR_RATIO_MIN = 1.02  # ratio of neighbours: nearer ones need masses of tonnes
_DECAY_ERROR_MAX = 0.1  # relative error of a decay at which dampers do not make it


@dataclass(frozen=True)
class Chain:
    """Masses [kg] from the struck end; springs [N/m] to the next mass, the last to the ground;
    dampers [N·s/m] beside the springs, and from each mass to the ground.
    """

    masses: Array
    springs: Array
    dampers: Array
    grounds: Array


def chain(mode_frequencies: Array, t60: Array, mode_shares: Array, chain_mass: float) -> Chain:
    """The chain whose first mass [kg] has modes f [Hz] with shares `mode_shares` of its movement.

    Lanczos' process from the weights (de Boor and Golub, 1978); dampers by non-negative least
    squares. Raises ValueError if there is no such chain.
    """
    if mode_frequencies.size > PARTIALS_MAX:
        raise ValueError(
            f"a chain is offered for at most {PARTIALS_MAX} modes, and here are "
            f"{mode_frequencies.size}"
        )
    if np.any(mode_frequencies[1:] < _NEIGHBOUR_RATIO_MIN * mode_frequencies[:-1]):
        raise ValueError("a chain cannot have modes that beat: two are nearer than 2 %")
    sigma = LN_1000 / t60
    eigen = (2.0 * np.pi * mode_frequencies) ** 2 + sigma**2
    diagonal, off_diagonal, basis = _lanczos(eigen, np.sqrt(mode_shares / mode_shares.sum()))
    n = mode_frequencies.size
    masses, springs = np.zeros(n), np.zeros(n)
    masses[0] = chain_mass
    stiffness_before = 0.0
    for i in range(n):
        springs[i] = masses[i] * diagonal[i] - stiffness_before
        stiffness_before = springs[i]
        if i + 1 < n:
            masses[i + 1] = (springs[i] / off_diagonal[i]) ** 2 / masses[i]
    # (masses, modes) for modes of mass 1. The signs alternate, because springs pull masses
    # together.
    shapes = basis * ((-1.0) ** np.arange(n) / np.sqrt(masses))[:, None]
    stretched = np.vstack([shapes[1:] - shapes[:-1], -shapes[-1:]])
    element_squares = np.vstack([stretched**2, shapes**2])
    z = _not_negative((element_squares / (2.0 * sigma)).T, np.ones(n))
    rebuilt = element_squares.T @ z / 2.0
    worst = float(np.max(np.abs(rebuilt / sigma - 1.0)))
    if not worst < _DECAY_ERROR_MAX:
        message = f"no dampers of a chain give these decays: one would be {100 * worst:.0f} % off"
        raise ValueError(message)
    return Chain(masses, springs, z[:n], z[n:])


def _lanczos(eigen: Array, start_vector: Array) -> tuple[Array, Array, Array]:
    n = eigen.size
    basis = np.zeros((n, n))  # a row for each mass
    diagonal, off_diagonal = np.zeros(n), np.zeros(max(0, n - 1))
    basis[0] = start_vector
    for i in range(n):
        image = eigen * basis[i]
        diagonal[i] = basis[i] @ image
        for _ in range(2):
            image = image - basis[: i + 1].T @ (basis[: i + 1] @ image)
        if i + 1 < n:
            off_diagonal[i] = float(np.linalg.norm(image))
            basis[i + 1] = image / off_diagonal[i]
    return diagonal, off_diagonal, basis


def _not_negative(a: Array, b: Array) -> Array:
    """Non-negative least squares (Lawson and Hanson, 1974)."""
    n = a.shape[1]
    column_norms = np.linalg.norm(a, axis=0)
    a = a / column_norms
    x, active = np.zeros(n), np.zeros(n, bool)
    for _ in range(10 * n):
        rise = a.T @ (b - a @ x)
        rise[active] = -np.inf
        largest_row = int(np.argmax(rise))
        if rise[largest_row] <= 1e-12:
            break
        active[largest_row] = True
        while True:
            trial = np.zeros(n)
            trial[active] = np.linalg.lstsq(a[:, active], b, rcond=None)[0]
            low_rows = active & (trial <= 0.0)
            if not low_rows.any():
                x = trial
                break
            share = np.min(x[low_rows] / (x[low_rows] - trial[low_rows]))
            x = x + share * (trial - x)
            active &= x > 1e-15
            x[~active] = 0.0
    return np.asarray(x / column_norms)
