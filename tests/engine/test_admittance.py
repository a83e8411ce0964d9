"""Admittances of parts against closed forms, dense solutions and what the engine plays."""

import numpy as np
import pytest
from sweep import crossed

from ergon import _core
from tests.engine.test_part_modes import Body, random


def dense(body: Body, forced: list[int], listened: list[int], f: np.ndarray) -> np.ndarray:
    """The same by a dense solution at each frequency [(m/s)/N].

    Refined by residuals of extended precision: near a resonance numpy's own is off by 1e-9.
    """
    push = np.zeros(len(body.m))
    push[forced] += 1.0
    result = []
    for omega in 2 * np.pi * np.asarray(f, np.longdouble):
        exact = body.K + 1j * omega * body.Z - omega**2 * np.diag(body.m)
        matrix = exact.astype(complex)
        moved = np.zeros(len(push), np.clongdouble)
        for _ in range(4):
            moved += np.linalg.solve(matrix, (push - exact @ moved).astype(complex))
        result.append(complex(1j * omega * moved[listened].sum()))
    return np.array(result)


def largest(found: np.ndarray, wanted: np.ndarray) -> float:
    assert found.shape == wanted.shape
    return float((np.abs(found - wanted) / np.abs(wanted)).max())


@pytest.mark.parametrize(("seed", "damping"), crossed(range(4), [0.01, 0.3]))
def test_admittance_of_random_networks_against_dense_solution(seed: int, damping: float):
    body = random(seed, damping)
    rng = np.random.default_rng(seed)
    f = np.concatenate([np.geomspace(1.0, 3e3, 30), body.undamped()[::10]])
    forced, first, second = [int(i) for i in rng.choice(100, 3, replace=False)]
    points = [[forced], [first], [first, second]]
    mats = [[body.mats[i] for i in point] for point in points]
    result = body.network.admittance(["b"], [body.mats[forced]], mats, f)
    for row, point in zip(result, points, strict=True):
        assert largest(row, dense(body, [forced], point, f)) < 1e-9
    # Force and velocity may be exchanged (reciprocity).
    back = body.network.admittance(["b"], mats[1], [mats[0]], f)
    assert largest(back[0], result[1]) < 1e-9
    # What a force does at its own point takes energy and gives none.
    assert result[0].real.min() >= 0.0


def test_admittance_of_key_and_free_mass_closed_form():
    network = _core.Network()
    network.part("key")
    key = network.cel("", M=0.4, K=60.0, Z=1.2)
    network.part("free")
    free = network.mas("", M=0.02)
    f = np.geomspace(0.1, 500.0, 300)
    s = 2j * np.pi * f
    assert (
        largest(network.admittance(["key"], [key], [[key]], f)[0], 1 / (0.4 * s + 1.2 + 60.0 / s))
        < 1e-12
    )
    assert largest(network.admittance(["free"], [free], [[free]], f)[0], 1 / (0.02 * s)) < 1e-12


def test_admittance_of_string_closed_form():
    """A row of masses between walls: sin(iθ)·sin((n+1−j)θ) / (k·sin θ·sin((n+1)θ))."""
    n, m, k = 50, 1e-4, 2e3
    body = Body(np.full(n, m))
    for i in range(n - 1):
        body.link(i, i + 1, k)
    body.link(0, None, k)
    body.link(n - 1, None, k)
    f = np.linspace(20.0, 1400.0, 137)
    omega = 2 * np.pi * f
    theta = np.arccos(1 - m * omega**2 / (2 * k))
    i, j = 8, 31
    position = np.sin(i * theta) * np.sin((n + 1 - j) * theta)
    position /= k * np.sin(theta) * np.sin((n + 1) * theta)
    result = body.network.admittance(["b"], [body.mats[i - 1]], [[body.mats[j - 1]]], f)
    assert largest(result[0], 1j * omega * position) < 1e-9


def test_admittance_of_linked_parts():
    network = _core.Network()
    network.part("one")
    first = network.cel("", M=0.1, K=50.0, Z=0.2)
    network.part("two")
    two = network.cel("", M=0.3, K=90.0, Z=0.1)
    network.ref("link", first, two, K=40.0, Z=0.3)
    f = np.array([1.0, 3.0, 10.0])
    K, Z = np.array([[90.0, -40.0], [-40.0, 130.0]]), np.array([[0.5, -0.3], [-0.3, 0.4]])
    for item, omega in zip(
        network.admittance(["one", "two"], [first], [[two]], f)[0], 2 * np.pi * f, strict=True
    ):
        inverse = np.linalg.inv(K + 1j * omega * Z - omega**2 * np.diag([0.1, 0.3]))
        assert item == pytest.approx(1j * omega * inverse[1, 0], rel=1e-12)
    alone = network.admittance(["one"], [first], [[first], [two]], f)
    s = 2j * np.pi * f
    assert largest(alone[0], 1 / (0.1 * s + 0.2 + 50.0 / s)) < 1e-12
    assert np.all(alone[1] == 0.0)  # it is no mass of this part


def test_admittance_at_undamped_pole_infinite():
    network = _core.Network()
    network.part("b")
    m = network.mas("m", M=1.0)
    network.ref("r", m, network.sol("wall"), K=(2 * np.pi * 5.0) ** 2, Z=0.0)
    assert np.isinf(network.admittance(["b"], [m], [[m]], [5.0])[0, 0])


def test_admittance_of_discrete_network():
    rate, f = 1000.0, np.array([3.0, 90.0, 101.0, 400.0])
    network = _core.Network()
    network.part("b", ca_rate=rate)
    m = network.cel("m", M=2.0, K=0.4, Z=0.01)
    z = np.exp(2j * np.pi * f / rate)
    # M (x[n+1] − 2x[n] + x[n−1]) = −K x[n] − Z (x[n] − x[n−1]) + F[n]
    position = 1 / (2.0 * (z - 2 + 1 / z) + 0.4 + 0.01 * (1 - 1 / z))
    result = network.admittance(["b"], [m], [[m]], f)
    assert largest(result[0], 2j * np.pi * f * position) < 1e-12


def test_admittance_elements_of_single_part():
    network = _core.Network()
    network.part("b")
    wall = network.sol("wall")
    m, n = network.mas("m", M=0.01), network.cel("n", M=0.02, K=7.0, Z=0.1)
    network.ref("r", m, n, K=100.0, Z=0.0)
    network.but("c", m, wall, K=1e4, gap=1e-3)
    network.part("other")
    other = network.mas("x", M=1.0)
    network.ref("s", m, other, K=5.0, Z=0.0)
    result = network.elements(["b"])
    assert result.mats == [m, n]
    assert result.masses.tolist() == [0.01, 0.02]
    assert result.kinds == ["CEL", "RES", "BUT"]
    assert (result.a.tolist(), result.b.tolist()) == ([1, 0, 0], [-1, 1, -1])
    assert result.stiffness.tolist() == [7.0, 100.0, 1e4]
    assert (result.n_held, result.ca_rate) == (1, None)
    assert len(network.elements(["b", "other"]).kinds) == 4


def test_admittance_refuses_wrong_frequencies_and_parts():
    body = random(0, 0.1)
    for frequency in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(_core.EngineError, match="above 0 Hz"):
            body.network.admittance(["b"], [0], [[0]], [frequency])
    with pytest.raises(_core.EngineError, match="no part has this name"):
        body.network.elements(["x"])
