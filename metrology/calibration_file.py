"""A measured key as a calibration file, which a score names by `calib: FILE`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon.common.decay import LN_1000

from .gesture import MeasurementError
from .parameters import INDEX, OF_MODE, OWN, START, n_modes, of_mode, total_mass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .gesture import Floats
    from .stages import Measured


def t60(frequency: float, ratio: float) -> float:
    """Decay time by 60 dB [s] of a mode; inf without damping."""
    return float(LN_1000 / (2 * np.pi * frequency * ratio)) if ratio else float("inf")


def mass_deviation(measured: Measured) -> float:
    """Standard deviation [kg] of the mass of the key with its modes."""
    fit = measured.fit
    masses = {0, *range(OWN, len(fit.row), OF_MODE)}
    at = [i for i, index in enumerate(fit.columns) if index in masses]
    return float(np.sqrt(fit.covariance[np.ix_(at, at)].sum()))


def rest(measured: Measured) -> tuple[float, float] | None:
    """Where spring and weight balance [m], and its standard deviation; None without a spring."""
    fit = measured.fit
    k, w = INDEX["stiffness"], INDEX["weight"]
    stiffness, weight = fit.row[k], fit.row[w]
    if stiffness <= 3 * fit.deviation(k):
        return None
    at = [fit.columns.index(index) for index in (k, w)]
    slope = np.array([weight / stiffness**2, -1 / stiffness])
    variance = slope @ fit.covariance[np.ix_(at, at)] @ slope
    return float(-weight / stiffness), float(np.sqrt(variance))


def _figures(measured: Measured) -> Iterator[tuple[str, float, float, str, float]]:
    """Name, value and deviation in SI, unit and units of it in one SI unit."""
    fit = measured.fit
    yield "M", total_mass(fit.row), mass_deviation(measured), "g", 1e3
    own = [("K", "stiffness", "N/m", 1.0), ("Z", "damping", "Ns/m", 1.0)]
    balance = rest(measured)
    if balance is None:
        own.append(("weight", "weight", "mN", 1e3))
    else:
        yield "rest", *balance, "mm", 1e3
    own += [
        ("dry", "dry", "mN", 1e3),
        ("presliding", "presliding", "N/m", 1.0),
        ("static", "static_dry", "mN", 1e3),
        ("static_speed", "static_speed", "mm/s", 1e3),
        ("delay", "delay", "ms", 1e3),
    ]
    for name, parameter, unit, per_unit in own:
        index = INDEX[parameter]
        if index in fit.columns:
            yield name, float(fit.row[index]), fit.deviation(index), unit, per_unit


def text(measured: Measured, takes: Sequence[str], day: str) -> str:
    """The file's text; `takes` are the SHA-256 of what it was measured by.

    M is the mass of the key with its modes. Each comment is a standard deviation.
    """
    fit = measured.fit
    lines = ["ergon: 1"]
    lines += [
        f"{name}: {value * scale:.7g}{unit} # ± {deviation * scale:.2g}"
        for name, value, deviation, unit, scale in _figures(measured)
    ]
    if n_modes(fit.row):
        lines.append("modes:")
    for mode in range(n_modes(fit.row)):
        mass, frequency, ratio = (float(fit.row[index]) for index in of_mode(mode))
        lines.append(
            f"  - {{M: {mass * 1e3:.6g}g, f: {frequency:.6g}Hz, t60: {t60(frequency, ratio):.4g}s}}"
        )
    if measured.noise is not None:
        lines.append(f"noise: {measured.noise * 1e3:.4g}mm")
    lines.append(f"residual: {fit.rms * 1e6:.3g} um rms in {fit.n} positions")
    lines.append(f"date: {day}")
    lines.append("takes:")
    lines += [f"  - {digest}" for digest in takes]
    return "\n".join(lines) + "\n"


# The figures of a file: unit, and units of it in one SI unit.
_UNITS = {
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
_NUMBER = r"([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)"
_FIGURE = re.compile(rf"(\w+): {_NUMBER}([A-Za-z/]+)(?: # ± {_NUMBER})?$")
_MODE = re.compile(rf"  - {{M: {_NUMBER}g, f: {_NUMBER}Hz, t60: (?:{_NUMBER}|inf)s}}$")


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration file: its figures in SI units, the deviations that it tells, modes and date.

    `modes` are rows of mass [kg], frequency [Hz] and damping ratio.
    """

    figures: dict[str, float]
    deviations: dict[str, float]
    modes: tuple[tuple[float, float, float], ...]
    date: str

    @property
    def row(self) -> Floats:
        """The parameters of the model, as `_core.key_path` takes them; it starts at rest."""
        own = self.figures
        row = np.zeros(OWN)
        row[0] = own["M"] - sum(mass for mass, _, _ in self.modes)
        row[1:3] = own["K"], own["Z"]
        row[INDEX["weight"]] = own.get("weight", -own.get("rest", 0.0) * own["K"])
        row[START] = own.get("rest", 0.0)
        for name, parameter in (
            ("dry", "dry"),
            ("presliding", "presliding"),
            ("static", "static_dry"),
            ("static_speed", "static_speed"),
            ("delay", "delay"),
        ):
            row[INDEX[parameter]] = own.get(name, 0.0)
        return np.concatenate([row, *map(np.array, self.modes)]) if self.modes else row


def read(said: str) -> Calibration:
    """A calibration of a file's text. Raises MeasurementError where `text` did not write it."""
    figures: dict[str, float] = {}
    deviations: dict[str, float] = {}
    modes = []
    date = ""
    for line in said.splitlines():
        if found := _MODE.match(line):
            mass, frequency, decay = found.groups()
            ratio = LN_1000 / (2 * np.pi * float(frequency) * float(decay)) if decay else 0.0
            modes.append((float(mass) / 1e3, float(frequency), float(ratio)))
        elif line.startswith("date: "):
            date = line.removeprefix("date: ").strip()
        elif (found := _FIGURE.match(line)) and found[1] in _UNITS:
            name, value, unit, deviation = found.groups()
            usual, per_unit = _UNITS[name]
            if unit != usual:
                raise MeasurementError(f"{name} must be in {usual}, as ergon metrology writes it")
            figures[name] = float(value) / per_unit
            if deviation is not None:
                deviations[name] = float(deviation) / per_unit
    missing = [name for name in ("M", "K", "Z") if name not in figures]
    if missing:
        raise MeasurementError(
            f"this is no calibration that ergon metrology has written: it lacks {missing[0]}"
        )
    return Calibration(figures, deviations, tuple(modes), date)
