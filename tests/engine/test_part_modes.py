"""Modes of parts against closed forms and against the dense eigenvalues of numpy."""

import numpy as np
import pytest

from ergon import _core

CENTS = 1e-6


def cents(outcome: np.ndarray, wanted: np.ndarray) -> float:
    """The largest difference of two lists of pitches [cents]."""
    assert outcome.shape == wanted.shape
    return float(np.abs(1200.0 * np.log2(outcome / wanted)).max())


class Body:
    """A part of masses of its own, and its matrices M (n,), K and Z (n, n)."""

    def __init__(self, m: np.ndarray) -> None:
        self.network = _core.Network()
        self.network.part("b")
        self.wall = self.network.sol("wall")
        self.m = np.asarray(m, dtype=float)
        self.mats = [self.network.mas(f"m{i}", M=one) for i, one in enumerate(m)]
        self.K, self.Z = np.zeros((len(m), len(m))), np.zeros((len(m), len(m)))

    def link(self, a: int, b: int | None, k: float, z: float = 0.0) -> None:
        e = np.zeros(len(self.m))
        e[a] = 1.0
        if b is not None:
            e[b] = -1.0
        self.K += k * np.outer(e, e)
        self.Z += z * np.outer(e, e)
        other = self.wall if b is None else self.mats[b]
        self.network.ref(f"r{a}.{b}", self.mats[a], other, K=k, Z=z)

    def undamped(self) -> np.ndarray:
        root = np.sqrt(self.m)
        values = np.linalg.eigvalsh(self.K / np.outer(root, root))
        return np.sqrt(np.maximum(values, 0.0)) / (2 * np.pi)

    def poles(self) -> np.ndarray:
        """All that swing, from low to high."""
        n = len(self.m)
        rows = [np.zeros((n, n)), np.eye(n)], [-self.K / self.m[:, None], -self.Z / self.m[:, None]]
        result = np.linalg.eigvals(np.block(list(map(list, rows))))
        result = result[result.imag > 1e-9 * np.abs(result)]
        return result[np.argsort(np.abs(result))]


def pitches(modes: _core.PartModes) -> np.ndarray:
    assert modes.is_certified
    return modes.poles.imag / (2 * np.pi)


@pytest.mark.parametrize("fixed", [2, 1, 0])
def test_part_modes_of_fixed_and_free_chains(fixed: int):
    n, k, m = 500, 4e4, 2e-3
    body = Body(np.full(n, m))
    for i in range(n - 1):
        body.link(i, i + 1, k)
    if fixed:
        body.link(0, None, k)
    if fixed == 2:
        body.link(n - 1, None, k)
    j = np.arange(40)
    angle = {2: (j + 1) / (2 * (n + 1)), 1: (2 * j + 1) / (2 * (2 * n + 1)), 0: j / (2 * n)}[fixed]
    wanted = 2 * np.sqrt(k / m) * np.sin(np.pi * angle) / (2 * np.pi)
    result = pitches(body.network.part_modes("b", count=40))
    first = 0 if fixed else 1  # a free chain moves as a whole first
    assert np.all(result[:first] < 1e-3 * wanted[1])
    assert cents(result[first:], wanted[first:]) < CENTS


def test_part_modes_of_square_membrane():
    network = _core.Network()
    network.part("b")
    network.plate("p", shape="square", radius=20, M=0.3, f=65.0, rim="fixed")
    n = round(len(network.part_modes("b", count=1).mats) ** 0.5)
    s = np.sin(np.pi * np.arange(1, n + 1) / (2 * (n + 1))) ** 2
    wanted = np.sqrt(np.sort((s[:, None] + s[None]).ravel()))
    wanted *= 65.0 / wanted[0]
    assert cents(pitches(network.part_modes("b", count=60)), wanted[:60]) < CENTS
    # All up to a frequency, none left out and none too many.
    below = pitches(network.part_modes("b", to=500.0))
    assert cents(below, wanted[wanted <= 500.0]) < CENTS
    # Those next to a frequency.
    nearest = np.sort(wanted[np.argsort(np.abs(wanted**2 - 777.0**2))[:9]])
    assert cents(pitches(network.part_modes("b", count=9, around=777.0)), nearest) < CENTS


def test_part_modes_of_round_membrane():
    places = [(x, y) for x in range(-7, 8) for y in range(-7, 8) if x * x + y * y < 7.4**2]
    body = Body(np.full(len(places), 1e-3))
    for i, (x, y) in enumerate(places):
        for other in ((x + 1, y), (x, y + 1)):
            body.link(i, places.index(other) if other in places else None, 500.0)
        for other in ((x - 1, y), (x, y - 1)):
            if other not in places:
                body.network.ref(f"rim{i}{other}", body.mats[i], body.wall, K=500.0, Z=0.0)
                body.K[i, i] += 500.0
    count = len(places)
    assert cents(pitches(body.network.part_modes("b", count=count)), body.undamped()) < CENTS


def random(seed: int, damping: float) -> Body:
    """100 masses in a chain with links across it, damped here and there."""
    rng = np.random.default_rng(seed)
    body = Body(rng.uniform(1e-3, 2e-2, 100))
    pairs = {(i, i + 1) for i in range(99)}
    pairs |= {tuple(sorted(rng.choice(100, 2, replace=False).tolist())) for _ in range(60)}
    for a, b in sorted(pairs):
        is_damped = rng.uniform() < 0.2
        body.link(a, b, rng.uniform(2e3, 2e4), damping * rng.uniform() * is_damped)
    body.link(int(rng.integers(100)), None, 3e3, damping)
    return body


