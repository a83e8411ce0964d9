"""The parameters of a key, as `_core.key_path` takes them, and the scale on which each is
fitted.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .gesture import Floats

NAMES = (
    "mass",
    "stiffness",
    "damping",
    "weight",
    "dry",
    "start",
    "delay",
    "presliding",
    "static_dry",
    "static_speed",
)
MODE_NAMES = ("mode_mass", "mode_frequency", "mode_ratio")
INDEX = {parameter_name: index for index, parameter_name in enumerate(NAMES)}
START = INDEX["start"]
N_KEY, N_MODE = len(NAMES), len(MODE_NAMES)
# Fitted on a linear scale, because they may be zero; [least, most].
_LINEAR_BOUNDS = {
    INDEX["stiffness"]: (0.0, np.inf),
    INDEX["damping"]: (0.0, np.inf),
    INDEX["weight"]: (-np.inf, np.inf),
    START: (-np.inf, np.inf),
    INDEX["delay"]: (0.0, 1.0),
}
# All others are positive. Masses are fitted on a linear scale too, because their sum is known much
# better than each of them; the rest by their logarithms.
_STEP_FACTOR_MAX = np.e  # largest factor of a positive parameter in one step
_UPPER_BOUNDS = {INDEX["presliding"]: 1e6}  # N/m; a stiffer contact holds rigidly
# m/s; static friction that ends at a slower speed is that of a key at rest: no sensor sees its end.
_LOWER_BOUNDS = {INDEX["static_speed"]: 1e-4}
_SAME_MODE_LOG_DISTANCE = 0.05  # of the logarithm of a pitch: modes that are one


def parameter_name(parameter_index: int) -> str:
    """The name of a parameter; those of a mode end in its number from 1."""
    if parameter_index < N_KEY:
        return NAMES[parameter_index]
    mode, mode_parameter = divmod(parameter_index - N_KEY, N_MODE)
    return f"{MODE_NAMES[mode_parameter]}_{mode + 1}"


def mode_indices(mode: int) -> list[int]:
    """The indices of the parameters of a mode, which counts from 0."""
    return [N_KEY + N_MODE * mode + mode_parameter for mode_parameter in range(N_MODE)]


def n_modes(parameters: Floats) -> int:
    """How many modes a row has."""
    return (len(parameters) - N_KEY) // N_MODE


def derivative_scales(parameters: Floats, fitted_indices: Sequence[int]) -> Floats:
    """Derivatives of the parameters with respect to the fitted variables, (columns,)."""
    return np.array(
        [
            1.0 if index in _LINEAR_BOUNDS or _is_mass(index) else parameters[index]
            for index in fitted_indices
        ]
    )


def _is_mass(index: int) -> bool:
    return index == 0 or (index >= N_KEY and (index - N_KEY) % N_MODE == 0)


def step_parameters(parameters: Floats, fitted_indices: Sequence[int], step: Floats) -> Floats:
    """The row after a step of the fitted variables, (columns,), within the bounds of each
    parameter.
    """
    stepped = parameters.copy()
    for index, parameter_step in zip(fitted_indices, step, strict=True):
        parameter = parameters[index]
        if index in _LINEAR_BOUNDS:
            stepped[index] = np.clip(parameter + parameter_step, *_LINEAR_BOUNDS[index])
        elif _is_mass(index):
            stepped[index] = np.clip(
                parameter + parameter_step,
                parameter / _STEP_FACTOR_MAX,
                parameter * _STEP_FACTOR_MAX,
            )
        else:
            stepped_value = parameter * np.exp(np.clip(parameter_step, -1.0, 1.0))
            stepped[index] = np.clip(stepped_value, *_bounds(index))
    return stepped


def _bounds(index: int) -> tuple[float, float]:
    """The least and the greatest value of a parameter."""
    if index in _LINEAR_BOUNDS:
        return _LINEAR_BOUNDS[index]
    return _LOWER_BOUNDS.get(index, 0.0), _UPPER_BOUNDS.get(index, np.inf)


def leads_beyond(
    parameters: Floats, fitted_indices: Sequence[int], step: Floats
) -> NDArray[np.bool_]:
    """Whether a parameter is at a bound and a step leads beyond it, (columns,)."""
    return np.array(
        [_is_beyond(parameters, *pair) for pair in zip(fitted_indices, step, strict=True)], bool
    )


def _is_beyond(parameters: Floats, index: int, parameter_step: float) -> bool:
    value_min, value_max = _bounds(index)
    parameter = parameters[index]
    return bool(
        (parameter <= value_min and parameter_step < 0)
        or (parameter >= value_max and parameter_step > 0)
    )


def is_linear(index: int) -> bool:
    """Whether a parameter is fitted on a linear scale, and so may be zero."""
    return index in _LINEAR_BOUNDS


def is_rigid(parameters: Floats, index: int) -> bool:
    """Whether a stiffness is at its upper bound, where it is practically rigid."""
    return index in _UPPER_BOUNDS and bool(parameters[index] >= 0.99 * _UPPER_BOUNDS[index])


def total_mass(parameters: Floats) -> float:
    """Mass of the key with its modes [kg]."""
    return float(parameters[0] + parameters[N_KEY::N_MODE].sum())


def merge_nearest_modes(parameters: Floats) -> Floats | None:
    """The row with the two modes of nearest pitch as one of their mass; None if all differ."""
    modes = parameters[N_KEY:].reshape(-1, N_MODE)
    log_frequencies = np.log(modes[:, 1])
    order = np.argsort(log_frequencies)
    gaps = np.diff(log_frequencies[order])
    if not gaps.size or gaps.min() > _SAME_MODE_LOG_DISTANCE:
        return None
    nearest_pair = np.sort(order[int(gaps.argmin()) :][:2])
    masses = modes[nearest_pair, 0]
    merged = np.delete(modes, nearest_pair[1], axis=0)
    merged[nearest_pair[0]] = masses.sum(), *(masses @ modes[nearest_pair, 1:] / masses.sum())
    return np.concatenate([parameters[:N_KEY], merged.ravel()])
