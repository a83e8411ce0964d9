"""The oracle itself, against matrix exponentials, DOP853, closed forms and published vectors."""

import math

import numpy as np
import pytest
from oracle import kernel, laws, linear, ode
from oracle.engine import discrete, simulate
from oracle.gesture import path
from oracle.scene import Point, Scene

RATE = 44100.0


def level(y: np.ndarray, x: np.ndarray) -> float:
    """Error of y against x [dB]."""
    return float(20.0 * np.log10(np.linalg.norm(y - x) / np.linalg.norm(x)))


def network(z: float = 0.0, t60: float | None = None) -> Scene:
    """A tuned CEL at rest, a MAS out of place, a stiff CEL with a rest of its own."""
    scene = Scene()
    scene.part("net")
    a = scene.cel("a", M=2e-3, f=440.0, t60=t60)
    b = scene.mas("b", M=3e-3, X0=1e-3)
    c = scene.cel("c", M=1e-2, K=3e3, rest=1e-3)
    scene.ref("ab", a, b, K=2e3, Z=z)
    scene.ref("bc", b, c, K=4e3, Z=z, rest=5e-4)
    for mat in (a, b, c):
        scene.listen("o", positions=[(mat, 1.0)])
    return scene


def errors(scene: Scene, seconds: float, **options: bool) -> list[float]:
    """Error at three rates, each twice the last [dB]."""
    out = []
    for rate in (RATE, 2 * RATE, 4 * RATE):
        n = int(rate * seconds)
        out.append(level(simulate(scene, rate, n, **options).out, linear.exact(scene, rate, n)))
    return out


def test_oracle_converges_with_order_two_undamped():
    first, second, third = errors(network(), 0.1)
    assert first < -45.0
    assert 11.5 < first - second < 12.5
    assert 11.5 < second - third < 12.5


def test_oracle_link_damping_lowers_order_to_one():
    """M' = M - Z/2: the scheme's own mass differs from the physical one by zT/2."""
    first, second, third = errors(network(z=0.05, t60=1.0), 0.1)
    assert first - second > 5.5
    assert second - third > 5.5


def test_oracle_linked_cell_start_with_half_step():
    """Without ½T²·(link forces)/m in the first step the error falls by 6 dB a halving, not 12."""
    with_links, bare = errors(network(), 0.1), errors(network(), 0.1, link_start=False)
    assert bare[0] - with_links[0] > 6.0
    assert bare[2] - with_links[2] > 17.0
    assert bare[1] - bare[2] < 8.0
    assert with_links[1] - with_links[2] > 11.5


@pytest.mark.parametrize(("f", "t60"), [(8.0, 0.6), (440.0, 1.0), (5000.0, 0.3), (15000.0, 0.1)])
def test_oracle_single_cell_exact(f: float, t60: float):
    scene = Scene()
    scene.part("p")
    mat = scene.cel("m", M=1e-3, f=f, t60=t60, X0=1e-3, V0=0.3, rest=2e-4)
    scene.listen("o", positions=[(mat, 1.0)])
    out = simulate(scene, RATE, 4410).out
    assert np.abs(out - linear.exact(scene, RATE, 4410)).max() < 1e-10 * np.abs(out).max()


@pytest.mark.parametrize(
    ("f", "t60", "rate", "kappa", "zeta"),
    [
        (440.0, 1.0, 44100.0, 0.0039280803356573019, 0.0003132278173216037),
        (440.0, 1.0, 4410.0, 0.37969998129050642, 0.0031278668340015692),
        (8.0, 0.6, 4410.0, 0.00013637352226331226, 0.0052076741929679964),
        (5000.0, 0.3, 44100.0, 0.48612872165831794, 0.0010437112321537868),
    ],
)
def test_oracle_coefficients_of_tuned_cell(
    f: float, t60: float, rate: float, kappa: float, zeta: float
):
    k, z, _ = discrete(Point(M=1.0, cel=True, tuned=(f, t60)), 1.0 / rate)
    assert k == pytest.approx(kappa, rel=1e-13)
    assert z == pytest.approx(zeta, rel=1e-13)


