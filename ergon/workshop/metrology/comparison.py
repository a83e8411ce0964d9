"""A gesture on a key and on its model, and two calibrations of keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from . import excitation, output_error
from .calibration_file import MODE_FIELDS, UNITS
from .gesture import MeasurementError
from .parameters import INDEX, START

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .calibration_file import Calibration
    from .gesture import Floats, Gesture

_RATE = 44100 / 44  # ticks a second of the standard gesture
_DURATION, _AMPLITUDE, _FORCE_MAX = 4.0, 5e-3, 20.0  # standard gesture: s, m, N
_GRAVITY = 9.80665
_SAME_MODE_DISTANCE = 0.2  # modes nearer than this in log pitch are one mode
_EIGENVALUE_MIN = 1e-5  # smaller eigenvalues of a correlation matrix are rounding


@dataclass(frozen=True, slots=True)
class Replay:
    """A gesture on a real key and on its model; n positions are compared.

    `residual` (n,) [m] is real minus model at the instants `instants` (n,) [s]; `gesture` has the
    forces with the unknown ones recovered, `model_position` (ticks,) [m] is the model's path.
    """

    gesture: Gesture
    model_position: Floats
    instants: Floats
    residual: Floats

    @property
    def rms(self) -> float:
        """Rms of the residual [m]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def residual_max(self) -> float:
        """The greatest residual [m]."""
        return float(np.abs(self.residual).max())


def replay(parameters: Floats, gesture: Gesture) -> Replay:
    """Apply the forces of a real key to its model, which begins where and as fast as the key."""
    follow_fit = output_error.follow(parameters, gesture)
    (gesture,) = follow_fit.with_recovered_forces([gesture.with_unknown_speed()])
    model_position = output_error.model_path(parameters, gesture, follow_fit.start_positions[0])
    ticks = np.flatnonzero(gesture.is_compared)
    return Replay(
        gesture,
        model_position,
        ticks / gesture.rate,
        gesture.position[ticks] - model_position[ticks],
    )


def replay_difference(first_parameters: Floats, second_parameters: Floats) -> float:
    """Rms of the difference [m] of two keys under a standard gesture of knocks.

    Raises MeasurementError.
    """
    guess = first_parameters.copy()
    guess[INDEX["stiffness"]] = max(first_parameters[1], 1e-3)
    forces = excitation.knocks(guess, _RATE, _DURATION, _AMPLITUDE, _FORCE_MAX)
    paths = []
    for row in (first_parameters, second_parameters):
        parameters = row.copy()
        # Each path begins at rest at 0, so that only the motion is compared.
        parameters[START] = parameters[INDEX["weight"]] = 0.0
        try:
            paths.append(_core.key_path(parameters, forces, _RATE, columns=())[0])
        except _core.EngineError as error:
            raise MeasurementError(f"the motion of this key cannot be computed: {error}") from None
    return float(np.sqrt(np.mean((paths[0] - paths[1]) ** 2)))


@dataclass(frozen=True, slots=True)
class Difference:
    """A figure of two calibrations, in SI units; None if one of them lacks it.

    `names` are those of the figure in each; they differ if modes have different numbers.
    `deviation` is the standard deviation of the difference, None if a file does not give one.
    """

    names: tuple[str, str]
    first_value: float | None
    second_value: float | None
    deviation: float | None

    @property
    def deviation_ratio(self) -> float | None:
        """The difference in units of its standard deviation; None if either is not known."""
        if self.first_value is None or self.second_value is None or not self.deviation:
            return None
        return (self.second_value - self.first_value) / self.deviation


def differences(first: Calibration, second: Calibration) -> list[Difference]:
    """All figures of two calibrations. Modes of nearly the same frequency count as the same
    mode.
    """
    name_pairs = [(name, name) for name in UNITS if name != "noise"]
    for first_mode, second_mode in _pair_modes(first, second):
        name_pairs += [
            (f"mode{first_mode}.{field_name}", f"mode{second_mode}.{field_name}")
            for field_name in MODE_FIELDS
        ]
    all_differences = []
    for first_name, second_name in name_pairs:
        first_value = first.figures.get(first_name)
        second_value = second.figures.get(second_name)
        if first_value is None and second_value is None:
            continue
        deviation = None
        if first_name in first.deviations and second_name in second.deviations:
            deviation = float(
                np.hypot(first.deviations[first_name], second.deviations[second_name])
            )
        all_differences.append(
            Difference((first_name, second_name), first_value, second_value, deviation)
        )
    return all_differences


def _pair_modes(first: Calibration, second: Calibration) -> list[tuple[int, int]]:
    """Pairs of mode numbers, from 1; a mode that only one calibration has is paired with 0."""
    distances = sorted(
        (abs(np.log(first_frequency / second_frequency)), a, b)
        for a, (_, first_frequency, _) in enumerate(first.modes, 1)
        for b, (_, second_frequency, _) in enumerate(second.modes, 1)
    )
    pairs: list[tuple[int, int]] = []
    for distance, a, b in distances:
        if distance < _SAME_MODE_DISTANCE and not any(a == x or b == y for x, y in pairs):
            pairs.append((a, b))
    first_modes, second_modes = {a for a, _ in pairs}, {b for _, b in pairs}
    pairs += [(a, 0) for a in range(1, len(first.modes) + 1) if a not in first_modes]
    pairs += [(0, b) for b in range(1, len(second.modes) + 1) if b not in second_modes]
    return sorted(pairs)


