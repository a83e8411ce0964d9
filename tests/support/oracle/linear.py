"""Linear scenes by matrices: the continuous network exactly, and the step matrix of the scheme."""

import numpy as np
from scipy.linalg import expm

from oracle.engine import discrete
from oracle.scene import Scene


def matrices(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, K, Z (n_mat, n_mat) in SI, with contacts closed and laws linearised at rest."""
    n = len(scene.mats)
    M = np.diag([p.M for p in scene.mats])
    K = np.diag([p.K for p in scene.mats])
    Z = np.diag([p.Z for p in scene.mats])
    for link in scene.lias:
        k = link.law.slope() if link.law else link.K
        z = link.law.viscosity() if link.law else link.Z
        e = np.zeros(n)
        e[link.a], e[link.b] = 1.0, -1.0
        K += k * np.outer(e, e)
        Z += z * np.outer(e, e)
    return M, K, Z


def moving(scene: Scene) -> np.ndarray:
    return np.array([i for i, p in enumerate(scene.mats) if np.isfinite(p.M)])


def exact(scene: Scene, rate: float, n_frames: int) -> np.ndarray:
    """Positions (n_frames, n_mat) of an undriven linear scene by the matrix exponential.

    SOL stay where they are; `rest` of links and CELs is a constant force.
    """
    M, K, Z = matrices(scene)
    free = moving(scene)
    fixed = np.setdiff1d(np.arange(len(scene.mats)), free)
    x0 = np.array([p.X0 for p in scene.mats])
    v0 = np.array([p.V0 for p in scene.mats])[free]
    push = np.array([p.K * p.rest for p in scene.mats])
    for link in scene.lias:
        push[link.a] -= link.K * link.offset
        push[link.b] += link.K * link.offset
    push = push[free] - K[np.ix_(free, fixed)] @ x0[fixed]
    n = len(free)
    m = np.diag(M)[free]
    A = np.zeros((2 * n + 1, 2 * n + 1))  # the last state is the constant 1
    A[:n, n : 2 * n] = np.eye(n)
    A[n : 2 * n, :n] = -K[np.ix_(free, free)] / m[:, None]
    A[n : 2 * n, n : 2 * n] = -Z[np.ix_(free, free)] / m[:, None]
    A[n : 2 * n, -1] = push / m
    step = expm(A / rate)
    state = np.concatenate([x0[free], v0, [1.0]])
    out = np.tile(x0, (n_frames, 1))
    for k in range(n_frames):
        out[k, free] = state[:n]
        state = step @ state
    return out


def step_matrix(scene: Scene, rate: float) -> np.ndarray:
    """One CA step of (x[n], x[n-1]) of the free MATs; its spectral radius decides stability."""
    T = 1.0 / rate
    free = moving(scene)
    n = len(free)
    _, K, Z = matrices(scene)
    for i, p in enumerate(scene.mats):
        K[i, i] -= p.K
        Z[i, i] -= p.Z
    kzg = [discrete(scene.mats[i], T) for i in free]
    g = np.array([v[2] for v in kzg])[:, None]
    per_v = np.array([1.0 if scene.mats[i].ca else rate for i in free])[:, None]
    k = g * K[np.ix_(free, free)] + np.diag([v[0] for v in kzg])
    z = g * Z[np.ix_(free, free)] * per_v + np.diag([v[1] for v in kzg])
    eye = np.eye(n)
    return np.block([[2.0 * eye - k - z, z - eye], [eye, np.zeros((n, n))]])
