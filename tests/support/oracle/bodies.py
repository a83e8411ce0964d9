"""Strings and plates as lists of edges, tuned by the eigenvalues of their own matrices."""

import itertools
import math

import numpy as np

from oracle.scene import Mat, Scene

Edges = list[tuple[int, int, float]]  # (i or -1 for the ground, j, factor of k)


def string_edges(n: int, ends: str, stiffness: float) -> Edges:
    """A row of n masses between its held ends; the ends also count as second neighbours."""
    row = [-1] * (ends in ("fixed", "left")) + list(range(n)) + [-1] * (ends == "fixed")
    edges = [(a, b, 1.0) for a, b in itertools.pairwise(row)]
    if stiffness:
        edges += [(a, b, stiffness) for a, b in zip(row, row[2:], strict=False)]
    return [(min(a, b), max(a, b), s) for a, b, s in edges if a != b]


def plate_edges(shape: str, radius: int) -> tuple[Edges, int]:
    """Edges and number of masses of a free plate; mass 0 is the centre."""
    around = range(-radius, radius + 1)
    if shape == "hex":
        cells = [(q, r) for q in around for r in around if abs(q + r) <= radius]
        steps = [(1, 0), (0, 1), (1, -1)]
    else:
        cells = [(q, r) for q in around for r in around]
        steps = [(1, 0), (0, 1)]
    cells.sort(key=lambda c: c != (0, 0))
    number = {c: i for i, c in enumerate(cells)}
    edges = [
        (number[q, r], number[q + a, r + b], 1.0)
        for q, r in cells
        for a, b in steps
        if (q + a, r + b) in number
    ]
    return edges, len(cells)


def stiffness_of(edges: Edges, n: int) -> np.ndarray:
    """Unit stiffness matrix (n, n)."""
    K = np.zeros((n, n))
    for i, j, s in edges:
        K[j, j] += s
        if i >= 0:
            K[i, i] += s
            K[i, j] -= s
            K[j, i] -= s
    return K


def eigenvalues(edges: Edges, n: int) -> np.ndarray:
    """Eigenvalues of the unit network without its rigid modes, rising."""
    result = np.linalg.eigvalsh(stiffness_of(edges, n))
    return result[result > 1e-9 * result[-1]]


def tune(edges: Edges, n: int, m: float, f: float, t60: float | None) -> tuple[float, float]:
    """(k, z) for which the lowest mode of masses m has frequency f and decay t60.

    f is the damped frequency, as for a CEL: ω² = (2πf)² + σ² and z = 2σk/ω².
    """
    sigma = 3.0 * math.log(10.0) / t60 if t60 is not None else 0.0
    omega2 = (2.0 * math.pi * f) ** 2 + sigma**2
    k = m * omega2 / eigenvalues(edges, n)[0]
    return k, 2.0 * sigma * k / omega2


def string(
    scene: Scene,
    name: str,
    *,
    masses: int,
    M: float,
    f: float,
    t60: float | None = None,
    ends: str = "fixed",
    stiffness: float = 0.0,
    hardening: float = 0.0,
) -> list[Mat]:
    """The core's STRING, expanded for the oracle."""
    edges = string_edges(masses, ends, stiffness)
    k, z = tune(edges, masses, M / masses, f, t60)
    return scene.mesh(
        "string",
        name,
        edges,
        masses,
        M / masses,
        k,
        z,
        hardening,
        masses=masses,
        M=M,
        f=f,
        t60=t60,
        ends=ends,
        stiffness=stiffness,
        hardening=hardening,
    )


def plate(
    scene: Scene,
    name: str,
    *,
    shape: str,
    radius: int,
    M: float,
    f: float,
    t60: float | None = None,
    hardening: float = 0.0,
) -> Mat:
    """The core's free PLATE, expanded; returns its centre."""
    edges, n = plate_edges(shape, radius)
    k, z = tune(edges, n, M / n, f, t60)
    return scene.mesh(
        "plate",
        name,
        edges,
        n,
        M / n,
        k,
        z,
        hardening,
        shape=shape,
        radius=radius,
        M=M,
        f=f,
        t60=t60,
        rim="free",
        hardening=hardening,
    )[0]