def chi_squared(first: Calibration, second: Calibration) -> tuple[float, int]:
    """Δᵀ(C₁ + C₂)⁻¹Δ of the figures whose deviations both files give, and their number.

    For two calibrations of the same key its mean is this number. Combinations that the
    covariance makes certain, to five digits, are left out and not counted.
    """
    comparable = [d for d in differences(first, second) if d.deviation_ratio is not None]
    if not comparable:
        return 0.0, 0
    first_names, second_names = ([d.names[i] for d in comparable] for i in (0, 1))
    covariance = first.covariance(first_names) + second.covariance(second_names)
    deviations = np.sqrt(np.diag(covariance))
    eigenvalues, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    components = vectors.T @ np.array([d.deviation_ratio for d in comparable])
    is_certain = eigenvalues > _EIGENVALUE_MIN
    return float(np.sum(components[is_certain] ** 2 / eigenvalues[is_certain])), int(
        is_certain.sum()
    )


@dataclass(frozen=True, slots=True)
class Gain:
    """A figure of a weighed key, and its standard deviation; None if the files do not give it."""

    value: float
    deviation: float | None


def gains(unloaded: Calibration, loaded: Calibration, known_mass: float) -> dict[str, Gain]:
    """The gains of a device for forces and lengths, from a key measured without and with a known
    mass [kg].

    `mass` is the true mass over the measured one, `position` the device's reading per metre
    and `force` the motor's force per requested newton. The last two are missing if the mass does
    not sink the key. M [kg], K [N/m] and Z [N·s/m] are the true values of the key. Deviations are
    to first order in those of the files and their covariances. Raises MeasurementError.
    """
    measured_mass = loaded.figures["M"] - unloaded.figures["M"]
    if measured_mass <= 0:
        raise MeasurementError("the key with the mass was found no heavier than without it")
    mass_gain = known_mass / measured_mass
    # Derivatives of the logarithms with respect to figures of the first file, and of the second.
    mass_derivatives = {"M": 1.0 / measured_mass}, {"M": -1.0 / measured_mass}
    gain_by_name = {"mass": _gain(mass_gain, unloaded, loaded, *mass_derivatives)}
    for figure_name in ("M", "K", "Z"):
        unloaded_value = unloaded.figures[figure_name]
        unloaded_derivatives = dict(mass_derivatives[0])
        unloaded_derivatives[figure_name] = unloaded_derivatives.get(figure_name, 0.0) + (
            1.0 / unloaded_value if unloaded_value else 0.0
        )
        gain_by_name[figure_name] = _gain(
            mass_gain * unloaded_value, unloaded, loaded, unloaded_derivatives, mass_derivatives[1]
        )
    rest_positions = (unloaded.figures.get("rest"), loaded.figures.get("rest"))
    if rest_positions[0] is None or rest_positions[1] is None:
        return gain_by_name
    sag, stiffness = rest_positions[1] - rest_positions[0], unloaded.figures["K"]
    sag_min = 5 * sum(c.deviations.get("rest", 0.0) for c in (unloaded, loaded))
    # Dry friction holds a key anywhere near its rest, and the fit knows only the middle.
    if abs(sag) <= max(sag_min, 1e-9):
        return gain_by_name
    force_gain = known_mass * _GRAVITY / (abs(sag) * stiffness)
    force_derivatives = {"K": -1.0 / stiffness, "rest": 1.0 / sag}, {"rest": -1.0 / sag}
    position_derivatives = (
        {name: -x for name, x in force_derivatives[0].items()} | mass_derivatives[0],
        {"rest": 1.0 / sag} | mass_derivatives[1],
    )
    gain_by_name["position"] = _gain(
        mass_gain / force_gain, unloaded, loaded, *position_derivatives
    )
    gain_by_name["force"] = _gain(force_gain, unloaded, loaded, *force_derivatives)
    return gain_by_name


def _gain(
    gain: float,
    unloaded: Calibration,
    loaded: Calibration,
    unloaded_derivatives: Mapping[str, float],
    loaded_derivatives: Mapping[str, float],
) -> Gain:
    """A figure from the derivatives of its logarithm with respect to figures of two files."""
    variance = 0.0
    for calibration, derivatives in (
        (unloaded, unloaded_derivatives),
        (loaded, loaded_derivatives),
    ):
        if not all(name in calibration.deviations for name in derivatives):
            return Gain(gain, None)
        gradient = np.array(list(derivatives.values()))
        variance += float(gradient @ calibration.covariance(list(derivatives)) @ gradient)
    return Gain(gain, abs(gain) * float(np.sqrt(variance)))
