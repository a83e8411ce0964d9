"""Linear scenes by their modes: struck at any instant, and exact at any time after."""

from typing import Any

import numpy as np

from oracle.linear import matrices, moving
from oracle.scene import Scene

_PROPORTIONAL = 1e-8  # what digits leave between modes, relative to their damping


def free(x: Any, v: Any, lam: Any, z: Any, t: np.ndarray) -> np.ndarray:
    """(n_t, n_modes): x at time t of x" + z·x' + λ·x = 0, started at x and v; zero before the
    start.
    """
    after = np.clip(t, 0.0, None)[:, None]
    root = np.sqrt((z * z / 4.0 - lam).astype(complex))
    near = np.where(np.abs(root) < 1e-12, 1e-12, root)  # both poles in one: next to it
    a, b = -z / 2.0 + near, -z / 2.0 - near
    moved = ((v - b * x) * np.exp(a * after) - (v - a * x) * np.exp(b * after)) / (a - b)
    return np.where(t[:, None] < 0.0, 0.0, np.real(moved))


def modes(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """λ, z (n_modes), shapes of mass 1 (n_free, n_modes), and the MATs that move (n_free)."""
    M, K, Z = matrices(scene)
    position = moving(scene)
    root = np.sqrt(np.diag(M)[position])
    stiffness, damping = (m[np.ix_(position, position)] / np.outer(root, root) for m in (K, Z))
    _, shapes = np.linalg.eigh(stiffness)
    # ωt is large, so rounding of a low eigenvalue of a stiff body is visible. A Rayleigh quotient
    # in long double is insensitive to it.
    wide = shapes.astype(np.longdouble)
    lam = np.einsum("im,ij,jm->m", wide, stiffness.astype(np.longdouble), wide)
    lam /= np.sum(wide * wide, axis=0)
    between = shapes.T @ damping @ shapes
    z = np.diag(between).copy()
    assert np.abs(between - np.diag(z)).max() <= _PROPORTIONAL * max(np.abs(z).max(), 1e-300)
    return lam.astype(float), z, shapes / root[:, None], position


def exact(scene: Scene, rate: float, n_frames: int) -> np.ndarray:
    """Positions (n_frames, n_mat) of a held linear scene of proportional damping."""
    M, K, _ = matrices(scene)
    lam, z, shapes, position = modes(scene)
    fixed = np.setdiff1d(np.arange(len(scene.mats)), position)
    x0 = np.array([p.X0 for p in scene.mats])
    v0 = np.array([p.V0 for p in scene.mats])[position]
    push = np.array([p.K * p.rest for p in scene.mats])
    for link in scene.lias:
        push[link.a] -= link.K * link.offset
        push[link.b] += link.K * link.offset
    rest = np.linalg.solve(
        K[np.ix_(position, position)], push[position] - K[np.ix_(position, fixed)] @ x0[fixed]
    )
    mass = np.diag(M)[position]
    t = np.arange(n_frames) / rate
    q = free(shapes.T @ (mass * (x0[position] - rest)), shapes.T @ (mass * v0), lam, z, t)
    slot = {int(mat): i for i, mat in enumerate(position)}
    for mat, when, impulse, *_ in scene.strikes:
        if mat in slot:
            q += free(np.zeros(len(lam)), impulse * shapes[slot[mat]], lam, z, t - when)
    out = np.tile(x0, (n_frames, 1))
    out[:, position] = rest + q @ shapes.T
    return out


def outputs(scene: Scene, x: np.ndarray) -> np.ndarray:
    """(n_frames, n_out): positions and forces on the ground, with MATs at x (n_frames, n_mat)."""
    assert all(kind != 1 for taps in scene.outs for kind, _, _ in taps), (
        "forces of links are not said"
    )
    single = scene.mats
    text = {0: lambda i: x[:, i], 2: lambda i: single[i].K * (x[:, i] - single[i].rest)}
    return np.stack([sum(w * text[kind](i) for kind, i, w in taps) for taps in scene.outs], axis=1)