def test_oracle_overdamped_cell_poles():
    k, z, _ = discrete(Point(M=0.1, K=10.0, Z=5.0, cel=True), 1.0 / RATE)
    slow = np.roots([1.0, -(2.0 - k - z), 1.0 - z])
    true = np.exp(np.roots([0.1, 5.0, 10.0]) / RATE)
    assert np.sort(slow) == pytest.approx(np.sort(true), rel=1e-9)


def pair(link: str, **kw: float) -> Scene:
    scene = Scene()
    scene.part("p")
    a = scene.cel("a", M=2e-3, f=440.0, X0=1e-3)
    b = scene.mas("b", M=3e-3, V0=-1.0, X0=1.2e-3)
    if link == "but":
        scene.but("l", b, a, K=3e4, exponent=1.5, Z=kw["Z"], side="above", gap=1e-4)
    else:
        scene.lnl("l", a, b, laws.make(link, **kw))
    for mat in (a, b):
        scene.listen("o", positions=[(mat, 1.0)])
    return scene


@pytest.mark.parametrize(
    ("link", "constants", "order"),
    [
        ("cubic", {"k": 100.0, "q": 1e9, "z": 0.0}, 11.0),
        ("bow", {"F": 1.0, "a": 100.0, "u": 0.2}, 5.5),
        ("coulomb", {"k": 500.0, "F": 0.05, "s": 0.1}, 5.5),
        ("but", {"Z": 0.0}, 5.5),
        ("but", {"Z": 0.3}, 5.5),
    ],
)
def test_oracle_nonlinear_links_converge_to_dop853(link, constants, order):
    scene = pair(link, **constants)
    result = []
    for rate in (2 * RATE, 4 * RATE, 8 * RATE):
        n = int(rate * 0.01)
        truth = ode.solve(scene, np.arange(n) / rate)[0]
        result.append(level(simulate(scene, rate, n).out, truth))
    assert result[0] < -35.0
    assert result[0] - result[2] > 2.0 * order


def test_oracle_strike_between_samples_split():
    scene = Scene()
    scene.part("p")
    mat = scene.cel("m", M=1.0, f=440.0, t60=1.0)
    scene.listen("o", positions=[(mat, 1.0)])
    scene.strike(mat, 10.3 / RATE, impulse=1.0)
    out = simulate(scene, RATE, 2000).out[:, 0]
    sigma, omega = 3.0 * math.log(10.0), 2.0 * math.pi * 440.0
    t = np.maximum(np.arange(2000) / RATE - 10.3 / RATE, 0.0)
    assert np.abs(out - np.exp(-sigma * t) * np.sin(omega * t) / omega).max() < 1e-11 / omega
    g = 1.0 / RATE**2
    assert out[11] / g == pytest.approx(30856.7098049, rel=1e-11)
    k, z, _ = discrete(scene.mats[mat], 1.0 / RATE)
    then = (out[12] - (2 - k - z) * out[11]) / g
    assert then == pytest.approx(13225.6978351, rel=1e-9)


def test_oracle_ergon_impulse_on_moving_mass():
    """m = 8 mg at 3000 m/s on 80 g moving at 0.1 m/s: p = 47.99 mN·s."""
    scene = Scene()
    scene.part("p")
    mat = scene.mas("m", M=0.08, V0=0.1)
    scene.listen("o", positions=[(mat, 1.0)])
    scene.strike(mat, 5 / RATE, mass=8e-6, speed=3000.0)
    v = np.diff(simulate(scene, RATE, 20).out[:, 0]) * RATE
    assert v[10] - v[3] == pytest.approx(0.599920007999, rel=1e-11)
    assert 0.08 * (v[10] - v[3]) == pytest.approx(0.0479936006399, rel=1e-11)


def test_oracle_contact_by_bisection_and_closed_form():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        p, w = rng.normal(size=2) * 1e-3
        beta, k = 10 ** rng.uniform(-8, -5), 10 ** rng.uniform(3, 9)
        first, two = kernel.closed_contact(p, w, beta, k), kernel.exact_contact(p, w, beta, k, 1.0)
        assert first == pytest.approx(two, abs=1e-14 * max(abs(p), abs(w)) * (1.0 + beta * k))


