"""Least squares of the output error: the key whose path is nearest to the positions read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from . import coloured
from .parameters import START, leads_beyond, scale, step_parameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .gesture import Floats, Gesture

_DAMPING = (1e-3, 1e-7)  # Levenberg-Marquardt damping: initial and smallest
_DAMPING_MIN = 1e-5  # damping below which a step is nearly that of Gauss and Newton
_SLOW = 3  # steps that hardly fall, after which it has converged even if they are damped
_TRIALS = 12
# Maximal rounds of recovering unknown forces, the relative fall of the cost that ends them, and the
# least share of a step.
_RECOVERIES, _SETTLED_FALL, _LEAST_SHARE = 20, 1e-4, 0.05
_EVERY = 3  # steps of a fit, from one look at what the unknown forces do to the next
_COST_TOLERANCE = 1e-6  # relative fall of the cost below which it has converged


@dataclass(frozen=True, slots=True)
class Fit:
    """A key fitted to gestures; sizes: p fitted parameters.

    `row` holds its parameters, `columns` the indices of the fitted ones. Starting positions are
    fitted too: `starts` holds one for each gesture [m]. `covariance` (p, p) is in SI units, and
    counts how residuals are correlated (`coloured.covariance`). `rms` [m] is the residual, `n`
    the number of positions. `forces` [N] are those at the unknown ticks of each gesture.
    """

    row: Floats
    columns: tuple[int, ...]
    starts: tuple[float, ...]
    covariance: Floats
    rms: float
    n: int
    forces: tuple[Floats, ...] = ()

    def recovered(self, gestures: Sequence[Gesture]) -> list[Gesture]:
        """The gestures of the fit, with the unknown forces that it found."""
        return [g.with_forces(f) for g, f in zip(gestures, self.forces, strict=True)]

    @property
    def bic(self) -> float:
        """Bayesian information criterion; less is better."""
        n_fitted = len(self.columns) + len(self.starts)
        return self.n * float(np.log(self.rms**2)) + n_fitted * float(np.log(self.n))

    def deviation(self, index: int) -> float:
        """Standard deviation of a parameter that was fitted, in its SI unit."""
        position = self.columns.index(index)
        return float(np.sqrt(self.covariance[position, position]))


def path(parameter_row: Floats, gesture: Gesture, start_position: float) -> Floats:
    """The path of a key under the forces of a gesture, (n,) [m]."""
    parameter_row = parameter_row.copy()
    parameter_row[START] = start_position
    return _core.key_path(parameter_row, gesture.force, gesture.rate, columns=())[0]


def errors(row: Floats, gesture: Gesture, start: float) -> Floats:
    """The positions that count minus those of the model [m]."""
    counts = gesture.counts
    return gesture.position[counts] - path(row, gesture, start)[counts]


def _squares(
    parameter_row: Floats, gestures: Sequence[Gesture], starts: Floats
) -> tuple[float, float]:
    """Sums of squares: of position errors [m²], and of unknown forces in units of their spreads."""
    try:
        errors_by_gesture = [
            errors(parameter_row, g, x) for g, x in zip(gestures, starts, strict=True)
        ]
    except _core.EngineError:
        return np.inf, 0.0  # no such key, or too fast a one
    error_squares = sum(float(error @ error) for error in errors_by_gesture)
    return error_squares if np.isfinite(error_squares) else np.inf, sum(
        float(offset @ offset) for offset in map(_off, gestures)
    )


def _off(gesture: Gesture) -> Floats:
    """Deviation of unknown forces from their middles, in units of their spreads (q,)."""
    unknown = gesture.unknown
    return (gesture.force[unknown.ticks] - unknown.middle) / unknown.spread


def _force_derivatives(parameter_row: Floats, gesture: Gesture, start_position: float) -> Floats:
    """Derivatives of the positions that count with respect to the unknown forces, (n, q)."""
    ticks = gesture.unknown.ticks
    if not ticks.size:
        return np.zeros((int(gesture.counts.sum()), 0))
    parameter_row = parameter_row.copy()
    parameter_row[START] = start_position
    derivatives = _core.key_force_derivatives(
        parameter_row, gesture.force, gesture.rate, ticks.tolist()
    )
    return derivatives[gesture.counts]


def recovered(parameter_row: Floats, gesture: Gesture, start_position: float) -> Gesture:
    """The gesture with the unknown forces for which the model comes nearest to the positions
    read.
    """
    ticks, spread = gesture.unknown.ticks, gesture.unknown.spread
    if not ticks.size:
        return gesture
    n, step_share = int(gesture.counts.sum()), 1.0
    error_squares, force_squares = _squares(parameter_row, [gesture], np.array([start_position]))
    for _ in range(_RECOVERIES):
        by_force = _force_derivatives(parameter_row, gesture, start_position) * spread
        variance = error_squares / n
        square = by_force.T @ by_force + variance * np.eye(ticks.size)
        slope = by_force.T @ errors(parameter_row, gesture, start_position) - variance * _off(
            gesture
        )
        step = spread * np.linalg.solve(square, slope)
        while step_share > _LEAST_SHARE:
            nearer = gesture.with_forces(gesture.force[ticks] + step_share * step)
            new_error_squares, new_force_squares = _squares(
                parameter_row, [nearer], np.array([start_position])
            )
            fall = 1.0 - (new_error_squares + variance * new_force_squares) / (
                error_squares + variance * force_squares
            )
            if fall > 0:
                break
            step_share *= 0.5
        else:
            break
        gesture, error_squares, force_squares = nearer, new_error_squares, new_force_squares
        step_share = min(2 * step_share, 1.0)
        if fall < _SETTLED_FALL:
            break
    return gesture


def _columns(n_fitted: int, starts: Floats, gestures: Sequence[Gesture]) -> list[NDArray[np.int64]]:
    """The variables of the fit on which each gesture depends.

    The fit has these variables: parameters, starts of all gestures, unknown forces.
    """
    variables_by_gesture, first_force = [], n_fitted + len(starts)
    for i, gesture in enumerate(gestures):
        forces = np.arange(first_force, first_force + gesture.unknown.ticks.size)
        first_force += forces.size
        variables_by_gesture.append(np.concatenate([np.arange(n_fitted), [n_fitted + i], forces]))
    return variables_by_gesture


def _linear(
    parameter_row: Floats,
    fitted_columns: Sequence[int],
    gesture: Gesture,
    start_position: float,
    by_force: Floats,
) -> tuple[Floats, Floats]:
    """Derivatives of the positions that count by the scaled variables of a gesture (n, variables),
    and the errors (n,).
    """
    fitted, parameter_row = [*fitted_columns, START], parameter_row.copy()
    parameter_row[START] = start_position
    x, jacobian = _core.key_path(parameter_row, gesture.force, gesture.rate, columns=fitted)
    counts = gesture.counts
    scaled = jacobian[counts] * scale(parameter_row, fitted)
    return np.concatenate([scaled, by_force], 1), (gesture.position - x)[counts]


def _normal(
    parameter_row: Floats,
    fitted_columns: Sequence[int],
    gestures: Sequence[Gesture],
    starts: Floats,
    by_force: Sequence[Floats],
    variance: float,
) -> tuple[Floats, Floats]:
    """JᵀJ and Jᵀe in the scaled variables of the fit.

    Each unknown force counts as a measurement of its middle, with its spread as uncertainty.
    """
    variables_by_gesture = _columns(len(fitted_columns), starts, gestures)
    variable_count = max(int(variables.max()) for variables in variables_by_gesture) + 1
    normal_matrix, gradient = np.zeros((variable_count, variable_count)), np.zeros(variable_count)
    for i, (gesture, variables) in enumerate(zip(gestures, variables_by_gesture, strict=True)):
        jacobian, error = _linear(parameter_row, fitted_columns, gesture, starts[i], by_force[i])
        normal_matrix[np.ix_(variables, variables)] += jacobian.T @ jacobian
        gradient[variables] += jacobian.T @ error
        force_variables = variables[len(fitted_columns) + 1 :]
        normal_matrix[force_variables, force_variables] += variance / gesture.unknown.spread**2
        gradient[force_variables] -= variance * _off(gesture) / gesture.unknown.spread
    return normal_matrix, gradient


def _forced(gestures: Sequence[Gesture], force_step: Floats) -> list[Gesture]:
    """The gestures after a step of their unknown forces, (q,)."""
    pushed_gestures, force_offset = [], 0
    for gesture in gestures:
        ticks = gesture.unknown.ticks
        pushed_gestures.append(
            gesture.with_forces(
                gesture.force[ticks] + force_step[force_offset : force_offset + ticks.size]
            )
        )
        force_offset += ticks.size
    return pushed_gestures


def _damped_step(
    parameter_row: Floats,
    fitted_columns: Sequence[int],
    normal_matrix: Floats,
    gradient: Floats,
    damping: float,
) -> Floats:
    """The step of all variables; a parameter at its bound stays there if the step leads beyond."""
    diagonal_roots = np.sqrt(np.diag(normal_matrix))
    diagonal_roots[diagonal_roots == 0] = 1.0
    damped_matrix = normal_matrix / np.outer(diagonal_roots, diagonal_roots) + damping * np.eye(
        len(gradient)
    )
    n_fitted, is_free = len(fitted_columns), np.ones(len(gradient), bool)
    while True:
        damped_step = np.zeros(len(gradient))
        damped_step[is_free] = (
            np.linalg.solve(
                damped_matrix[np.ix_(is_free, is_free)], (gradient / diagonal_roots)[is_free]
            )
            / diagonal_roots[is_free]
        )
        is_beyond = is_free[:n_fitted] & leads_beyond(
            parameter_row, fitted_columns, damped_step[:n_fitted]
        )
        if not is_beyond.any():
            return damped_step
        is_free[:n_fitted] &= ~is_beyond


def _covariance(
    parameter_row: Floats,
    fitted_columns: Sequence[int],
    gestures: Sequence[Gesture],
    starts: Floats,
    by_force: Sequence[Floats],
    error_squares: float,
) -> Floats:
    """Covariance of the parameters in SI units, (p, p), at a sum of squares of the errors."""
    n_fitted, n = len(fitted_columns), sum(int(g.counts.sum()) for g in gestures)
    variance = error_squares / max(n - n_fitted - len(starts), 1)
    variables_by_gesture = _columns(n_fitted, starts, gestures)
    variable_count = max(int(indices.max()) for indices in variables_by_gesture) + 1
    normal_matrix, scores = (
        np.zeros((variable_count, variable_count)),
        np.zeros((coloured.N_WINDOWS, variable_count, variable_count)),
    )
    for i, (gesture, variable_indices) in enumerate(
        zip(gestures, variables_by_gesture, strict=True)
    ):
        jacobian, error = _linear(parameter_row, fitted_columns, gesture, starts[i], by_force[i])
        normal_matrix[np.ix_(variable_indices, variable_indices)] += jacobian.T @ jacobian
        scores[:, variable_indices[:, None], variable_indices] += coloured.long_run(
            jacobian * error[:, None], gesture.rate, n
        )
        force_variables, spread = variable_indices[n_fitted + 1 :], gesture.unknown.spread
        normal_matrix[force_variables, force_variables] += variance / spread**2
        scores[:, force_variables, force_variables] += variance**2 / spread**2
    si_scale = scale(parameter_row, fitted_columns)
    return coloured.covariance(normal_matrix, scores)[:n_fitted, :n_fitted] * np.outer(
        si_scale, si_scale
    )


def fit(
    gestures: Sequence[Gesture],
    parameter_row: Floats,
    columns: Sequence[int],
    starts: Sequence[float] | None = None,
    iterations: int = 30,
    *,
    is_rough: bool = False,
) -> Fit:
    """Fit the parameters of these indices by the Levenberg-Marquardt method, starting at
    `parameter_row`.

    Unknown forces are fitted with them. A rough fit has no covariance. Raises EngineError if
    `parameter_row` is not a valid key.
    """
    start_points = np.array([g.start for g in gestures] if starts is None else starts)
    n_fitted, damping, damping_min = len(columns), *_DAMPING
    first_force = n_fitted + len(start_points)
    n = sum(int(g.counts.sum()) for g in gestures)
    error_squares, force_squares = _squares(parameter_row, gestures, start_points)
    by_force: list[Floats] = []
    n_slow_steps = 0
    for iteration in range(iterations):
        _core.poll()
        # The effect of a force changes little from step to step.
        if iteration % _EVERY == 0 or not by_force:
            gestures_and_starts = zip(gestures, start_points, strict=True)
            by_force = [_force_derivatives(parameter_row, g, x) for g, x in gestures_and_starts]
        variance = error_squares / n
        normal_matrix, gradient = _normal(
            parameter_row, columns, gestures, start_points, by_force, variance
        )
        for _ in range(_TRIALS):
            damped_step = _damped_step(parameter_row, columns, normal_matrix, gradient, damping)
            stepped_row, stepped_starts = (
                step_parameters(parameter_row, columns, damped_step[:n_fitted]),
                start_points + damped_step[n_fitted:first_force],
            )
            stepped_gestures = _forced(gestures, damped_step[first_force:])
            new_error_squares, new_force_squares = _squares(
                stepped_row, stepped_gestures, stepped_starts
            )
            relative_fall = 1.0 - (new_error_squares + variance * new_force_squares) / (
                error_squares + variance * force_squares
            )
            if relative_fall > 0:
                break
            damping *= 10
        else:
            break
        parameter_row, start_points, gestures = stepped_row, stepped_starts, stepped_gestures
        error_squares, force_squares = new_error_squares, new_force_squares
        damping /= 10
        # A step that is much damped falls little anywhere.
        n_slow_steps = n_slow_steps + 1 if relative_fall < _COST_TOLERANCE else 0
        if n_slow_steps and (damping < _DAMPING_MIN or n_slow_steps == _SLOW):
            if iteration % _EVERY == 0 or not any(g.unknown.ticks.size for g in gestures):
                break
            by_force = []
        damping = max(damping, damping_min)
    if is_rough:
        covariance = np.full((n_fitted, n_fitted), np.nan)
    else:
        if not by_force:
            gestures_and_starts = zip(gestures, start_points, strict=True)
            by_force = [_force_derivatives(parameter_row, g, x) for g, x in gestures_and_starts]
        covariance = _covariance(
            parameter_row, columns, gestures, start_points, by_force, error_squares
        )
    return Fit(
        parameter_row,
        tuple(columns),
        tuple(map(float, start_points)),
        covariance,
        float(np.sqrt(error_squares / n)),
        n,
        tuple(g.force[g.unknown.ticks] for g in gestures),
    )


def follow(row: Floats, gesture: Gesture) -> Fit:
    """Fit only how a gesture begins, and its unknown forces, to a key of which all is known."""
    return fit([gesture.with_unknown_speed()], row, (), is_rough=True)
