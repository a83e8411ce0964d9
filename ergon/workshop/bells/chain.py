"""Modes and levels as one chain of masses and springs; the motion of its end has these modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergon.common.decay import LN_1000
from ergon.workshop.bells.bands import Array

PARTIALS_MAX = 15  # partials
_NEIGHBOUR_RATIO_MIN = 1.02  # ratio of neighbours: nearer ones need masses of tonnes
_DECAY_ERROR_MAX = 0.1  # relative error of a decay above which a chain is refused


@dataclass(frozen=True)
class Chain:
    """Masses [kg] from the struck end; springs [N/m] to the next mass, the last to the ground;
    dampers [N·s/m] beside the springs, and from each mass to the ground.
    """

    masses: Array
    springs: Array
    dampers: Array
    ground_dampers: Array


def build_chain(f: Array, t60: Array, shares: Array, first_mass: float) -> Chain:
    """The chain whose first mass [kg] has modes f [Hz] with these `shares` of its movement.

    Lanczos' process from the weights (de Boor and Golub, 1978); dampers by non-negative least
    squares. Raises ValueError if there is no such chain.
    """
    if f.size > PARTIALS_MAX:
        raise ValueError(
            f"a chain is offered for at most {PARTIALS_MAX} modes, and here are {f.size}"
        )
    if np.any(f[1:] < _NEIGHBOUR_RATIO_MIN * f[:-1]):
        raise ValueError("a chain cannot have modes that beat: two are nearer than 2 %")
    sigma = LN_1000 / t60
    eigenvalues = (2.0 * np.pi * f) ** 2 + sigma**2
    diagonal, off_diagonal, basis = _lanczos(eigenvalues, np.sqrt(shares / shares.sum()))
    n_masses = f.size
    masses, springs = np.zeros(n_masses), np.zeros(n_masses)
    masses[0] = first_mass
    previous_stiffness = 0.0
    for i in range(n_masses):
        springs[i] = masses[i] * diagonal[i] - previous_stiffness
        previous_stiffness = springs[i]
        if i + 1 < n_masses:
            masses[i + 1] = (springs[i] / off_diagonal[i]) ** 2 / masses[i]
    # (masses, modes) for modes of mass 1. The signs alternate, because springs pull masses
    # together.
    shapes = basis * ((-1.0) ** np.arange(n_masses) / np.sqrt(masses))[:, None]
    elongations = np.vstack([shapes[1:] - shapes[:-1], -shapes[-1:]])
    squared_elongations = np.vstack([elongations**2, shapes**2])
    dampers = _non_negative_least_squares(
        (squared_elongations / (2.0 * sigma)).T, np.ones(n_masses)
    )
    achieved_sigma = squared_elongations.T @ dampers / 2.0
    decay_error = float(np.max(np.abs(achieved_sigma / sigma - 1.0)))
    if not decay_error < _DECAY_ERROR_MAX:
        message = (
            f"no dampers of a chain give these decays: one would be {100 * decay_error:.0f} % off"
        )
        raise ValueError(message)
    return Chain(masses, springs, dampers[:n_masses], dampers[n_masses:])


def _lanczos(eigenvalues: Array, start_vector: Array) -> tuple[Array, Array, Array]:
    n_modes = eigenvalues.size
    basis = np.zeros((n_modes, n_modes))  # a row for each mass
    diagonal, off_diagonal = np.zeros(n_modes), np.zeros(max(0, n_modes - 1))
    basis[0] = start_vector
    for i in range(n_modes):
        image = eigenvalues * basis[i]
        diagonal[i] = basis[i] @ image
        for _ in range(2):
            image = image - basis[: i + 1].T @ (basis[: i + 1] @ image)
        if i + 1 < n_modes:
            off_diagonal[i] = float(np.linalg.norm(image))
            basis[i + 1] = image / off_diagonal[i]
    return diagonal, off_diagonal, basis


def _non_negative_least_squares(matrix: Array, rhs: Array) -> Array:
    """Non-negative least squares (Lawson and Hanson, 1974)."""
    n_unknowns = matrix.shape[1]
    column_norms = np.linalg.norm(matrix, axis=0)
    matrix = matrix / column_norms
    solution, is_active = np.zeros(n_unknowns), np.zeros(n_unknowns, bool)
    for _ in range(10 * n_unknowns):
        gradient = matrix.T @ (rhs - matrix @ solution)
        gradient[is_active] = -np.inf
        steepest = int(np.argmax(gradient))
        if gradient[steepest] <= 1e-12:
            break
        is_active[steepest] = True
        while True:
            trial = np.zeros(n_unknowns)
            trial[is_active] = np.linalg.lstsq(matrix[:, is_active], rhs, rcond=None)[0]
            is_blocked = is_active & (trial <= 0.0)
            if not is_blocked.any():
                solution = trial
                break
            step = np.min(solution[is_blocked] / (solution[is_blocked] - trial[is_blocked]))
            solution = solution + step * (trial - solution)
            is_active &= solution > 1e-15
            solution[~is_active] = 0.0
    return np.asarray(solution / column_norms)
