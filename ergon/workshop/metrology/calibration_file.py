"""A measured key as a calibration file, which a score names by `calib: FILE`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ergon.common.decay import LN_1000

from .gesture import MeasurementError
from .parameters import INDEX, N_KEY, N_MODE, START, mode_indices, n_modes, total_mass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .gesture import Floats
    from .output_error import Fit
    from .stages import Measured


# The name of a parameter in a file, and in the model.
_KEY_FIELDS = (
    ("K", "stiffness"),
    ("Z", "damping"),
    ("weight", "weight"),
    ("dry", "dry"),
    ("presliding", "presliding"),
    ("static", "static_dry"),
    ("static_speed", "static_speed"),
    ("delay", "delay"),
)


def t60(frequency: float, ratio: float) -> float:
    """T60 [s] of a mode; inf without damping."""
    return float(LN_1000 / (2 * np.pi * frequency * ratio)) if ratio else float("inf")


def _fit_figures(fit: Fit) -> tuple[list[str], Floats, Floats]:
    """The figures of a file in SI units, and their covariance, from that of the fit.

    Names, values (n,), covariance (n, n); a figure of a mode has a name such as `mode1.f`. `M`
    is the mass of the key with its modes; without a spring `weight` takes the place of `rest`.
    """
    parameters, fitted_indices = fit.parameters, fit.fitted_indices
    names: list[str] = []
    values: list[float] = []
    gradients_by_figure: list[Floats] = []

    def add(name: str, figure_value: float, gradient: dict[int, float]) -> None:
        names.append(name)
        values.append(float(figure_value))
        gradients_by_figure.append(np.array([gradient.get(index, 0.0) for index in fitted_indices]))

    add(
        "M", total_mass(parameters), dict.fromkeys((0, *range(N_KEY, len(parameters), N_MODE)), 1.0)
    )
    stiffness_index, weight_index = INDEX["stiffness"], INDEX["weight"]
    has_spring = parameters[stiffness_index] > 3 * fit.deviation(stiffness_index)
    if has_spring:
        add(
            "rest",
            -parameters[weight_index] / parameters[stiffness_index],
            {
                stiffness_index: parameters[weight_index] / parameters[stiffness_index] ** 2,
                weight_index: -1 / parameters[stiffness_index],
            },
        )
    for field_name, parameter in _KEY_FIELDS:
        index = INDEX[parameter]
        if index in fitted_indices and not (has_spring and index == weight_index):
            add(field_name, parameters[index], {index: 1.0})
    for mode in range(n_modes(parameters)):
        mass_index, frequency_index, ratio_index = mode_indices(mode)
        decay = t60(float(parameters[frequency_index]), float(parameters[ratio_index]))
        add(f"mode{mode + 1}.M", parameters[mass_index], {mass_index: 1.0})
        add(f"mode{mode + 1}.f", parameters[frequency_index], {frequency_index: 1.0})
        add(
            f"mode{mode + 1}.t60",
            decay,
            {
                frequency_index: -decay / parameters[frequency_index],
                ratio_index: -decay / parameters[ratio_index],
            },
        )
    gradients = np.array(gradients_by_figure)
    return names, np.array(values), gradients @ fit.covariance @ gradients.T


def text(measured: Measured, takes: Sequence[str], day: str) -> str:
    """The file's text; `takes` are the SHA-256 of the takes of the measurement.

    M is the mass of the key with its modes. Each comment is a standard deviation; a row has the
    correlations of a figure with the figures before it.
    """
    fit = measured.fit
    figure_names, values, covariance = _fit_figures(fit)
    deviations = np.sqrt(np.diag(covariance))
    estimates = dict(zip(figure_names, zip(values, deviations, strict=True), strict=True))
    lines = ["ergon: 1"]
    for figure_name, (figure_value, deviation) in estimates.items():
        if figure_name in UNITS:
            unit, scale = UNITS[figure_name]
            lines.append(
                f"{figure_name}: {figure_value * scale:.7g}{unit} # ± {deviation * scale:.3g}"
            )
    if n_modes(fit.parameters):
        lines.append("modes:")
    for mode in range(1, n_modes(fit.parameters) + 1):
        mode_figures = [
            (value * MODE_FIELDS[name][1], deviation * MODE_FIELDS[name][1])
            for name in MODE_FIELDS
            for value, deviation in [estimates[f"mode{mode}.{name}"]]
        ]
        (mass, mass_deviation), (frequency, frequency_deviation), (decay, decay_deviation) = (
            mode_figures
        )
        lines.append(
            f"  - {{M: {mass:.6g}g, f: {frequency:.6g}Hz, t60: {decay:.6g}s}} "
            f"# ± {mass_deviation:.3g} {frequency_deviation:.3g} {decay_deviation:.3g}"
        )
    divisors = np.where(deviations > 0, deviations, 1.0)
    lines.append("correlations:")
    for i, figure_name in enumerate(figure_names):
        correlations = covariance[i, :i] / (divisors[i] * divisors[:i])
        lines.append(" ".join([f"  - {figure_name}", *(f"{x:.6f}" for x in correlations)]))
    if measured.noise is not None:
        lines.append(f"noise: {measured.noise * 1e3:.4g}mm")
    lines.append(f"residual: {fit.rms * 1e6:.3g} um rms in {fit.n_positions} positions")
    lines.append(f"date: {day}")
    lines.append("takes:")
    lines += [f"  - {digest}" for digest in takes]
    return "\n".join(lines) + "\n"


# The figures of a file and of its modes: the unit, and how many of it are one SI unit.
UNITS = {
    "M": ("g", 1e3),
    "K": ("N/m", 1.0),
    "Z": ("Ns/m", 1.0),
    "rest": ("mm", 1e3),
    "weight": ("mN", 1e3),
    "dry": ("mN", 1e3),
    "presliding": ("N/m", 1.0),
    "static": ("mN", 1e3),
    "static_speed": ("mm/s", 1e3),
    "delay": ("ms", 1e3),
    "noise": ("mm", 1e3),
}
MODE_FIELDS = {"M": ("g", 1e3), "f": ("Hz", 1.0), "t60": ("s", 1.0)}
_NUMBER = r"([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?)"
_FIGURE_LINE = re.compile(rf"(\w+): {_NUMBER}([A-Za-z/]+)(?: # ± {_NUMBER})?$")
_MODE_LINE = re.compile(
    rf"  - {{M: {_NUMBER}g, f: {_NUMBER}Hz, t60: (?:{_NUMBER}|inf)s}}(?: # ± (.+))?$"
)
_CORRELATION_ROW = re.compile(r"  - ((?:mode\d+\.)?[A-Za-z]\w*)((?: -?[01]\.\d+)*)$")


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration file: its figures in SI units, their standard deviations, modes and date.

    `modes` are rows of mass [kg], frequency [Hz] and damping ratio; in `figures` and
    `deviations` they are called `mode1.M`, `mode1.f` and `mode1.t60`. `correlations` are of
    pairs of names.
    """

    figures: dict[str, float]
    deviations: dict[str, float]
    modes: tuple[tuple[float, float, float], ...]
    date: str
    correlations: dict[tuple[str, str], float] = field(default_factory=dict)

    def covariance(self, names: Sequence[str]) -> Floats:
        """Covariance of figures with known deviations, (names, names), in SI units."""
        deviations = np.array([self.deviations[name] for name in names])
        correlations = self.correlations
        correlation_rows = [
            [
                1.0 if a == b else correlations.get((a, b), correlations.get((b, a), 0.0))
                for b in names
            ]
            for a in names
        ]
        return np.array(correlation_rows).reshape(len(names), len(names)) * np.outer(
            deviations, deviations
        )

    @property
    def parameters(self) -> Floats:
        """The parameters of the model, as `_core.key_path` takes them; the key starts at rest."""
        figures = self.figures
        parameters = np.zeros(N_KEY)
        parameters[0] = figures["M"] - sum(mass for mass, _, _ in self.modes)
        parameters[1:3] = figures["K"], figures["Z"]
        parameters[INDEX["weight"]] = figures.get(
            "weight", -figures.get("rest", 0.0) * figures["K"]
        )
        parameters[START] = figures.get("rest", 0.0)
        for name, parameter in _KEY_FIELDS[3:]:
            parameters[INDEX[parameter]] = figures.get(name, 0.0)
        return (
            np.concatenate([parameters, *map(np.array, self.modes)]) if self.modes else parameters
        )


