"""A measured key as a calibration file, which a score names by `calib: FILE`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon.common.decay import LN_1000

from .parameters import INDEX, OF_MODE, OWN, n_modes, of_mode, total_mass

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

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
