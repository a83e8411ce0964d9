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


def chain(mode_frequencies: Array, t60: Array, shares: Array, chain_mass: float) -> Chain:
    """The chain whose first mass [kg] has modes f [Hz] with these `shares` of its movement.

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
    eigenvalues = (2.0 * np.pi * mode_frequencies) ** 2 + sigma**2
    diagonal, off_diagonal, basis = _lanczos(eigenvalues, np.sqrt(shares / shares.sum()))
    mass_count = mode_frequencies.size
    masses, springs = np.zeros(mass_count), np.zeros(mass_count)
    masses[0] = chain_mass
    stiffness_before = 0.0
    for i in range(mass_count):
        springs[i] = masses[i] * diagonal[i] - stiffness_before
        stiffness_before = springs[i]
        if i + 1 < mass_count:
            masses[i + 1] = (springs[i] / off_diagonal[i]) ** 2 / masses[i]
    # (masses, modes) for modes of mass 1. The signs alternate, because springs pull masses
    # together.
    shapes = basis * ((-1.0) ** np.arange(mass_count) / np.sqrt(masses))[:, None]
    elongations = np.vstack([shapes[1:] - shapes[:-1], -shapes[-1:]])
    element_squares = np.vstack([elongations**2, shapes**2])
    dampers = _not_negative((element_squares / (2.0 * sigma)).T, np.ones(mass_count))
    rebuilt_sigma = element_squares.T @ dampers / 2.0
    decay_error = float(np.max(np.abs(rebuilt_sigma / sigma - 1.0)))
    if not decay_error < _DECAY_ERROR_MAX:
        message = (
            f"no dampers of a chain give these decays: one would be {100 * decay_error:.0f} % off"
        )
        raise ValueError(message)
    return Chain(masses, springs, dampers[:mass_count], dampers[mass_count:])


def _lanczos(eigenvalues: Array, start_vector: Array) -> tuple[Array, Array, Array]:
    n = eigenvalues.size
    basis = np.zeros((n, n))  # a row for each mass
    diagonal, off_diagonal = np.zeros(n), np.zeros(max(0, n - 1))
    basis[0] = start_vector
    for i in range(n):
        image = eigenvalues * basis[i]
        diagonal[i] = basis[i] @ image
        for _ in range(2):
            image = image - basis[: i + 1].T @ (basis[: i + 1] @ image)
        if i + 1 < n:
            off_diagonal[i] = float(np.linalg.norm(image))
            basis[i + 1] = image / off_diagonal[i]
    return diagonal, off_diagonal, basis


def _not_negative(matrix: Array, right_side: Array) -> Array:
    """Non-negative least squares (Lawson and Hanson, 1974)."""
    unknown_count = matrix.shape[1]
    column_norms = np.linalg.norm(matrix, axis=0)
    matrix = matrix / column_norms
    solution, is_active = np.zeros(unknown_count), np.zeros(unknown_count, bool)
    for _ in range(10 * unknown_count):
        gradient = matrix.T @ (right_side - matrix @ solution)
        gradient[is_active] = -np.inf
        steepest = int(np.argmax(gradient))
        if gradient[steepest] <= 1e-12:
            break
        is_active[steepest] = True
        while True:
            trial_solution = np.zeros(unknown_count)
            trial_solution[is_active] = np.linalg.lstsq(
                matrix[:, is_active], right_side, rcond=None
            )[0]
            is_blocked = is_active & (trial_solution <= 0.0)
            if not is_blocked.any():
                solution = trial_solution
                break
            share = np.min(
                solution[is_blocked] / (solution[is_blocked] - trial_solution[is_blocked])
            )
            solution = solution + share * (trial_solution - solution)
            is_active &= solution > 1e-15
            solution[~is_active] = 0.0
    return np.asarray(solution / column_norms)
