"""Figures that pages and formulas claim: published vectors, and every number in docs and DESIGN.

The formulas are those of docs/numerics.md; the vectors were worked out apart from the engine.
"""

import math
from pathlib import Path

import numpy as np
import pytest
from oracle import linear
from oracle.core import play, simulation
from oracle.key import KEYS, lone
from oracle.scene import Scene
from scipy.interpolate import make_interp_spline

from ergon import _core
from tests.house import test_oracle

ROOT = Path(__file__).parents[2]
RATE = 44100.0
TAKES = sorted((ROOT / "scores/library/takes").glob("*.csv"))


def poles(x: np.ndarray) -> tuple[float, float]:
    """(a, b) of x[n+1] = a·x[n] - b·x[n-1]."""
    a, b = np.linalg.lstsq(np.stack([x[1:-1], -x[:-2]], axis=1), x[2:], rcond=None)[0]
    return float(a), float(b)


def ringing(rate: float, ca_rate: float | None = None, **cel: float) -> np.ndarray:
    network = _core.Network()
    network.part("p", ca_rate=ca_rate)
    mat = network.cel("m", X0=1e-3, **cel)
    network.listen("x", positions=[(mat, 1, 1.0)])
    return play(_core.Simulation(network, _core.Timeline(network, rate)), 4000)[:, 0]


# --- cells ---


@pytest.mark.parametrize(
    ("f", "t60", "kappa", "zeta"),
    [
        (440.0, 1.0, 0.37969998129050642, 0.0031278668340015692),
        (8.0, 0.6, 0.00013637352226331226, 0.0052076741929679964),
    ],
)
def test_cell_poles_at_tenth_of_rate(f: float, t60: float, kappa: float, zeta: float):
    a, b = poles(ringing(4410.0, M=2e-3, f=f, t60=t60))
    assert 1.0 - b == pytest.approx(zeta, abs=1e-12)
    assert 2.0 - a - zeta == pytest.approx(kappa, abs=1e-12)


def test_cell_in_ca_units_same_at_other_rates():
    """`units: ca`: the poles of the network at its own rate, as decay and pitch, at any other."""
    result = []
    for rate in (22050.0, 44100.0, 96000.0):
        a, b = poles(ringing(rate, ca_rate=44100.0, M=3.0, K=0.02, Z=1e-3))
        r = math.sqrt(b)
        result.append((math.acos(a / (2.0 * r)) * rate, math.log(r) * rate))
    single = np.roots([1.0, 0.02 / 3.0 + 1e-3 / 3.0 - 2.0, 1.0 - 1e-3 / 3.0])[0]
    for angle, decay in result:
        assert angle == pytest.approx(abs(np.angle(single)) * 44100.0, rel=1e-9)
        assert decay == pytest.approx(math.log(abs(single)) * 44100.0, rel=1e-7)


@pytest.mark.parametrize(("f", "cents"), [(440.0, 0.28), (1000.0, 1.47), (5000.0, 38.4)])
def test_spring_frequency_error_by_warping(f: float, cents: float):
    network = _core.Network()
    network.part("p")
    mat, wall = network.mas("m", M=1e-3, X0=1e-3), network.sol("w")
    network.ref("k", mat, wall, K=1e-3 * (2.0 * math.pi * f) ** 2)
    network.listen("x", positions=[(mat, 1, 1.0)])
    a, _ = poles(play(_core.Simulation(network, _core.Timeline(network, RATE)), 4000)[:, 0])
    listened = 1200.0 * math.log2(math.acos(a / 2.0) * RATE / (2.0 * math.pi * f))
    assert listened == pytest.approx(cents, abs=5e-3 * (1.0 + cents))
    if f < 2000.0:  # to the order of the formula
        assert listened == pytest.approx(72.13 * (2.0 * math.pi * f / RATE) ** 2, rel=3e-3)


