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
_SECONDS, _AMPLITUDE, _FORCE_MAX = 4.0, 5e-3, 20.0  # standard gesture: s, m, N
_GRAVITY = 9.80665
_SAME_MODE_DISTANCE = 0.2  # modes nearer than this in log pitch are one mode
_EIGENVALUE_MIN = 1e-5  # smaller eigenvalues of a correlation matrix are rounding


@dataclass(frozen=True, slots=True)
class Replay:
    """A gesture on a real key and on its model; n positions are compared.

    `residual` (n,) [m] is real minus model at the instants `t` (n,) [s]; `gesture` has the
    forces with the unknown ones recovered, `model` (ticks,) [m] is the model's path.
    """

    gesture: Gesture
    model: Floats
    t: Floats
    residual: Floats

    @property
    def rms(self) -> float:
        """Rms of the residual [m]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def residual_max(self) -> float:
        """The greatest residual [m]."""
        return float(np.abs(self.residual).max())


def replay(parameter_row: Floats, gesture: Gesture) -> Replay:
    """Apply the forces of a real key to its model, which begins where and as fast as the key."""
    followed = output_error.follow(parameter_row, gesture)
    (gesture,) = followed.recovered([gesture.with_unknown_speed()])
    model = output_error.path(parameter_row, gesture, followed.starts[0])
    ticks = np.flatnonzero(gesture.counts)
    return Replay(gesture, model, ticks / gesture.rate, gesture.position[ticks] - model[ticks])


def replay_difference(first_row: Floats, second_row: Floats) -> float:
    """Rms of the difference [m] of two keys under a standard gesture of knocks.

    Raises MeasurementError.
    """
    knocked_row = first_row.copy()
    knocked_row[INDEX["stiffness"]] = max(first_row[1], 1e-3)
    forces = excitation.knocks(knocked_row, _RATE, _SECONDS, _AMPLITUDE, _FORCE_MAX)
    paths = []
    for row in (first_row, second_row):
        free_row = row.copy()
        # Each path begins at rest at 0, so that only the motion is compared.
        free_row[START] = free_row[INDEX["weight"]] = 0.0
        try:
            paths.append(_core.key_path(free_row, forces, _RATE, columns=())[0])
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
    first: float | None
    other: float | None
    deviation: float | None

    @property
    def deviations(self) -> float | None:
        """The difference in units of its standard deviation; None if either is not known."""
        if self.first is None or self.other is None or not self.deviation:
            return None
        return (self.other - self.first) / self.deviation


def differences(calibration: Calibration, second_calibration: Calibration) -> list[Difference]:
    """All figures of two calibrations. Modes of nearly the same frequency count as the same
    mode.
    """
    pairs = [(name, name) for name in UNITS if name != "noise"]
    for first_mode, other_mode in _alike(calibration, second_calibration):
        pairs += [
            (f"mode{first_mode}.{field_name}", f"mode{other_mode}.{field_name}")
            for field_name in MODE_FIELDS
        ]
    differences_found = []
    for first_name, second_name in pairs:
        first_value, other_value = (
            calibration.figures.get(first_name),
            second_calibration.figures.get(second_name),
        )
        if first_value is None and other_value is None:
            continue
        deviation = None
        if first_name in calibration.deviations and second_name in second_calibration.deviations:
            deviation = float(
                np.hypot(
                    calibration.deviations[first_name], second_calibration.deviations[second_name]
                )
            )
        differences_found.append(
            Difference((first_name, second_name), first_value, other_value, deviation)
        )
    return differences_found


def _alike(calibration: Calibration, second_calibration: Calibration) -> list[tuple[int, int]]:
    """Pairs of mode numbers, from 1; a mode that only one calibration has is paired with 0."""
    pitch_distances = sorted(
        (abs(np.log(first_frequency / other_frequency)), a, b)
        for a, (_, first_frequency, _) in enumerate(calibration.modes, 1)
        for b, (_, other_frequency, _) in enumerate(second_calibration.modes, 1)
    )
    mode_pairs: list[tuple[int, int]] = []
    for distance, a, b in pitch_distances:
        if distance < _SAME_MODE_DISTANCE and not any(a == x or b == y for x, y in mode_pairs):
            mode_pairs.append((a, b))
    first_modes, second_modes = {a for a, _ in mode_pairs}, {b for _, b in mode_pairs}
    mode_pairs += [(a, 0) for a in range(1, len(calibration.modes) + 1) if a not in first_modes]
    mode_pairs += [
        (0, b) for b in range(1, len(second_calibration.modes) + 1) if b not in second_modes
    ]
    return sorted(mode_pairs)


def chi_squared(calibration: Calibration, second_calibration: Calibration) -> tuple[float, int]:
    """Δᵀ(C₁ + C₂)⁻¹Δ of the figures whose deviations both files give, and their number.

    For two calibrations of the same key its mean is this number. Combinations that the
    covariance makes certain, to five digits, are left out and not counted.
    """
    comparable_differences = [
        d for d in differences(calibration, second_calibration) if d.deviations is not None
    ]
    if not comparable_differences:
        return 0.0, 0
    first_names, second_names = ([d.names[i] for d in comparable_differences] for i in (0, 1))
    covariance = calibration.covariance(first_names) + second_calibration.covariance(second_names)
    deviations = np.sqrt(np.diag(covariance))
    eigen_values, vectors = np.linalg.eigh(covariance / np.outer(deviations, deviations))
    components = vectors.T @ np.array([d.deviations for d in comparable_differences])
    is_certain = eigen_values > _EIGENVALUE_MIN
    return float(np.sum(components[is_certain] ** 2 / eigen_values[is_certain])), int(
        is_certain.sum()
    )


@dataclass(frozen=True, slots=True)
class Gain:
    """A figure of a weighed key, and its standard deviation; None if the files do not give it."""

    value: float
    deviation: float | None


def gains(plain: Calibration, loaded: Calibration, known_mass: float) -> dict[str, Gain]:
    """The gains of a device for forces and lengths, from a key measured without and with a known
    mass [kg].

    `mass` is the true mass over the measured one, `position` the device's reading per metre
    and `force` the motor's force per requested newton. The last two are missing if the mass does
    not sink the key. M [kg], K [N/m] and Z [N·s/m] are the true values of the key. Deviations are
    to first order in those of the files and their covariances. Raises MeasurementError.
    """
    mass_gain_measured = loaded.figures["M"] - plain.figures["M"]
    if mass_gain_measured <= 0:
        raise MeasurementError("the key with the mass was found no heavier than without it")
    mass_factor = known_mass / mass_gain_measured
    # Derivatives of the logarithms with respect to figures of the first file, and of the second.
    mass_slopes = {"M": 1.0 / mass_gain_measured}, {"M": -1.0 / mass_gain_measured}
    by_name = {"mass": _gain(mass_factor, plain, loaded, *mass_slopes)}
    for figure_name in ("M", "K", "Z"):
        plain_value = plain.figures[figure_name]
        first_slopes = dict(mass_slopes[0])
        first_slopes[figure_name] = first_slopes.get(figure_name, 0.0) + (
            1.0 / plain_value if plain_value else 0.0
        )
        by_name[figure_name] = _gain(
            mass_factor * plain_value, plain, loaded, first_slopes, mass_slopes[1]
        )
    rest_positions = (plain.figures.get("rest"), loaded.figures.get("rest"))
    if rest_positions[0] is None or rest_positions[1] is None:
        return by_name
    sink, stiffness = rest_positions[1] - rest_positions[0], plain.figures["K"]
    sink_min = 5 * sum(c.deviations.get("rest", 0.0) for c in (plain, loaded))
    # Dry friction holds a key anywhere near its rest, and the fit knows only the middle.
    if abs(sink) <= max(sink_min, 1e-9):
        return by_name
    force_factor = known_mass * _GRAVITY / (abs(sink) * stiffness)
    force_slopes = {"K": -1.0 / stiffness, "rest": 1.0 / sink}, {"rest": -1.0 / sink}
    position_slopes = (
        {name: -x for name, x in force_slopes[0].items()} | mass_slopes[0],
        {"rest": 1.0 / sink} | mass_slopes[1],
    )
    by_name["position"] = _gain(mass_factor / force_factor, plain, loaded, *position_slopes)
    by_name["force"] = _gain(force_factor, plain, loaded, *force_slopes)
    return by_name


def _gain(
    figure_value: float,
    plain: Calibration,
    loaded: Calibration,
    first_slopes: Mapping[str, float],
    second_slopes: Mapping[str, float],
) -> Gain:
    """A figure from the derivatives of its logarithm with respect to figures of two files."""
    variance = 0.0
    for calibration, slope_by_figure in ((plain, first_slopes), (loaded, second_slopes)):
        if not all(name in calibration.deviations for name in slope_by_figure):
            return Gain(figure_value, None)
        slope_values = np.array(list(slope_by_figure.values()))
        variance += float(
            slope_values @ calibration.covariance(list(slope_by_figure)) @ slope_values
        )
    return Gain(figure_value, abs(figure_value) * float(np.sqrt(variance)))
