"""Least squares of the output error: the key whose path is nearest to the positions read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from . import coloured
from .parameters import START, derivative_scales, leads_beyond, step_parameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .gesture import Floats, Gesture

_DAMPING_INITIAL = 1e-3  # of Levenberg and Marquardt
_DAMPING_MIN = 1e-7
_UNDAMPED_BOUND = 1e-5  # damping below which a step is nearly that of Gauss and Newton
_SLOW_STEPS_MAX = 3  # steps that hardly fall, after which it has converged even if they are damped
_DAMPING_TRIALS = 12
# Maximal rounds of recovering unknown forces, the relative fall of the cost that ends them, and the
# least share of a step.
_RECOVERY_ROUNDS_MAX, _SETTLED_FALL, _STEP_FRACTION_MIN = 20, 1e-4, 0.05
_JACOBIAN_INTERVAL = 3  # steps of a fit, from one look at what the unknown forces do to the next
_COST_TOLERANCE = 1e-6  # relative fall of the cost below which it has converged


@dataclass(frozen=True, slots=True)
class Fit:
    """A key fitted to gestures; sizes: p fitted parameters.

    `parameters` holds its parameters, `fitted_indices` the indices of the fitted ones. Starting
    positions are fitted too: `start_positions` holds one for each gesture [m]. `covariance` (p, p)
    is in SI units, and counts how residuals are correlated (`coloured.covariance`). `rms` [m] is
    the residual, `n_positions` the number of positions. `forces` [N] are those at the unknown ticks
    of each gesture.
    """

    parameters: Floats
    fitted_indices: tuple[int, ...]
    start_positions: tuple[float, ...]
    covariance: Floats
    rms: float
    n_positions: int
    forces: tuple[Floats, ...] = ()

    def with_recovered_forces(self, gestures: Sequence[Gesture]) -> list[Gesture]:
        """The gestures of the fit, with the unknown forces that it found."""
        return [g.with_forces(f) for g, f in zip(gestures, self.forces, strict=True)]

    @property
    def bic(self) -> float:
        """Bayesian information criterion; less is better."""
        n_fitted = len(self.fitted_indices) + len(self.start_positions)
        return self.n_positions * float(np.log(self.rms**2)) + n_fitted * float(
            np.log(self.n_positions)
        )

    def deviation(self, index: int) -> float:
        """Standard deviation of a parameter that was fitted, in its SI unit."""
        covariance_index = self.fitted_indices.index(index)
        return float(np.sqrt(self.covariance[covariance_index, covariance_index]))


def model_path(parameters: Floats, gesture: Gesture, start_position: float) -> Floats:
    """The path of a key under the forces of a gesture, (n,) [m]."""
    parameters = parameters.copy()
    parameters[START] = start_position
    return _core.key_path(parameters, gesture.force, gesture.rate, columns=())[0]


def residuals(parameters: Floats, gesture: Gesture, start: float) -> Floats:
    """The positions that count minus those of the model [m]."""
    is_compared = gesture.is_compared
    return gesture.position[is_compared] - model_path(parameters, gesture, start)[is_compared]


def _costs(parameters: Floats, gestures: Sequence[Gesture], starts: Floats) -> tuple[float, float]:
    """Sums of squares: of position errors [m²], and of unknown forces in units of their spreads."""
    try:
        position_errors = [
            residuals(parameters, g, x) for g, x in zip(gestures, starts, strict=True)
        ]
    except _core.EngineError:
        return np.inf, 0.0  # no such key, or too fast a one
    squared_error = sum(float(error @ error) for error in position_errors)
    return squared_error if np.isfinite(squared_error) else np.inf, sum(
        float(offset @ offset) for offset in map(_force_deviations, gestures)
    )


def _force_deviations(gesture: Gesture) -> Floats:
    """Deviation of unknown forces from their middles, in units of their spreads (q,)."""
    unknown = gesture.unknown_forces
    return (gesture.force[unknown.ticks] - unknown.middle) / unknown.half_range


def _force_derivatives(parameters: Floats, gesture: Gesture, start_position: float) -> Floats:
    """Derivatives of the positions that count with respect to the unknown forces, (n, q)."""
    ticks = gesture.unknown_forces.ticks
    if not ticks.size:
        return np.zeros((int(gesture.is_compared.sum()), 0))
    parameters = parameters.copy()
    parameters[START] = start_position
    derivatives = _core.key_force_derivatives(
        parameters, gesture.force, gesture.rate, ticks.tolist()
    )
    return derivatives[gesture.is_compared]


def recover_forces(parameters: Floats, gesture: Gesture, start_position: float) -> Gesture:
    """The gesture with the unknown forces for which the model comes nearest to the positions
    read.
    """
    ticks, spread = gesture.unknown_forces.ticks, gesture.unknown_forces.half_range
    if not ticks.size:
        return gesture
    n_compared, step_fraction = int(gesture.is_compared.sum()), 1.0
    position_cost, force_cost = _costs(parameters, [gesture], np.array([start_position]))
    for _ in range(_RECOVERY_ROUNDS_MAX):
        jacobian = _force_derivatives(parameters, gesture, start_position) * spread
        variance = position_cost / n_compared
        hessian = jacobian.T @ jacobian + variance * np.eye(ticks.size)
        gradient = jacobian.T @ residuals(
            parameters, gesture, start_position
        ) - variance * _force_deviations(gesture)
        step = spread * np.linalg.solve(hessian, gradient)
        while step_fraction > _STEP_FRACTION_MIN:
            trial = gesture.with_forces(gesture.force[ticks] + step_fraction * step)
            new_position_cost, new_force_cost = _costs(
                parameters, [trial], np.array([start_position])
            )
            fall = 1.0 - (new_position_cost + variance * new_force_cost) / (
                position_cost + variance * force_cost
            )
            if fall > 0:
                break
            step_fraction *= 0.5
        else:
            break
        gesture, position_cost, force_cost = trial, new_position_cost, new_force_cost
        step_fraction = min(2 * step_fraction, 1.0)
        if fall < _SETTLED_FALL:
            break
    return gesture


def _variable_indices(
    n_fitted: int, starts: Floats, gestures: Sequence[Gesture]
) -> list[NDArray[np.int64]]:
    """The variables of the fit on which each gesture depends.

    The fit has these variables: parameters, starts of all gestures, unknown forces.
    """
    variables_by_gesture, first_force = [], n_fitted + len(starts)
    for i, gesture in enumerate(gestures):
        forces = np.arange(first_force, first_force + gesture.unknown_forces.ticks.size)
        first_force += forces.size
        variables_by_gesture.append(np.concatenate([np.arange(n_fitted), [n_fitted + i], forces]))
    return variables_by_gesture


def _linearise(
    parameters: Floats,
    fitted_indices: Sequence[int],
    gesture: Gesture,
    start_position: float,
    force_jacobian: Floats,
) -> tuple[Floats, Floats]:
    """Derivatives of the positions that count by the scaled variables of a gesture (n, variables),
    and the errors (n,).
    """
    fitted, parameters = [*fitted_indices, START], parameters.copy()
    parameters[START] = start_position
    model_positions, jacobian = _core.key_path(
        parameters, gesture.force, gesture.rate, columns=fitted
    )
    is_compared = gesture.is_compared
    scaled_jacobian = jacobian[is_compared] * derivative_scales(parameters, fitted)
    return np.concatenate([scaled_jacobian, force_jacobian], 1), (
        gesture.position - model_positions
    )[is_compared]


def _normal_equations(
    parameters: Floats,
    fitted_indices: Sequence[int],
    gestures: Sequence[Gesture],
    starts: Floats,
    force_jacobians: Sequence[Floats],
    variance: float,
) -> tuple[Floats, Floats]:
    """JᵀJ and Jᵀe in the scaled variables of the fit.

    Each unknown force counts as a measurement of its middle, with its spread as uncertainty.
    """
    variables_by_gesture = _variable_indices(len(fitted_indices), starts, gestures)
    n_variables = max(int(variables.max()) for variables in variables_by_gesture) + 1
    normal_matrix, gradient = np.zeros((n_variables, n_variables)), np.zeros(n_variables)
    for i, (gesture, variables) in enumerate(zip(gestures, variables_by_gesture, strict=True)):
        jacobian, error = _linearise(
            parameters, fitted_indices, gesture, starts[i], force_jacobians[i]
        )
        normal_matrix[np.ix_(variables, variables)] += jacobian.T @ jacobian
        gradient[variables] += jacobian.T @ error
        force_variables = variables[len(fitted_indices) + 1 :]
        normal_matrix[force_variables, force_variables] += (
            variance / gesture.unknown_forces.half_range**2
        )
        gradient[force_variables] -= (
            variance * _force_deviations(gesture) / gesture.unknown_forces.half_range
        )
    return normal_matrix, gradient


def _with_force_step(gestures: Sequence[Gesture], force_step: Floats) -> list[Gesture]:
    """The gestures after a step of their unknown forces, (q,)."""
    stepped_gestures, force_offset = [], 0
    for gesture in gestures:
        ticks = gesture.unknown_forces.ticks
        stepped_gestures.append(
            gesture.with_forces(
                gesture.force[ticks] + force_step[force_offset : force_offset + ticks.size]
            )
        )
        force_offset += ticks.size
    return stepped_gestures


def _damped_step(
    parameters: Floats,
    fitted_indices: Sequence[int],
    normal_matrix: Floats,
    gradient: Floats,
    damping: float,
) -> Floats:
    """The step of all variables; a parameter at its bound stays there if the step leads beyond."""
    norms = np.sqrt(np.diag(normal_matrix))
    norms[norms == 0] = 1.0
    matrix = normal_matrix / np.outer(norms, norms) + damping * np.eye(len(gradient))
    n_fitted, is_free = len(fitted_indices), np.ones(len(gradient), bool)
    while True:
        step = np.zeros(len(gradient))
        step[is_free] = (
            np.linalg.solve(matrix[np.ix_(is_free, is_free)], (gradient / norms)[is_free])
            / norms[is_free]
        )
        is_beyond = is_free[:n_fitted] & leads_beyond(parameters, fitted_indices, step[:n_fitted])
        if not is_beyond.any():
            return step
        is_free[:n_fitted] &= ~is_beyond


def _covariance(
    parameters: Floats,
    fitted_indices: Sequence[int],
    gestures: Sequence[Gesture],
    starts: Floats,
    force_jacobians: Sequence[Floats],
    squared_error: float,
) -> Floats:
    """Covariance of the parameters in SI units, (p, p), at a sum of squares of the errors."""
    n_fitted, n_compared = len(fitted_indices), sum(int(g.is_compared.sum()) for g in gestures)
    variance = squared_error / max(n_compared - n_fitted - len(starts), 1)
    variables_by_gesture = _variable_indices(n_fitted, starts, gestures)
    n_variables = max(int(indices.max()) for indices in variables_by_gesture) + 1
    normal_matrix, score_covariances = (
        np.zeros((n_variables, n_variables)),
        np.zeros((coloured.N_WINDOWS, n_variables, n_variables)),
    )
    for i, (gesture, variables) in enumerate(zip(gestures, variables_by_gesture, strict=True)):
        jacobian, error = _linearise(
            parameters, fitted_indices, gesture, starts[i], force_jacobians[i]
        )
        normal_matrix[np.ix_(variables, variables)] += jacobian.T @ jacobian
        score_covariances[:, variables[:, None], variables] += coloured.long_run_covariances(
            jacobian * error[:, None], gesture.rate, n_compared
        )
        force_variables, spread = variables[n_fitted + 1 :], gesture.unknown_forces.half_range
        normal_matrix[force_variables, force_variables] += variance / spread**2
        score_covariances[:, force_variables, force_variables] += variance**2 / spread**2
    si_scale = derivative_scales(parameters, fitted_indices)
    return coloured.covariance(normal_matrix, score_covariances)[:n_fitted, :n_fitted] * np.outer(
        si_scale, si_scale
    )


def fit(
    gestures: Sequence[Gesture],
    parameters: Floats,
    fitted_indices: Sequence[int],
    starts: Sequence[float] | None = None,
    iterations: int = 30,
    *,
    is_rough: bool = False,
) -> Fit:
    """Fit the parameters of these indices by the Levenberg-Marquardt method, starting at
    `parameters`.

    Unknown forces are fitted with them. A rough fit has no covariance. Raises EngineError if
    `parameters` is not a valid key.
    """
    start_points = np.array([g.start for g in gestures] if starts is None else starts)
    n_fitted, damping = len(fitted_indices), _DAMPING_INITIAL
    first_force_index = n_fitted + len(start_points)
    n_compared = sum(int(g.is_compared.sum()) for g in gestures)
    position_cost, force_cost = _costs(parameters, gestures, start_points)
    force_jacobians: list[Floats] = []
    n_slow_steps = 0
    for iteration in range(iterations):
        _core.poll()
        # The effect of a force changes little from step to step.
        if iteration % _JACOBIAN_INTERVAL == 0 or not force_jacobians:
            gestures_and_starts = zip(gestures, start_points, strict=True)
            force_jacobians = [_force_derivatives(parameters, g, x) for g, x in gestures_and_starts]
        variance = position_cost / n_compared
        normal_matrix, gradient = _normal_equations(
            parameters, fitted_indices, gestures, start_points, force_jacobians, variance
        )
        for _ in range(_DAMPING_TRIALS):
            step = _damped_step(parameters, fitted_indices, normal_matrix, gradient, damping)
            new_parameters, new_starts = (
                step_parameters(parameters, fitted_indices, step[:n_fitted]),
                start_points + step[n_fitted:first_force_index],
            )
            new_gestures = _with_force_step(gestures, step[first_force_index:])
            new_position_cost, new_force_cost = _costs(new_parameters, new_gestures, new_starts)
            relative_fall = 1.0 - (new_position_cost + variance * new_force_cost) / (
                position_cost + variance * force_cost
            )
            if relative_fall > 0:
                break
            damping *= 10
        else:
            break
        parameters, start_points, gestures = new_parameters, new_starts, new_gestures
        position_cost, force_cost = new_position_cost, new_force_cost
        damping /= 10
        # A step that is much damped falls little anywhere.
        n_slow_steps = n_slow_steps + 1 if relative_fall < _COST_TOLERANCE else 0
        if n_slow_steps and (damping < _UNDAMPED_BOUND or n_slow_steps == _SLOW_STEPS_MAX):
            if iteration % _JACOBIAN_INTERVAL == 0 or not any(
                g.unknown_forces.ticks.size for g in gestures
            ):
                break
            force_jacobians = []
        damping = max(damping, _DAMPING_MIN)
    if is_rough:
        covariance = np.full((n_fitted, n_fitted), np.nan)
    else:
        if not force_jacobians:
            gestures_and_starts = zip(gestures, start_points, strict=True)
            force_jacobians = [_force_derivatives(parameters, g, x) for g, x in gestures_and_starts]
        covariance = _covariance(
            parameters, fitted_indices, gestures, start_points, force_jacobians, position_cost
        )
    return Fit(
        parameters,
        tuple(fitted_indices),
        tuple(map(float, start_points)),
        covariance,
        float(np.sqrt(position_cost / n_compared)),
        n_compared,
        tuple(g.force[g.unknown_forces.ticks] for g in gestures),
    )


def follow(parameters: Floats, gesture: Gesture) -> Fit:
    """Fit only how a gesture begins, and its unknown forces, to a key of which all is known."""
    return fit([gesture.with_unknown_speed()], parameters, (), is_rough=True)