@pytest.mark.parametrize("steps", [2, 3, 8])
def test_oracle_magic_contact_restitution(steps: int):
    for phase in np.linspace(0.0, 1.0, 40, endpoint=False):
        scene = Scene()
        scene.part("p")
        a = scene.mas("a", M=1e-3, X0=-1e-3 * phase / RATE * 1e3 - 1e-5, V0=1.0)
        b = scene.mas("b", M=5e-2)
        scene.but("c", a, b, K=0.0, contact="magic", restitution=0.7, steps=steps)
        scene.listen("o", positions=[(a, 1.0), (b, -1.0)])
        v = np.diff(simulate(scene, RATE, 300).out[:, 0]) * RATE
        assert -v[-1] / v[0] == pytest.approx(0.7, rel=1e-12)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_oracle_exact_contact_conserves_energy(exponent: float):
    scene = Scene()
    scene.part("p")
    a = scene.mas("a", M=1e-3, X0=-1e-3, V0=2.0)
    b = scene.mas("b", M=2e-3)
    scene.but("c", a, b, K=1e10, contact="exact", exponent=exponent)
    done = simulate(scene, RATE, 200)
    v = done.d * RATE
    assert v[1] > 1.0
    assert 0.5e-3 * v[0] ** 2 + 1e-3 * v[1] ** 2 == pytest.approx(2e-3, rel=1e-11)


def test_oracle_free_key_follows_path():
    scene = Scene()
    scene.part("k")
    mat = scene.cel("k", M=0.4, K=60.0, Z=1.2)
    scene.listen("o", positions=[(mat, 1.0)])
    key = scene.key("k", mat)
    t, x, curve = [0.0, 0.125, 0.25, 0.5], [0.0, 6e-3, 0.0, 0.0], ["smooth"] * 3 + ["hold"]
    scene.gesture(key, t, x, curve)
    out = simulate(scene, RATE, 22051).out[:, 0]
    asked = path(t, x, curve, np.arange(22051) / RATE)
    assert np.abs(out - asked).max() < 1e-14
    assert np.abs(np.diff(asked, 2)).max() * RATE**2 < 5.0  # rests at its ends: no jump of v


def test_oracle_path_minimises_jerk():
    """Minimum of ∫jerk² by finite differences, discretised independently of any spline."""
    n, knots = 401, [0, 100, 250, 400]
    x = np.array([0.0, 6e-3, -2e-3, 1e-3])
    fixed = sorted({0, 1, 2, n - 3, n - 2, n - 1, *knots})
    value = np.zeros(n)
    value[[n - 3, n - 2, n - 1]] = x[-1]
    value[knots] = x
    free = np.setdiff1d(np.arange(n), fixed)
    D = np.diff(np.eye(n), 3, axis=0)
    value[free] = np.linalg.lstsq(D[:, free], -D[:, fixed] @ value[fixed], rcond=None)[0]
    spline = path([0.0, 0.25, 0.625, 1.0], list(x), ["smooth"] * 4, np.linspace(0.0, 1.0, n))
    assert np.abs(spline - value).max() < 2e-4


def test_oracle_unstable_roots_and_negative_eigenvalues():
    """T2: roots of the step matrix outside the disc against eigenvalues of 4M - K - 2Z."""
    rng = np.random.default_rng(7)
    seen = set()
    for _ in range(300):
        scene = Scene()
        scene.part("p", ca_rate=RATE)
        n = int(rng.integers(2, 12))
        mats = [scene.mas(f"m{i}", M=10 ** rng.uniform(-1, 1)) for i in range(n)]
        ground = scene.sol("s")
        for j in range(2 * n):
            a, b = rng.choice(n + 1, 2, replace=False)
            pick = [*mats, ground]
            scene.ref(f"l{j}", pick[a], pick[b], K=rng.uniform(0, 1.0), Z=rng.uniform(0, 0.3))
        M, K, Z = (m[:n, :n] for m in linear.matrices(scene))
        bound = np.linalg.eigvalsh(4.0 * M - K - 2.0 * Z)
        if np.abs(bound).min() < 1e-3:
            continue
        roots = np.abs(np.linalg.eigvals(linear.step_matrix(scene, RATE)))
        assert int((roots > 1.0 + 1e-6).sum()) == int((bound < 0.0).sum())
        seen.add(int((bound < 0.0).sum()))
    assert len(seen) > 2