def test_strike_between_samples_split_as_published():
    network = _core.Network()
    network.part("p")
    mat = network.cel("m", M=1.0, f=440.0, t60=1.0)
    network.listen("x", positions=[(mat, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.strike(mat, 10.3 / RATE, impulse=1.0)
    out = play(_core.Simulation(network, timeline), 20)[:, 0] * RATE**2
    assert out[11] == pytest.approx(30856.7098049, rel=1e-11)
    kappa, zeta = 0.0039280803356573019, 0.0003132278173216037
    assert out[12] - (2 - kappa - zeta) * out[11] == pytest.approx(13225.6978351, rel=1e-9)


def test_gesture_knots_published_recursion():
    """F_i = (X_{i+1} - a_L X_i + b_L X_{i-1})/h_L, on a key of 80 g at 4410 Hz, 22 steps a knot."""
    rate, L = 4410.0, 22
    a, b, h = 1.82930900856455, 0.891483642104602, 1.32462961187559e-05
    network, timeline, key = lone(rate, **KEYS["light"])
    x = [0.0, 6e-3, -2e-3, 1e-3, 4e-3]
    t = [(40 + L * i) / rate for i in range(len(x))]
    timeline.gesture(key, t, x, ["throw"] * len(x))
    sim = _core.Simulation(network, timeline, record=True)
    play(sim, 40 + L * len(x))
    before = [0.0, *x]
    wanted = [(x[i + 1] - a * x[i] + b * before[i]) / h for i in range(len(x) - 1)]
    assert sim.ergons()["impulse"] * rate == pytest.approx(wanted, rel=1e-9)


def test_ergon_of_published_strike():
    """m = 8 mg at 3000 m/s on 80 g at 0.1 m/s: p, V' and v'."""
    scene = Scene()
    scene.part("p")
    mat = scene.mas("m", M=0.08, V0=0.1)
    scene.listen("o", positions=[(mat, 1.0)])
    scene.key("p", mat)
    scene.strike(mat, 0.001, mass=8e-6, speed=3000.0)
    sim = simulation(scene, RATE, ledger=True, record=True)
    play(sim, 400)
    (p,) = sim.ergons()["impulse"]
    assert p == pytest.approx(0.0479936006399, rel=1e-11)
    assert 3000.0 - p / 8e-6 == pytest.approx(-2999.20007999, rel=1e-11)
    lost = 0.5 * 8e-6 * (3000.0**2 - (3000.0 - p / 8e-6) ** 2)
    assert sim.energy().injected == pytest.approx(lost, rel=1e-9)


# --- contacts ---


@pytest.mark.parametrize("samples", [3.3, 4.5, 10.7, 30.2])
def test_plain_contact_energy_error_bound(samples: float):
    """|e² - 1| <= κ_μ/4·max(1, e²), at most θ_c²/4, and not far below it."""
    a, b = 1e-3, 4e-3
    kappa = 4.0 * math.sin(math.pi / samples / 2.0) ** 2
    worst = 0.0
    for phase in np.linspace(0.0, 1.0, 50):
        network = _core.Network()
        network.part("p")
        first, two = network.mas("a", M=a, X0=-(2.0 + phase) / RATE, V0=1.0), network.mas("b", M=b)
        network.but("c", first, two, K=kappa * a * b / (a + b) * RATE**2)
        sim = _core.Simulation(network, _core.Timeline(network, RATE))
        sim.process(np.zeros((int(1.5 * samples) + 12, 0)))
        va, vb = sim.velocities()
        assert vb > va
        worst = max(worst, abs((vb - va) ** 2 - 1.0) / max(1.0, (vb - va) ** 2))
    assert 0.5 * kappa / 4.0 < worst <= kappa / 4.0 * (1.0 + 1e-9)
    assert kappa <= (math.pi / samples) ** 2


# --- order ---


def error(scene: Scene, rate: float) -> float:
    """Of the core's 0.1 s against the matrix exponential [dB]."""
    n = int(0.1 * rate)
    return test_oracle.level(play(simulation(scene, rate), n), linear.exact(scene, rate, n))


@pytest.mark.slow
def test_first_step_error_with_and_without_link_start():
    """-55 dB without the links' forces in the first step, -76 dB with, at four times 44.1 kHz."""
    scene = test_oracle.network()
    assert test_oracle.errors(scene, 0.1, link_start=False)[2] == pytest.approx(-54.9, abs=0.5)
    assert error(scene, 4 * RATE) == pytest.approx(-76.5, abs=0.5)


def test_link_damping_lowers_convergence_order_to_one():
    """M' = M - Z/2: against the matrix exponential, 6 dB a halving where it is 12 without Z."""
    scene = test_oracle.network(z=0.05, t60=1.0)
    result = [error(scene, rate) for rate in (RATE, 2 * RATE, 4 * RATE)]
    assert 5.5 < result[0] - result[1] < 7.0
    assert 5.5 < result[1] - result[2] < 7.0


# --- bodies ---


def test_string_t60_falls_with_squared_frequency():
    network = _core.Network()
    network.part("body")
    network.string("s", masses=60, M=8e-3, f=110.0, t60=6.0)
    modes = network.modes("body", 8)
    for n, (f, t60) in enumerate(modes, start=1):
        assert modes[0][1] / t60 == pytest.approx((f / modes[0][0]) ** 2, rel=1e-3)
        assert modes[0][1] / t60 == pytest.approx(n**2, rel=0.02)  # as docs/language.md says it


@pytest.mark.parametrize(("masses", "method"), [(100, "dense"), (300, "lanczos")])
@pytest.mark.parametrize("factor", [0.999, 1.001])
def test_certificate_decided_by_eigenvalue(masses: int, method: str, factor: float):
    """A chain whose ends are light: sums overestimate, so the eigenvalue itself decides."""
    M = np.full(masses, 2e-3)
    M[[0, -1]] = 1e-3
    lap = np.diag(np.r_[1.0, np.full(masses - 2, 2.0), 1.0])
    lap -= np.diag(np.ones(masses - 1), 1) + np.diag(np.ones(masses - 1), -1)
    lap[0, 0] += 1.5
    root = 1.0 / np.sqrt(M)
    top = np.linalg.eigvalsh(root[:, None] * lap * root)[-1]
    k = factor * 4.0 / top * RATE**2
    network = _core.Network()
    network.part("p")
    mats = [network.mas(f"m{i}", M=m) for i, m in enumerate(M)]
    for i in range(masses - 1):
        network.ref(f"l{i}", mats[i], mats[i + 1], K=k)
    network.ref("wall", mats[0], network.sol("w"), K=1.5 * k)
    if factor > 1.0:
        with pytest.raises(_core.UnstableError) as raised:
            network.certify(RATE)
        # the one that moves most in that mode
        assert raised.value.module == "p.m0"
    else:
        result = network.certify(RATE)
        assert (result.method, result.guarantee) == (method, "proved")
        assert result.lambda_max == pytest.approx(4.0 * factor, rel=1e-6)


def test_certificate_by_sums_without_eigenvalue():
    network = _core.Network()
    network.part("p")
    network.string("s", masses=60, M=8e-3, f=110.0)
    assert network.certify(RATE).method == "gershgorin"


# --- takes and silence ---


@pytest.mark.parametrize("file", TAKES, ids=lambda f: f.stem)
def test_quintic_take_spectrum_below_cubic(file: Path):
    """Share of the acceleration above 100 Hz, of a hand filmed at 30 Hz: -70 dB and -33 dB."""
    t, x = np.loadtxt(file, delimiter=",", skiprows=1).T
    take = _core.Take(np.ascontiguousarray(t), np.ascontiguousarray(x))
    grid = np.arange(0.0, t[-1] - t[0], 1.0 / 2000.0)

    def above(acceleration: np.ndarray) -> float:
        power = np.abs(np.fft.rfft(acceleration * np.hanning(len(grid)))) ** 2
        high = np.fft.rfftfreq(len(grid), 1.0 / 2000.0) > 100.0
        return float(10.0 * np.log10(power[high].sum() / power.sum()))

    assert above(np.array([take.evaluate(float(s))[2] for s in grid])) < -69.0
    assert above(make_interp_spline(t, x, k=3, bc_type="natural")(grid + t[0], 2)) > -38.0


def test_cell_decay_without_denormal_numbers():
    """They are slow, and each processor has its own way with them."""
    out = ringing(RATE, M=1e-3, f=440.0, t60=2e-4)
    tiny = np.finfo(np.float64).tiny
    assert np.abs(out[-500:]).max() < 1e-300
    assert not ((np.abs(out) > 0.0) & (np.abs(out) < tiny)).any()


# --- the ledger, step by step ---


def test_linear_network_energy_balance_each_step():
    """|ΔH + Q - W| at every step within 1e-14 of the largest H: 2000 steps, struck and damped."""
    scene = Scene()
    scene.part("p")
    mats = [scene.mas(f"m{i}", M=2e-3) for i in range(30)]
    for i in range(29):
        scene.ref(f"l{i}", mats[i], mats[i + 1], K=3e4, Z=0.02)
    scene.ref("wall", mats[0], scene.sol("w"), K=3e4)
    scene.listen("o", positions=[(mats[7], 1.0)])
    for i in range(40):
        scene.strike(mats[(7 * i) % 30], (10 + 40 * i + 0.3) / RATE, impulse=1e-3 * (-1) ** i)
    sim = simulation(scene, RATE, ledger=True)
    first, before, largest, worst = np.zeros((1, 1)), None, 0.0, 0.0
    for _ in range(2000):
        sim.process(first)
        e = sim.energy()
        now = np.array([e.stored, e.lost, e.injected])
        if before is not None:
            step = now - before
            worst = max(worst, abs(step[0] + step[1] - step[2]))
        before, largest = now, max(largest, e.stored)
    assert before is not None
    assert before[1] > 0.1 * before[2] > 0.0
    # sums of what has flowed carry their own last bit
    assert worst < 1e-14 * largest + 4e-16 * before[2]
