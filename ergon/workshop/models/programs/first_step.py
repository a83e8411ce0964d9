"""A single CEL at a rate: its ratios, and the step that leads into its first frame.

M·x'' + Z·x' + K·x = 0 has a closed solution; the ratios κ and ζ give its samples.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from math import inf, pi, sqrt

from ergon import _core
from ergon.common.decay import LN_1000


def _complement_of_exp(exponent: float) -> float:
    """1 - exp(-s), to full precision also for small s."""
    with localcontext() as context:
        context.prec = 40
        return float(1 - (-Decimal(exponent)).exp())


def _poles(m: float, K: float, Z: float, f: float | None, t60: float | None) -> tuple[float, float]:
    """(σ [1/s], ω² [1/s²]); ω² is negative beyond critical damping."""
    if f is not None:
        return LN_1000 / (t60 or inf), (2.0 * pi * f) ** 2
    sigma = 0.5 * Z / m
    return sigma, K / m - sigma * sigma


def discrete_ratios(
    m: float, K: float, Z: float, f: float | None, t60: float | None, rate: float
) -> tuple[float, float]:
    """κ and ζ that give the exact samples at `rate` [Hz]."""
    sigma, omega_squared = _poles(m, K, Z, f, t60)
    step_decay = sigma / rate
    if omega_squared >= 0.0:
        half_sine = _core.sin(0.5 * sqrt(omega_squared) / rate)
        amplitude_loss = _complement_of_exp(step_decay)
        return amplitude_loss * amplitude_loss + 4.0 * (
            1.0 - amplitude_loss
        ) * half_sine * half_sine, _complement_of_exp(2.0 * step_decay)
    fast_decay = sigma + sqrt(-omega_squared)
    slow_decay = K / m / fast_decay
    return _complement_of_exp(slow_decay / rate) * _complement_of_exp(
        fast_decay / rate
    ), _complement_of_exp(2.0 * step_decay)


def last_step(
    m: float,
    K: float,
    Z: float,
    f: float | None,
    t60: float | None,
    rate: float,
    displacement: float,
    speed: float,
) -> float:
    """x(0) - x(-1/rate) [m] of the free motion that at time 0 has `displacement` [m] from its rest
    and `speed` [m/s].
    """
    if displacement == 0.0 and speed == 0.0:
        return 0.0
    sigma, omega_squared = _poles(m, K, Z, f, t60)
    period = 1.0 / rate
    decay_inverse = _core.exp(sigma * period)
    omega = sqrt(abs(omega_squared))
    if omega_squared > 0.0:
        cosine, sine_over_omega = _core.cos(omega * period), _core.sin(omega * period) / omega
        return displacement - decay_inverse * (
            displacement * cosine - (speed + sigma * displacement) * sine_over_omega
        )
    if omega_squared == 0.0:
        return displacement - decay_inverse * (
            displacement - (speed + sigma * displacement) * period
        )
    fast_decay = sigma + omega
    slow_decay = K / m / fast_decay
    slow_amplitude = (speed + fast_decay * displacement) / (fast_decay - slow_decay)
    return (
        displacement
        - slow_amplitude * _core.exp(slow_decay * period)
        - (displacement - slow_amplitude) * _core.exp(fast_decay * period)
    )
