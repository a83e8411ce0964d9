"""Paths of written gestures and the dense ergons that move a free key along them."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

RESTING = ([(1, 0.0), (2, 0.0)], [(1, 0.0), (2, 0.0)])


def path(
    t: Sequence[float], x: Sequence[float], curve: Sequence[str], when: np.ndarray
) -> np.ndarray:
    """Positions [m] at `when` [s], evenly spaced; NaN before the first point and after the last.

    A run of `smooth` points is one C4 quintic spline, at rest at both its ends; `line` is
    straight; `hold` is constant. `throw` has no path of its own.
    """
    out = np.full(len(when), np.nan)
    step = when[1] - when[0]

    def sample(instant: float) -> float:
        """The nearest sample to an instant; halves are rounded up [s]."""
        return float(np.floor(instant * (1.0 / step) + 0.5) * step)

    i = 1
    while i < len(t):
        j = i
        if curve[i] == "smooth":
            while j + 1 < len(t) and curve[j + 1] == "smooth":
                j += 1
            part = make_interp_spline(
                np.array(t[i - 1 : j + 1]) - t[i - 1], x[i - 1 : j + 1], k=5, bc_type=RESTING
            )
        else:
            part = make_interp_spline(np.array(t[i - 1 : i + 1]) - t[i - 1], x[i - 1 : i + 1], k=1)
        begin = sample(t[0]) if i == 1 else t[i - 1]
        end = sample(t[-1]) if j == len(t) - 1 else t[j]
        # tolerance of a thousandth of a sample, so that an instant on the grid belongs to the
        # interval
        inside = (when >= begin - 1e-3 * step) & (when <= end + 1e-3 * step)
        out[inside] = part(np.clip(when[inside] - t[i - 1], 0.0, t[j] - t[i - 1]))
        i = j + 1
    return out


def pushing(
    t: Sequence[float], x: Sequence[float], M: float, K: float, Z: float
) -> Callable[[float], float]:
    """The force [N] at a time that moves a free CEL along a smooth run; None before and after
    it.
    """
    part = make_interp_spline(t, x, k=5, bc_type=RESTING)
    speed, acceleration = part.derivative(1), part.derivative(2)

    def force(time: float) -> float:
        if not t[0] <= time <= t[-1]:
            return 0.0
        return float(M * acceleration(time) + Z * speed(time) + K * part(time))

    return force


def ergons(
    asked: np.ndarray, kappa: float, zeta: float, g: float, x0: float, d0: float, rest: float
) -> np.ndarray:
    """Forces F[n] [N] that move a free CEL or MAS to asked[n+1] wherever that is not NaN.

    asked (n_frames + 1,); g = T²/m. F = (X[n+1] - x̂[n+1])/g with x̂ the free copy without
    ergon.
    """
    force = np.zeros(len(asked) - 1)
    x, d = x0, d0
    for n in range(len(force)):
        step = d - zeta * d - kappa * (x - rest)
        wanted = asked[n + 1]
        if not np.isnan(wanted):
            force[n] = ((wanted - x) - step) / g
            step += g * force[n]
        d = step
        x += step
    return force
