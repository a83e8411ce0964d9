"""Masses and cells of a score as stepped points."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ergon.workshop.models.programs.elements import Point
from ergon.workshop.models.programs.first_step import discrete_ratios, last_step


def _sol(fields: Any, name: str, ca_rate: float | None, rate: float) -> Point:
    return Point(name, fields["X0"], "SOL")


def _mas(fields: Any, name: str, ca_rate: float | None, rate: float) -> Point:
    m, v0 = fields["M"], fields.get("V0", 0.0)
    gain = step_per_newton(m, ca_rate, rate)
    description = f"MAS: M = {m!r}{'' if ca_rate else ' kg'}"
    return Point(name, fields.get("X0", 0.0), description, m, gain, v0=v0, d0=v0 / rate)


def _cel(fields: Any, name: str, ca_rate: float | None, rate: float) -> Point:
    m, v0, rest_position = fields["M"], fields.get("V0", 0.0), fields.get("rest", 0.0)
    x0, f, t60 = fields.get("X0", 0.0), fields.get("f"), fields.get("t60")
    K, Z = fields.get("K") or 0.0, fields.get("Z") or 0.0
    kappa, zeta = (
        (K / m, Z / m) if ca_rate and f is None else discrete_ratios(m, K, Z, f, t60, rate)
    )
    d0 = v0 / rate if ca_rate else last_step(m, K, Z, f, t60, rate, x0 - rest_position, v0)
    constants_text = f"f = {f!r} Hz, t60 = {t60!r} s" if f is not None else f"K = {K!r}, Z = {Z!r}"
    description = f"CEL: M = {m!r}, {constants_text}"
    return Point(
        name,
        x0,
        description,
        m,
        step_per_newton(m, ca_rate, rate),
        kappa,
        zeta,
        rest_position,
        v0,
        d0,
    )


def step_per_newton(m: float, ca_rate: float | None, rate: float) -> float:
    """The step for a force of one newton [m/N]."""
    return 1.0 / m if ca_rate else 1.0 / (m * rate * rate)


POINT_MAKERS: dict[str, Callable[[Any, str, float | None, float], Point]] = {
    "SOL": _sol,
    "MAS": _mas,
    "CEL": _cel,
}
