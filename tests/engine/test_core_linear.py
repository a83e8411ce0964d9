"""Linear networks of the core: poles, whole networks, strings, plates and banks."""

import itertools
import math

import numpy as np
import pytest
from oracle import bodies, linear
from oracle.core import deviation, play, render, simulation
from oracle.scene import Scene
from oracle.scenes import random_network

from ergon import _core

RATE = 44100.0


def cents(f: float, wanted: float) -> float:
    return 1200.0 * math.log2(f / wanted)


def poles(x: np.ndarray, lag: int) -> tuple[float, float]:
    """(a, b) of x[n+lag] = a x[n] - b x[n-lag], least squares: a = 2 rᴸ cos Lθ, b = r²ᴸ."""
    past = np.stack([x[lag:-lag], -x[: -2 * lag]], axis=1)
    a, b = np.linalg.lstsq(past, x[2 * lag :], rcond=None)[0]
    return float(a), float(b)


def ringing(**cel: float) -> np.ndarray:
    scene = Scene()
    scene.part("p")
    mat = scene.cel("m", M=2e-3, X0=1e-3, V0=0.1, **cel)
    scene.listen("o", positions=[(mat, 1.0)])
    return render(scene, RATE, 8000)[:, 0]


@pytest.mark.parametrize(("f", "t60"), [(440.0, 1.0), (5000.0, 0.3), (15000.0, 0.05)])
def test_cell_pitch_and_decay_time(f: float, t60: float):
    # A lag of a quarter period makes the fit best conditioned.
    lag = max(1, round(RATE / (4.0 * f)))
    a, b = poles(ringing(f=f, t60=t60), lag)
    theta = math.acos(a / (2.0 * math.sqrt(b))) / lag
    assert abs(cents(theta * RATE / (2.0 * math.pi), f)) < 1e-9
    assert 6.0 * math.log(10.0) * lag / (-math.log(b) * RATE) == pytest.approx(t60, rel=1e-9)


@pytest.mark.parametrize(
    ("f", "t60", "kappa", "zeta"),
    [
        (440.0, 1.0, 0.0039280803356573019, 0.0003132278173216037),
        (5000.0, 0.3, 0.48612872165831794, 0.0010437112321537868),
    ],
)
def test_cell_coefficients_against_published_vectors(
    f: float, t60: float, kappa: float, zeta: float
):
    a, b = poles(ringing(f=f, t60=t60), 1)
    assert 1.0 - b == pytest.approx(zeta, abs=1e-12)
    assert 2.0 - a - zeta == pytest.approx(kappa, abs=1e-12)


def test_cell_by_stiffness_equals_cell_by_pitch():
    sigma, f = 3.0 * math.log(10.0) / 0.7, 330.0
    K = 2e-3 * ((2.0 * math.pi * f) ** 2 + sigma**2)
    first, two = ringing(f=f, t60=0.7), ringing(K=K, Z=2.0 * 2e-3 * sigma)
    assert np.abs(first - two).max() < 1e-12 * np.abs(first).max()


def test_overdamped_cell_against_closed_form():
    scene = Scene()
    scene.part("p")
    mat = scene.cel("m", M=0.1, K=10.0, Z=5.0, X0=1e-3, V0=0.1, rest=2e-4)
    scene.listen("o", positions=[(mat, 1.0)])
    out = render(scene, RATE, 4410)
    assert np.abs(out - linear.exact(scene, RATE, 4410)).max() < 1e-9 * np.abs(out).max()


@pytest.mark.parametrize("seed", range(6))
def test_random_networks_agree_with_the_oracle(seed: int):
    assert deviation(random_network(seed), RATE, 22050) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_networks_in_algorithmic_units_agree_with_the_oracle(seed: int):
    assert deviation(random_network(seed, ca=True), RATE, 22050) < 1e-12


