"""Non-linear scenes by DOP853, the eighth-order Runge-Kutta of Dormand and Prince."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from oracle.laws import law
from oracle.scene import Scene


def solve(
    scene: Scene,
    when: np.ndarray,
    rtol: float = 1e-13,
    push: Callable[[float], np.ndarray] | None = None,
) -> np.ndarray:
    """State (x and v of every MAT) at `when` [s]: (2, len(when), n_mat). Undriven scenes.

    `push`: forces on all MATs as a function of time.
    """
    n = len(scene.mats)
    mass = np.array([p.M for p in scene.mats])
    ground = np.array([(p.K, p.Z, p.rest) for p in scene.mats])

    def force(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        f = -ground[:, 0] * (x - ground[:, 2]) - ground[:, 1] * v
        for link in scene.lias:
            d, w = x[link.b] - x[link.a] - link.offset, v[link.b] - v[link.a]
            if link.kind == "ref":
                pull = link.K * d + link.Z * w
            elif link.law is not None:
                pull = law(link.law.number, np.array(link.law.values()), d, w)
            else:
                sign = 1.0 if link.side == "below" else -1.0
                p = sign * (x[link.a] - x[link.b]) - link.offset
                pull = -sign * (link.K * p**link.exponent - link.Z * sign * w) if p > 0.0 else 0.0
            f[link.a] += pull
            f[link.b] -= pull
        return f

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        f = force(y[:n], y[n:])
        return np.concatenate([y[n:], (f if push is None else f + push(t)) / mass])

    start = np.array([[p.X0 for p in scene.mats], [p.V0 for p in scene.mats]]).ravel()
    done = solve_ivp(rate, (when[0], when[-1]), start, "DOP853", when, rtol=rtol, atol=1e-16)
    return done.y.reshape(2, n, len(when)).transpose(0, 2, 1)
