"""The certificate of a network against the roots of its step matrix."""

import contextlib

import numpy as np
import pytest
from oracle import linear
from oracle.scene import Scene
from oracle.scenes import random_network

from ergon import _core

RATE = 44100.0


def refused(scene: Scene) -> bool:
    network, _ = scene.build(_core, RATE)
    with contextlib.suppress(_core.UnstableError):
        network.certify(RATE)
        return False
    with pytest.raises(_core.UnstableError) as error:
        network.certify(RATE)
    assert error.value.module is not None
    assert error.value.module.startswith("p.m")
    return True


def test_stability_map_of_a_cell():
    """T1: |roots| <= 1 of λ² - (2-κ-ζ)λ + 1-ζ against the verdict, over random (κ, ζ)."""
    rng = np.random.default_rng(1)
    verdicts = []
    for kappa, zeta in rng.uniform([1e-3, 1e-3], [5.0, 2.5], size=(400, 2)):
        radius = np.abs(np.roots([1.0, kappa + zeta - 2.0, 1.0 - zeta])).max()
        if abs(radius - 1.0) < 1e-3:
            continue
        scene = Scene()
        scene.part("p", ca_rate=RATE)
        scene.cel("m", M=3.0, K=3.0 * kappa, Z=3.0 * zeta)
        verdicts.append(radius > 1.0)
        assert refused(scene) == verdicts[-1], (kappa, zeta)
    assert 50 < sum(verdicts) < len(verdicts) - 50


def test_certificate_against_spectral_radius_random_networks():
    """T2: spectral radius of the step matrix against the verdict."""
    rng = np.random.default_rng(2)
    verdicts = []
    for _ in range(200):
        scene = Scene()
        scene.part("p")
        n = int(rng.integers(2, 30))
        mats = [scene.mas(f"m{i}", M=10 ** rng.uniform(-3, -2)) for i in range(n)]
        points = [*mats, scene.sol("mg"), scene.cel("mc", M=5e-3, f=900.0, t60=0.5)]
        scale = 10 ** rng.uniform(-0.5, 0.5)
        for j in range(2 * n):
            a, b = rng.choice(len(points), 2, replace=False)
            scene.ref(
                f"ml{j}", points[a], points[b],
                K=10 ** rng.uniform(4.5, 6.5) * scale, Z=rng.uniform(0.0, 5.0) * scale,
            )  # fmt: skip
        radius = np.abs(np.linalg.eigvals(linear.step_matrix(scene, RATE))).max()
        # A rigid mode is a double root at 1, which rounding splits by 1e-8.
        if 1e-6 > radius - 1.0 > 1e-7:
            continue
        verdicts.append(radius > 1.0 + 1e-6)
        assert refused(scene) == verdicts[-1]
    assert 30 < sum(verdicts) < len(verdicts) - 30


def test_certificate_eigenvalue_upper_bound():
    rng = np.random.default_rng(3)
    for seed in range(8):
        scene = random_network(int(rng.integers(1000)) + seed)
        M, K, Z = linear.matrices(scene)
        free = linear.moving(scene)
        for i in free:
            point = scene.mats[i]
            if point.cel:  # pole-exact: κ and ζ instead of K and Z
                kappa, zeta, _ = linear.discrete(point, 1.0 / RATE)
                K[i, i] += kappa * point.M * RATE**2 - point.K
                Z[i, i] += zeta * point.M * RATE - point.Z
        keep = np.ix_(free, free)
        complete = K[keep] / RATE**2 + 2.0 * Z[keep] / RATE
        true = np.linalg.eigvals(np.linalg.solve(M[keep], complete)).real.max()
        network, _ = scene.build(_core, RATE)
        result = network.certify(RATE)
        assert result.lambda_max > true * (1.0 - 1e-9)
        # Gershgorin is at most twice the truth, which is at least the largest diagonal.
        assert result.lambda_max < (2.0 if result.method == "gershgorin" else 1.05) * true
        assert result.oversampling == 1
