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
    parameter_row, fitted_columns = fit.row, fit.columns
    figure_names: list[str] = []
    figure_values: list[float] = []
    slopes: list[Floats] = []

    def add(name: str, value: float, gradient: dict[int, float]) -> None:
        figure_names.append(name)
        figure_values.append(float(value))
        slopes.append(np.array([gradient.get(index, 0.0) for index in fitted_columns]))

    add(
        "M",
        total_mass(parameter_row),
        dict.fromkeys((0, *range(N_KEY, len(parameter_row), N_MODE)), 1.0),
    )
    k, w = INDEX["stiffness"], INDEX["weight"]
    has_spring = parameter_row[k] > 3 * fit.deviation(k)
    if has_spring:
        add(
            "rest",
            -parameter_row[w] / parameter_row[k],
            {k: parameter_row[w] / parameter_row[k] ** 2, w: -1 / parameter_row[k]},
        )
    for field_name, parameter in _KEY_FIELDS:
        index = INDEX[parameter]
        if index in fitted_columns and not (has_spring and index == w):
            add(field_name, parameter_row[index], {index: 1.0})
    for mode in range(n_modes(parameter_row)):
        m, f, z = mode_indices(mode)
        decay = t60(float(parameter_row[f]), float(parameter_row[z]))
        add(f"mode{mode + 1}.M", parameter_row[m], {m: 1.0})
        add(f"mode{mode + 1}.f", parameter_row[f], {f: 1.0})
        add(
            f"mode{mode + 1}.t60",
            decay,
            {f: -decay / parameter_row[f], z: -decay / parameter_row[z]},
        )
    slope = np.array(slopes)
    return figure_names, np.array(figure_values), slope @ fit.covariance @ slope.T


def text(measured: Measured, takes: Sequence[str], day: str) -> str:
    """The file's text; `takes` are the SHA-256 of the takes of the measurement.

    M is the mass of the key with its modes. Each comment is a standard deviation; a row has the
    correlations of a figure with the figures before it.
    """
    fit = measured.fit
    figure_names, values, covariance = _fit_figures(fit)
    deviations = np.sqrt(np.diag(covariance))
    value_and_deviation = dict(zip(figure_names, zip(values, deviations, strict=True), strict=True))
    yaml_lines = ["ergon: 1"]
    for figure_name, (figure_value, deviation) in value_and_deviation.items():
        if figure_name in UNITS:
            unit, scale = UNITS[figure_name]
            yaml_lines.append(
                f"{figure_name}: {figure_value * scale:.7g}{unit} # ± {deviation * scale:.3g}"
            )
    if n_modes(fit.row):
        yaml_lines.append("modes:")
    for mode in range(1, n_modes(fit.row) + 1):
        mode_figures = [
            (value * MODE_FIELDS[name][1], deviation * MODE_FIELDS[name][1])
            for name in MODE_FIELDS
            for value, deviation in [value_and_deviation[f"mode{mode}.{name}"]]
        ]
        (m, dm), (f, df), (decay, dt) = mode_figures
        yaml_lines.append(
            f"  - {{M: {m:.6g}g, f: {f:.6g}Hz, t60: {decay:.6g}s}} # ± {dm:.3g} {df:.3g} {dt:.3g}"
        )
    deviation_sizes = np.where(deviations > 0, deviations, 1.0)
    yaml_lines.append("correlations:")
    for i, figure_name in enumerate(figure_names):
        correlations = covariance[i, :i] / (deviation_sizes[i] * deviation_sizes[:i])
        yaml_lines.append(" ".join([f"  - {figure_name}", *(f"{x:.6f}" for x in correlations)]))
    if measured.noise is not None:
        yaml_lines.append(f"noise: {measured.noise * 1e3:.4g}mm")
    yaml_lines.append(f"residual: {fit.rms * 1e6:.3g} um rms in {fit.n} positions")
    yaml_lines.append(f"date: {day}")
    yaml_lines.append("takes:")
    yaml_lines += [f"  - {digest}" for digest in takes]
    return "\n".join(yaml_lines) + "\n"


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
_FIGURE = re.compile(rf"(\w+): {_NUMBER}([A-Za-z/]+)(?: # ± {_NUMBER})?$")
_MODE = re.compile(
    rf"  - {{M: {_NUMBER}g, f: {_NUMBER}Hz, t60: (?:{_NUMBER}|inf)s}}(?: # ± (.+))?$"
)
_CORRELATED = re.compile(r"  - ((?:mode\d+\.)?[A-Za-z]\w*)((?: -?[01]\.\d+)*)$")


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
        deviation_sizes = np.array([self.deviations[name] for name in names])
        correlations = self.correlations
        covariance_rows = [
            [
                1.0 if a == b else correlations.get((a, b), correlations.get((b, a), 0.0))
                for b in names
            ]
            for a in names
        ]
        return np.array(covariance_rows).reshape(len(names), len(names)) * np.outer(
            deviation_sizes, deviation_sizes
        )

    @property
    def row(self) -> Floats:
        """The parameters of the model, as `_core.key_path` takes them; the key starts at rest."""
        figures = self.figures
        parameter_row = np.zeros(N_KEY)
        parameter_row[0] = figures["M"] - sum(mass for mass, _, _ in self.modes)
        parameter_row[1:3] = figures["K"], figures["Z"]
        parameter_row[INDEX["weight"]] = figures.get(
            "weight", -figures.get("rest", 0.0) * figures["K"]
        )
        parameter_row[START] = figures.get("rest", 0.0)
        for name, parameter in _KEY_FIELDS[3:]:
            parameter_row[INDEX[parameter]] = figures.get(name, 0.0)
        return (
            np.concatenate([parameter_row, *map(np.array, self.modes)])
            if self.modes
            else parameter_row
        )


