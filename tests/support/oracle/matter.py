"""Points in space by DOP853: springs and contacts along distances, and gravity."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Link:
    """A link between two points: K·(distance - rest) + Z·rate; a contact acts only if distance -
    rest is below 0.

    With `normal` the first end is a plane; with `inside` a contact holds the second end in a
    sphere around the first. With `core` the spring falls off as Plummer's attraction does.
    """

    a: int
    b: int
    K: float
    Z: float
    rest: float
    is_contact: bool = False
    exponent: float = 1.0
    normal: tuple[float, ...] | None = None
    inside: bool = False
    core: float = np.inf
    law: Callable[[float, float], float] | None = None  # instead: of distance - rest, and its rate


def forces(
    x: np.ndarray, v: np.ndarray, mass: np.ndarray, links: Sequence[Link], gravity: float
) -> np.ndarray:
    """Forces on points (n, axes); gravity against the last axis."""
    f = np.zeros_like(x)
    f[:, -1] -= mass * gravity
    for link in links:
        apart = x[link.b] - x[link.a]
        if link.normal is not None:
            along = np.array(link.normal)
            e = along @ apart - link.rest
        else:
            length = np.sqrt(apart @ apart)
            along, e = apart / length, length - link.rest
        if link.inside:
            along, e = -along, -e
        rate = along @ (v[link.b] - v[link.a])
        if link.law is not None:
            pull = link.law(e, rate)
        elif link.is_contact:
            pull = -link.K * (-e) ** link.exponent + link.Z * rate if e < 0.0 else 0.0
        else:
            pull = link.K * e * (1.0 + (e / link.core) ** 2) ** -1.5 + link.Z * rate
        f[link.a] += pull * along
        f[link.b] -= pull * along
    return f


def solve(
    x0: np.ndarray,
    v0: np.ndarray,
    mass: np.ndarray,
    links: Sequence[Link],
    when: np.ndarray,
    gravity: float = 0.0,
    drag: float = 0.0,
) -> np.ndarray:
    """Positions at `when` [s], (len(when), n, axes); points of mass 0 are fixed."""
    n, axes = x0.shape
    inverse = np.where(mass > 0.0, 1.0 / np.where(mass > 0.0, mass, 1.0), 0.0)[:, None]

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        x, v = y.reshape(2, n, axes)
        f = forces(x, v, mass, links, gravity) - drag * v
        return np.concatenate([v.ravel(), (f * inverse).ravel()])

    start = np.concatenate([x0.ravel(), v0.ravel()])
    done = solve_ivp(rate, (0.0, when[-1]), start, "DOP853", when, rtol=1e-12, atol=1e-14)
    return done.y.T.reshape(len(when), 2, n, axes)[:, 0]