@pytest.mark.parametrize("seed", range(8))
def test_part_modes_of_random_networks_against_dense(seed: int):
    body = random(seed, 0.0)
    result = pitches(body.network.part_modes("b", count=100))
    assert cents(result, body.undamped()) < CENTS
    middle = float(body.undamped()[50]) * 1.001
    near = body.undamped()
    near = np.sort(near[np.argsort(np.abs(near**2 - middle**2))[:7]])
    assert cents(pitches(body.network.part_modes("b", count=7, around=middle)), near) < CENTS


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("damping", [0.01, 0.3])
def test_part_modes_of_damped_networks_against_dense_problem(seed: int, damping: float):
    body = random(seed, damping)
    wanted = body.poles()[:20]
    result = body.network.part_modes("b", count=20).poles
    assert cents(result.imag, wanted.imag) < 1e-5
    assert result.real == pytest.approx(wanted.real, rel=1e-6)


@pytest.mark.parametrize("count", [90, pytest.param(500, marks=pytest.mark.slow)])
def test_part_modes_of_nearly_equal_damped_pitches(count: int):
    """As many as there are, in several runs: each keeps away from what those before it found."""
    rng = np.random.default_rng(0)
    body = Body(np.full(count, 1e-3))
    k = 1e-3 * (2 * np.pi * 440 * 2 ** (0.02 * np.arange(count) / 1200)) ** 2
    for i in range(count):
        body.link(i, None, k[i], 1e-4 * rng.uniform())
    for i in range(1, count):
        body.link(0, i, 0.0, 1e-4 * rng.uniform() / count)
    wanted = body.poles()
    result = body.network.part_modes("b", count=count)
    assert result.is_certified
    far = np.abs(result.poles[:, None] - wanted)
    assert sorted(far.argmin(axis=1)) == list(range(count))
    assert far.min(axis=1).max() < 1e-11 * abs(wanted[0])


def test_part_modes_of_string_with_strong_damper():
    n = 120
    m = 8e-3 / n
    k = m * (2 * np.pi * 110.0) ** 2 / (4 * np.sin(np.pi / (2 * (n + 1))) ** 2)
    body = Body(np.full(n, m))
    for i in range(n - 1):
        body.link(i, i + 1, k, 2e-8 * k)
    body.link(0, None, k, 2e-8 * k)
    body.link(n - 1, None, k, 2e-8 * k)
    body.network.ref("damper", body.mats[14], body.wall, K=0.0, Z=0.35)
    body.Z[14, 14] += 0.35
    wanted = body.poles()[:20]
    result = body.network.part_modes("b", count=20)
    assert cents(result.poles.imag, wanted.imag) < 1e-5
    assert result.poles.real == pytest.approx(wanted.real, rel=1e-6)
    # Shapes: (s²M + sZ + K) x = 0, and xᵀ(2sM + Z)x = 2i·Im s.
    for s, x in zip(result.poles, result.shapes, strict=True):
        left = s * s * body.m * x + s * body.Z @ x + body.K @ x
        assert np.linalg.norm(left) < 1e-5 * np.linalg.norm(body.K @ x)
        assert x @ (2 * s * body.m * x + body.Z @ x) == pytest.approx(2j * s.imag, rel=1e-6)


def test_part_modes_count_laws_and_contacts_at_rest():
    network = _core.Network()
    network.part("b")
    wall = network.sol("wall")
    m = network.mas("m", M=0.01)
    network.ref("r", m, wall, K=100.0, Z=0.0)
    network.but("c", m, wall, K=1e4, gap=1e-3)
    modes = network.part_modes("b", count=3)
    assert (modes.n_laws, modes.n_contacts) == (0, 1)
    assert modes.poles.imag == pytest.approx([100.0])
    assert modes.shapes == pytest.approx(np.array([[10.0]]))


def test_part_modes_of_discrete_network_scheme():
    """Under `units: ca`: x[n+1] − 2x[n] + x[n−1] = −K x[n] − Z (x[n] − x[n−1])."""
    network = _core.Network()
    network.part("b", ca_rate=1000.0)
    network.cel("m", M=1.0, K=0.4, Z=0.01)
    z = np.roots([1.0, -(2 - 0.4 - 0.01), 1 - 0.01])
    s = 1000.0 * np.log(z[z.imag > 0])
    assert network.part_modes("b", count=1).poles == pytest.approx(s, rel=1e-12)
    f = float(s.imag[0] / (2 * np.pi))
    assert len(network.part_modes("b", to=1.01 * f).poles) == 1
    assert len(network.part_modes("b", to=0.99 * f).poles) == 0


def test_part_modes_refuses_wrong_requests():
    body = random(0, 0.0)
    for asked in ({}, {"count": 3, "to": 5.0}, {"to": -1.0}, {"count": 3, "around": np.nan}):
        with pytest.raises(_core.EngineError, match="modes are asked for"):
            body.network.part_modes("b", **asked)
    with pytest.raises(_core.EngineError, match="no part has this name"):
        body.network.part_modes("x", count=1)
