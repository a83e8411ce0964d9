"""Modes of networks that links damp unlike, against the eigenvalues of their state by numpy."""

import numpy as np
import pytest

from ergon import _core

LN_1000 = 3.0 * np.log(10.0)


def random(seed: int, n: int, damping: float) -> tuple[_core.Network, np.ndarray]:
    """A network of n masses in a chain with cross links, and the poles of its equations."""
    rng = np.random.default_rng(seed)
    network = _core.Network()
    network.part("s")
    m, k0, z0 = rng.uniform(1e-3, 2e-2, n), rng.uniform(0.0, 300.0, n), rng.uniform(0.0, 0.1, n)
    K, Z = np.diag(k0), np.diag(damping * z0)
    mats = [
        network.cel(f"m{i}", M=m[i], K=k0[i], Z=damping * z0[i], X0=0.0, V0=0.0) for i in range(n)
    ]
    pairs = [(i, i + 1) for i in range(n - 1)] + [(i, i + 3) for i in range(0, n - 3, 2)]
    for i, j in pairs:
        k, z = rng.uniform(2e3, 2e4), damping * rng.uniform(0.0, 1.0) ** 4
        network.ref(f"r{i}.{j}", mats[i], mats[j], K=k, Z=z)
        e = np.zeros(n)
        e[i], e[j] = 1.0, -1.0
        K, Z = K + k * np.outer(e, e), Z + z * np.outer(e, e)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K / m[:, None], -Z / m[:, None]]])
    return network, np.linalg.eig(A)[0]


def lowest_modes(poles: np.ndarray, count: int) -> np.ndarray:
    """(f, T60) of the lowest modes; of real poles the slower ones."""
    swinging = poles[poles.imag > 1e-6 * np.abs(poles)]
    real = np.sort_complex(poles[np.abs(poles.imag) <= 1e-6 * np.abs(poles)])[::-1]
    all_poles = np.concatenate([swinging, real[: len(real) // 2]])
    lowest = all_poles[np.argsort(np.abs(all_poles))][:count]
    return np.column_stack([np.abs(lowest.imag) / (2.0 * np.pi), -LN_1000 / lowest.real])


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("damping", [0.1, 3.0, 30.0])
@pytest.mark.parametrize("n", [2, 7, 40])
def test_network_modes_equal_state_eigenvalues(seed: int, n: int, damping: float):
    network, poles = random(seed, n, damping)
    wanted = lowest_modes(poles, 6)
    result = np.array([(f, t60) for f, t60 in network.modes("s", 6)])
    assert result[:, 0] == pytest.approx(wanted[:, 0], rel=1e-7, abs=1e-7)
    assert result[:, 1] == pytest.approx(wanted[:, 1], rel=1e-6)


def test_network_modes_with_strong_damper_shift_pitch():
    """Damping mode by mode says another pitch: it takes the damper for a part of each."""
    network = _core.Network()
    network.part("s")
    a = network.cel("a", M=1e-3, K=2000.0, Z=0.0, X0=0.0, V0=0.0)
    b = network.cel("b", M=1e-3, K=2000.0, Z=4.0, X0=0.0, V0=0.0)
    network.ref("r", a, b, K=1500.0, Z=0.0)
    K = np.array([[3500.0, -1500.0], [-1500.0, 3500.0]]) / 1e-3
    Z = np.diag([0.0, 4.0]) / 1e-3
    poles = np.linalg.eig(np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -Z]]))[0]
    result = np.array([tuple(mode) for mode in network.modes("s", 2)])
    assert result == pytest.approx(lowest_modes(poles, 2), rel=1e-9)


def test_network_mode_overdamped_t60_of_slower_pole():
    network = _core.Network()
    network.part("s")
    network.cel("a", M=1e-2, K=50.0, Z=4.0, X0=0.0, V0=0.0)
    ((f, t60),) = network.modes("s", 1)
    slow = 200.0 - np.sqrt(200.0**2 - 5000.0)
    assert (f, t60) == (0.0, pytest.approx(LN_1000 / slow, rel=1e-9))


def test_network_modes_of_large_damped_string():
    network = _core.Network()
    network.part("s")
    first = network.string("s", masses=160, M=8e-3, f=110.0)
    wall = network.sol("wall")
    network.ref("d", first + 100, wall, K=0.0, Z=1e-4)
    light, _ = network.modes("s", 2)
    # A light damper takes of a mode by its share there: 2·Z·sin²(πx)/M over the string's mass.
    decay = 1e-4 * np.sin(np.pi * 101 / 161) ** 2 / 8e-3
    assert light.f == pytest.approx(110.0, rel=1e-6)
    assert light.t60 == pytest.approx(LN_1000 / decay, rel=2e-2)