@pytest.mark.parametrize("ca", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_random_networks_agree_with_oracle(seed: int, ca: bool):
    scene = random_network(seed, ca=ca)
    (_, first, _), (_, other, _) = scene.outs[0][0], scene.outs[1][0]
    for order in (1, 2):
        scene.listen(f"one{order}", positions=[(first, 1.0)], order=order)
        scene.listen(f"two{order}", positions=[(first, 0.5), (other, -2.0)], order=order)
    # A rate of change magnifies the rounding of positions.
    assert deviation(scene, RATE, 22050) < 1e-10


@pytest.mark.parametrize("ca", [False, True])
def test_ground_force_of_cell_by_written_stiffness(ca: bool):
    """K·(x - rest) with the network's own K, not the κM/T² that puts the poles right."""
    scene = Scene()
    scene.part("p", ca_rate=RATE if ca else None)
    M, K = (3.0, 0.5) if ca else (2e-3, 2e6)
    mat = scene.cel("m", M=M, K=K, Z=1e-4, X0=1e-3, rest=2e-4)
    scene.listen("g", ground_forces=[(mat, 1.0)])
    assert deviation(scene, RATE, 2000) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_undamped_networks_converge_with_order_two(seed: int):
    scene = random_network(seed, z=0.0)
    result = []
    for rate in (4 * RATE, 8 * RATE, 16 * RATE):
        n = int(rate * 0.02)
        truth = linear.exact(scene, rate, n)[:, :5]
        error = render(scene, rate, n)[:, :5] - truth
        result.append(20.0 * math.log10(np.linalg.norm(error) / np.linalg.norm(truth)))
    assert result[0] < -40.0
    assert 11.5 < result[0] - result[1] < 12.6
    assert 11.5 < result[1] - result[2] < 12.6


@pytest.mark.parametrize("block", [1, 64, 997])
def test_network_bytes_with_any_block_size(block: int):
    whole = play(simulation(random_network(3), RATE), 4000)
    assert play(simulation(random_network(3), RATE), 4000, block).tobytes() == whole.tobytes()


def test_restored_snapshot_continues_bit_identical():
    sim = simulation(random_network(4), RATE)
    play(sim, 1234)
    saved = sim.snapshot()
    first = play(sim, 3000)
    sim.restore(saved)
    assert sim.frame == 1234
    assert play(sim, 3000).tobytes() == first.tobytes()
    other = simulation(random_network(4), RATE)
    other.restore(saved)
    assert play(other, 3000).tobytes() == first.tobytes()


# --- strings and plates ---


@pytest.mark.parametrize("ends", ["fixed", "free", "left"])
@pytest.mark.parametrize("stiffness", [0.0, 0.05])
def test_string_modes_equal_matrix_eigenvalues(ends: str, stiffness: float):
    network = _core.Network()
    network.part("body")
    first = network.string("s", masses=30, M=8e-3, f=110.0, ends=ends, stiffness=stiffness)
    assert network.count(first) == 30
    lam = bodies.eigenvalues(bodies.string_edges(30, ends, stiffness), 30)
    wanted = 110.0 * np.sqrt(lam / lam[0])
    listened = np.array([f for f, _ in network.modes("body", 12) if f > 1.0])[:8]
    assert listened == pytest.approx(wanted[: len(listened)], rel=1e-9)
    assert len(listened) == 8


@pytest.mark.parametrize(("shape", "radius"), [("hex", 3), ("square", 3)])
def test_plate_modes_equal_matrix_eigenvalues(shape: str, radius: int):
    network = _core.Network()
    network.part("body")
    first = network.plate("p", shape=shape, radius=radius, M=0.3, f=65.0)
    edges, n = bodies.plate_edges(shape, radius)
    assert network.count(first) == n
    lam = bodies.eigenvalues(edges, n)
    listened = np.array([f for f, _ in network.modes("body", 8) if f > 1.0])[:5]
    assert listened == pytest.approx(65.0 * np.sqrt(lam[:5] / lam[0]), rel=1e-8)


def test_plate_with_fixed_rim_in_tune():
    network = _core.Network()
    network.part("body")
    network.plate("p", shape="hex", radius=4, M=0.3, f=65.0, rim="fixed")
    assert network.modes("body", 1)[0][0] == pytest.approx(65.0, rel=1e-8)


def test_string_lowest_mode_t60():
    network = _core.Network()
    network.part("body")
    network.string("s", masses=20, M=8e-3, f=110.0, t60=2.0)
    f, t60 = network.modes("body", 1)[0]
    assert f == pytest.approx(110.0, rel=1e-4)
    assert t60 == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize(
    ("ends", "stiffness", "hardening"),
    [("fixed", 0.0, 0.0), ("fixed", 0.02, 0.0), ("left", 0.02, 0.0), ("fixed", 0.02, 1e7)],
)
def test_string_equals_masses_and_springs(ends, stiffness, hardening):
    scene = Scene()
    scene.part("body")
    mats = bodies.string(
        scene, "s", masses=20, M=8e-3, f=110.0, t60=2.0,
        ends=ends, stiffness=stiffness, hardening=hardening,
    )  # fmt: skip
    scene.start(mats[4], 1e-3, 0.0)
    scene.start(mats[11], 0.0, 0.4)
    scene.listen("x", positions=[(mats[2], 1.0)])
    scene.listen("y", positions=[(mats[15], 1.0)])
    assert deviation(scene, RATE, 22050) < 2e-12


def test_bank_pitches_and_t60_evenly_by_logarithm():
    network = _core.Network()
    network.part("sky")
    first = network.bank("b", count=9, M=1e-3, f=(100.0, 1600.0), t60=(0.5, 8.0))
    assert network.count(first) == 9
    listened = sorted(network.modes("sky", 9))
    assert [f for f, _ in listened] == pytest.approx(
        [100.0 * 2 ** (i / 2) for i in range(9)], rel=1e-9
    )
    assert listened[0][1] == pytest.approx(8.0, rel=1e-9)
    assert listened[-1][1] == pytest.approx(0.5, rel=1e-9)
    assert all(a > b for (_, a), (_, b) in itertools.pairwise(listened))