def read(text: str) -> Calibration:
    """The calibration in a file's text. Raises MeasurementError if `text` did not write it."""
    figures: dict[str, float] = {}
    deviations: dict[str, float] = {}
    correlations: dict[tuple[str, str], float] = {}
    correlated_names: list[str] = []
    modes: list[tuple[float, float, float]] = []
    date = section = ""
    for line in text.splitlines():
        if not line.startswith(" "):
            section = line
        if match := _MODE_LINE.match(line):
            modes.append(_parse_mode(match, f"mode{len(modes) + 1}", figures, deviations))
        elif section == "correlations:" and (match := _CORRELATION_ROW.match(line)):
            coefficients = map(float, match[2].split())
            # If a row is damaged, the part of it that exists is used.
            correlations |= {
                (match[1], name): max(-1.0, min(x, 1.0))
                for name, x in zip(correlated_names, coefficients, strict=False)
            }
            correlated_names.append(match[1])
        elif line.startswith("date: "):
            date = line.removeprefix("date: ").strip()
        elif (match := _FIGURE_LINE.match(line)) and match[1] in UNITS:
            figure_name, value_text, unit, deviation = match.groups()
            expected_unit, per_unit = UNITS[figure_name]
            if unit != expected_unit:
                raise MeasurementError(
                    f"{figure_name} must be in {expected_unit}, as ergon metrology writes it"
                )
            figures[figure_name] = float(value_text) / per_unit
            if deviation is not None:
                deviations[figure_name] = float(deviation) / per_unit
    missing_names = [name for name in ("M", "K", "Z") if name not in figures]
    if missing_names:
        raise MeasurementError(
            f"this is not a calibration file of ergon metrology: it lacks {missing_names[0]}"
        )
    for figure_name, figure_value in (*figures.items(), *deviations.items()):
        is_decay = figure_name.endswith(".t60")  # infinite without damping
        if not (np.isfinite(figure_value) or (is_decay and figure_value > 0.0)):
            raise MeasurementError(f"{figure_name} is not a finite number")
    if not figures["M"] > sum(mass for mass, _, _ in modes):
        raise MeasurementError("M must be above 0 and above the masses of the modes")
    return Calibration(figures, deviations, tuple(modes), date, correlations)


def _parse_mode(
    match: re.Match[str], mode_name: str, figures: dict[str, float], deviations: dict[str, float]
) -> tuple[float, float, float]:
    """A mode from a line: mass, frequency, damping ratio; its figures are also added under its
    name.
    """
    *number_texts, deviations_text = match.groups()
    mode_mass, frequency, decay = (float("inf") if x is None else float(x) for x in number_texts)
    if not (mode_mass > 0.0 and 0.0 < frequency < np.inf and decay > 0.0):
        raise MeasurementError(f"{mode_name} must have a mass, a frequency and a decay above 0")
    deviation_texts = (deviations_text or "").split()
    for i, (figure_name, (_, per_unit)) in enumerate(MODE_FIELDS.items()):
        figures[f"{mode_name}.{figure_name}"] = (mode_mass, frequency, decay)[i] / per_unit
        if len(deviation_texts) == len(MODE_FIELDS) and re.fullmatch(_NUMBER, deviation_texts[i]):
            deviations[f"{mode_name}.{figure_name}"] = float(deviation_texts[i]) / per_unit
    ratio = LN_1000 / (2 * np.pi * frequency * decay) if np.isfinite(decay) else 0.0
    return mode_mass / 1e3, frequency, float(ratio)
