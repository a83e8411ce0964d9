"""A single CEL at a rate: its ratios, and the step that leads into its first frame.

M·x'' + Z·x' + K·x = 0 has a closed solution; the ratios κ and ζ give its samples.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from math import inf, pi, sqrt

from ergon import _core
from ergon.common.decay import LN_1000


def _loss(s: float) -> float:
    """1 - exp(-s), to full precision also for small s."""
    with localcontext() as context:
        context.prec = 40
        return float(1 - (-Decimal(s)).exp())


def _poles(m: float, K: float, Z: float, f: float | None, t60: float | None) -> tuple[float, float]:
    """(σ [1/s], ω² [1/s²]); ω² is negative beyond critical damping."""
    if f is not None:
        return LN_1000 / (t60 or inf), (2.0 * pi * f) ** 2
    sigma = 0.5 * Z / m
    return sigma, K / m - sigma * sigma


def ratios(
    m: float, K: float, Z: float, f: float | None, t60: float | None, rate: float
) -> tuple[float, float]:
    """κ and ζ that give the exact samples at `rate` [Hz]."""
    sigma, squared = _poles(m, K, Z, f, t60)
    s = sigma / rate
    if squared >= 0.0:
        half = _core.sin(0.5 * sqrt(squared) / rate)
        loss = _loss(s)
        return loss * loss + 4.0 * (1.0 - loss) * half * half, _loss(2.0 * s)
    fast_rate = sigma + sqrt(-squared)
    slow_rate = K / m / fast_rate
    return _loss(slow_rate / rate) * _loss(fast_rate / rate), _loss(2.0 * s)


def last_step(
    m: float,
    K: float,
    Z: float,
    f: float | None,
    t60: float | None,
    rate: float,
    u: float,
    v: float,
) -> float:
    """x(0) - x(-1/rate) [m] of the free motion that at time 0 is `u` [m] from its rest, with speed
    `v` [m/s].
    """
    if u == 0.0 and v == 0.0:
        return 0.0
    sigma, squared = _poles(m, K, Z, f, t60)
    T = 1.0 / rate
    grown = _core.exp(sigma * T)
    root_rate = sqrt(abs(squared))
    if squared > 0.0:
        c, s = _core.cos(root_rate * T), _core.sin(root_rate * T) / root_rate
        return u - grown * (u * c - (v + sigma * u) * s)
    if squared == 0.0:
        return u - grown * (u - (v + sigma * u) * T)
    fast_rate = sigma + root_rate
    slow_rate = K / m / fast_rate
    a = (v + fast_rate * u) / (fast_rate - slow_rate)
    return u - a * _core.exp(slow_rate * T) - (u - a) * _core.exp(fast_rate * T)