def read(file_text: str) -> Calibration:
    """The calibration in a file's text. Raises MeasurementError if `text` did not write it."""
    figures: dict[str, float] = {}
    deviations: dict[str, float] = {}
    correlations: dict[tuple[str, str], float] = {}
    lines_before: list[str] = []
    calibration_modes: list[tuple[float, float, float]] = []
    date = section_name = ""
    for text_line in file_text.splitlines():
        if not text_line.startswith(" "):
            section_name = text_line
        if line_match := _MODE.match(text_line):
            calibration_modes.append(
                _mode(line_match, f"mode{len(calibration_modes) + 1}", figures, deviations)
            )
        elif section_name == "correlations:" and (line_match := _CORRELATED.match(text_line)):
            correlation_numbers = map(float, line_match[2].split())
            # If a row is damaged, the part of it that exists is used.
            correlations |= {
                (line_match[1], name): max(-1.0, min(x, 1.0))
                for name, x in zip(lines_before, correlation_numbers, strict=False)
            }
            lines_before.append(line_match[1])
        elif text_line.startswith("date: "):
            date = text_line.removeprefix("date: ").strip()
        elif (line_match := _FIGURE.match(text_line)) and line_match[1] in UNITS:
            figure_name, figure_value, unit, deviation = line_match.groups()
            usual_unit, per_unit = UNITS[figure_name]
            if unit != usual_unit:
                raise MeasurementError(
                    f"{figure_name} must be in {usual_unit}, as ergon metrology writes it"
                )
            figures[figure_name] = float(figure_value) / per_unit
            if deviation is not None:
                deviations[figure_name] = float(deviation) / per_unit
    missing = [name for name in ("M", "K", "Z") if name not in figures]
    if missing:
        raise MeasurementError(
            f"this is not a calibration file of ergon metrology: it lacks {missing[0]}"
        )
    for figure_name, figure_value in (*figures.items(), *deviations.items()):
        is_decay = figure_name.endswith(".t60")  # infinite without damping
        if not (np.isfinite(figure_value) or (is_decay and figure_value > 0.0)):
            raise MeasurementError(f"{figure_name} is not a finite number")
    if not figures["M"] > sum(mass for mass, _, _ in calibration_modes):
        raise MeasurementError("M must be above 0 and above the masses of the modes")
    return Calibration(figures, deviations, tuple(calibration_modes), date, correlations)


def _mode(
    mode_match: re.Match[str],
    mode_name: str,
    figures: dict[str, float],
    deviations: dict[str, float],
) -> tuple[float, float, float]:
    """A mode from a line: mass, frequency, damping ratio; its figures are also added under its
    name.
    """
    *number_texts, deviations_text = mode_match.groups()
    mode_mass, frequency, decay = (float("inf") if x is None else float(x) for x in number_texts)
    if not (mode_mass > 0.0 and 0.0 < frequency < np.inf and decay > 0.0):
        raise MeasurementError(f"{mode_name} must have a mass, a frequency and a decay above 0")
    wobbles = (deviations_text or "").split()
    for i, (figure_name, (_, per_unit)) in enumerate(MODE_FIELDS.items()):
        figures[f"{mode_name}.{figure_name}"] = (mode_mass, frequency, decay)[i] / per_unit
        if len(wobbles) == len(MODE_FIELDS) and re.fullmatch(_NUMBER, wobbles[i]):
            deviations[f"{mode_name}.{figure_name}"] = float(wobbles[i]) / per_unit
    ratio = LN_1000 / (2 * np.pi * frequency * decay) if np.isfinite(decay) else 0.0
    return mode_mass / 1e3, frequency, float(ratio)
