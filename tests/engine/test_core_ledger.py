"""The energy ledger: that it closes, and that what it says is the energy there is."""

import math
from typing import Any

import numpy as np
import pytest
from oracle import bodies, laws, linear, ode
from oracle.core import play, simulation
from oracle.scene import Scene
from sweep import few

from ergon import _core

RATE = 44100.0


def balance(e: Any) -> float:
    """What the ledger does not explain, by its own terms, over all that flowed."""
    return abs(e.start + e.injected - e.stored - e.lost + e.produced) / e.flow


def driven(*, non_linear: bool = False) -> Scene:
    """A key, a bell on it, a string of 16 and a load: strikes and gestures for a minute."""
    scene = Scene()
    scene.part("k")
    hand = scene.cel("m", M=0.4, K=60.0, Z=1.2)
    scene.part("bell")
    bell = scene.cel("m", M=2e-3, f=220.0, t60=2.5)
    scene.part("body")
    mats = bodies.string(scene, "s", masses=16, M=8e-3, f=110.0, t60=3.0, stiffness=0.02)
    load = scene.mas("load", M=5e-3, V0=0.1)
    scene.ref("l", mats[8], load, K=300.0, Z=0.01)
    scene.part("links")
    scene.ref("kb", hand, bell, K=50.0, Z=0.02)
    if non_linear:
        scene.but("hit", hand, mats[4], K=5e3, Z=0.1, gap=1e-3)
        scene.but("soft", hand, bell, K=1e6, exponent=1.5, gap=2e-3)
        scene.lnl("hard", mats[12], load, laws.make("cubic", k=200.0, q=1e8, z=0.01))
    scene.listen("o", positions=[(bell, 1.0)])
    key = scene.key("k", hand)
    for i in range(59):
        scene.gesture(key, [i, i + 0.2, i + 0.5], [0.0, 4e-3, 0.0], ["smooth"] * 3)
        scene.strike(mats[i % 16], i + 0.3137, impulse=1e-4)
        scene.strike(load, i + 0.71, impulse=2e-4)
    return scene


@pytest.mark.parametrize("non_linear", few([False, True], [False]))
def test_ledger_closes_over_one_minute(non_linear: bool):
    sim = simulation(driven(non_linear=non_linear), RATE, ledger=True)
    for _ in range(60):
        play(sim, int(RATE))
    e = sim.energy()
    assert e.flow > 0.0
    assert e.lost > 0.1 * e.flow / 4.0
    assert abs(e.residual) < 1e-12 * e.flow
    assert balance(e) < 1e-12
    # a linear scheme makes no energy of its own; contacts at work must show theirs
    assert (abs(e.produced) > 1e-12 * e.flow) == non_linear


def test_ledger_energy_refused_unless_requested():
    with pytest.raises(_core.EngineError):
        simulation(driven(), RATE).energy()


def test_ledger_leaves_sound_unchanged():
    plain, watched = (play(simulation(driven(), RATE, ledger=v), 20_000) for v in (False, True))
    assert plain.tobytes() == watched.tobytes()


def test_ledger_stored_energy_equals_leapfrog_energy():
    """½ δᵀ(M - Z/2)δ/T² + ½ x[n]ᵀK x[n-1], with matrices built here (κ, ζ for the cells)."""
    scene = driven()
    sim = simulation(scene, RATE, ledger=True)
    play(sim, 30_000)
    T = 1.0 / RATE
    free = linear.moving(scene)
    M, K, Z = (m[np.ix_(free, free)] for m in linear.matrices(scene))
    for i, mat in enumerate(free):
        point = scene.mats[mat]
        if point.cel:
            kappa, zeta, _ = linear.discrete(point, T)
            K[i, i] += kappa * point.M / T**2 - point.K
            Z[i, i] += zeta * point.M / T - point.Z
    order = [scene.core_index[mat] for mat in free]
    now, step = sim.positions()[order], sim.velocities()[order] * T
    assert now.shape == (19,)
    stored = 0.5 * step @ (M / T**2 - 0.5 * Z / T) @ step + 0.5 * now @ K @ (now - step)
    assert sim.energy().stored == pytest.approx(stored, rel=1e-9)


def test_ledger_of_strike_on_free_mass():
    """p²/2m, and after long damping everything given is lost."""
    scene = Scene()
    scene.part("p")
    a, b = scene.mas("a", M=2e-3), scene.cel("b", M=2e-3, f=300.0, t60=0.1)
    scene.ref("z", a, b, Z=0.5)
    scene.listen("o", positions=[(a, 1.0)])
    scene.strike(a, 100 / RATE, impulse=3e-3)
    sim = simulation(scene, RATE, ledger=True)
    play(sim, 102)
    e = sim.energy()
    # the whole impulse in one step; the centred velocity differs from p/m by the damper's pull
    assert e.injected == pytest.approx((3e-3) ** 2 / (2 * 2e-3), rel=1e-2)
    play(sim, 2 * int(RATE))
    e = sim.energy()
    assert e.stored < 1e-9 * e.injected
    assert e.lost == pytest.approx(e.injected, rel=1e-9)


# --- ergons that meet a mass: work is loss ---


@pytest.mark.parametrize("mass", [8e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("speed", [-3000.0, 5.0, 1000.0])
def test_ergon_momentum_and_energy_on_mass(mass: float, speed: float):
    """T7: a MAS of 80 g at 0.1 m/s; elastic, so momentum and energy are both kept."""
    M, V = 0.08, 0.1
    scene = Scene()
    scene.part("p")
    mat = scene.mas("m", M=M, V0=V)
    scene.listen("o", positions=[(mat, 1.0)])
    scene.key("p", mat)  # a key takes an event whole, in one step
    scene.strike(mat, 200 / RATE, mass=mass, speed=speed)
    sim = simulation(scene, RATE, ledger=True, record=True)
    play(sim, 400)
    after = float(sim.velocities()[0])
    impulse = 2.0 * mass * M / (mass + M) * (speed - V)
    assert M * (after - V) == pytest.approx(impulse, rel=1e-9)
    left = speed - impulse / mass
    loss = 0.5 * mass * (speed - left) * (speed + left)
    assert sim.energy().injected == pytest.approx(loss, rel=1e-9)
    record = sim.ergons()
    assert record["impulse"] == pytest.approx([impulse], rel=1e-9)
    assert record["mass"] == pytest.approx([mass])
    assert record["speed"] == pytest.approx([speed])
    assert record["time"] == pytest.approx([200 / RATE], abs=1e-12)


def test_ergon_on_mass_published_speed():
    scene = Scene()
    scene.part("p")
    mat = scene.mas("m", M=0.08, V0=0.1)
    scene.listen("o", positions=[(mat, 1.0)])
    scene.key("p", mat)
    scene.strike(mat, 0.001, mass=8e-6, speed=3000.0)
    sim = simulation(scene, RATE)
    play(sim, 400)
    assert sim.velocities()[0] - 0.1 == pytest.approx(0.599920007999, rel=1e-10)


# --- laws and their potentials ---

LAWS = {
    "cubic": ("k*d + q*d**3", {"k": 800.0, "q": 3e8}),
    "rope": ("where(d > 0, k*d, 0)", {"k": 800.0}),
    "power": ("k*sign(d)*abs(d)**1.7", {"k": 800.0}),
    "detent": ("F*d/w*exp(0.5 - 0.5*(d/w)**2)", {"F": 2.0, "w": 2e-3}),
    "clipped": ("max(-F, min(F, k*d + q*d**3))", {"k": 800.0, "q": 3e8, "F": 3.0}),
    "saturating": ("F*tanh(k*d/F) + 0.2*sqrt(1 + (d/1e-3)**2) - 0.2", {"F": 2.0, "k": 500.0}),
}


@pytest.mark.parametrize("name", LAWS)
def test_law_potential_slope_equals_force(name: str):
    expression, constants = LAWS[name]
    law = _core.Law(expression, None, constants)
    assert law.potential(0.0) == 0.0
    h, size = 1e-6, abs(law.force(5e-3))
    for d in np.linspace(-5e-3, 5e-3, 211):
        slope = (law.potential(d + h) - law.potential(d - h)) / (2.0 * h)
        corner = max(abs(law.force(d + h) - law.force(d)), abs(law.force(d) - law.force(d - h)))
        assert slope == pytest.approx(law.force(d), abs=1e-6 * size + corner * 1.01), d


def test_point_law_potential_slope_equals_force():
    law = _core.Law(points=[(-2e-3, -1.0), (0.0, 0.0), (1e-3, 2.0), (3e-3, 2.5)])
    for d, force in ((-4e-3, -2.0), (-1e-3, -0.5), (5e-4, 1.0), (2e-3, 2.25), (5e-3, 3.0)):
        assert law.force(d) == pytest.approx(force, rel=1e-12)
        slope = (law.potential(d + 1e-6) - law.potential(d - 1e-6)) / 2e-6
        assert slope == pytest.approx(force, rel=1e-8)
    assert law.potential(1e-3) == pytest.approx(1e-3, rel=1e-12)


def bouncing() -> Scene:
    """A cubic spring with losses between two cells, and a felt contact."""
    scene = Scene()
    scene.part("p")
    a = scene.cel("a", M=2e-3, f=220.0, X0=1e-3)
    b = scene.cel("b", M=3e-3, f=310.0, V0=-1.0)
    scene.lnl("n", a, b, laws.make("cubic", k=500.0, q=1e9, z=0.02))
    scene.but("c", a, b, K=5e6, exponent=1.5, gap=5e-4)
    scene.listen("o", positions=[(a, 1.0)])
    return scene


def test_ledger_energy_curve_against_dop853():
    """H + V̄ against DOP853 at the half step before, while the losses take a good part of it."""
    errors = []
    for rate in (2 * RATE, 4 * RATE):
        scene = bouncing()
        sim = simulation(scene, rate, ledger=True)
        when, result = [0.0], []
        for _ in range(40):
            play(sim, int(rate / 2000))
            when.append((sim.frame - 0.5) / rate)
            result.append(sim.energy().stored)
        x, v = ode.solve(scene, np.array(when))
        d = x[:, 1] - x[:, 0]
        law = _core.Law("500*d + 1e9*d**3")
        energy = np.array([law.potential(float(e)) for e in d])
        energy += 5e6 * np.maximum(-d - 5e-4, 0.0) ** 2.5 / 2.5
        for i, p in enumerate(scene.mats):
            energy += 0.5 * p.M * v[:, i] ** 2 + 0.5 * p.K * x[:, i] ** 2
        assert energy[-1] < 0.9 * energy[0]
        errors.append(float(np.abs(np.array(result) - energy[1:]).max() / energy[0]))
    assert errors[0] < 5e-3
    assert errors[1] < 0.6 * errors[0]


def test_ledger_production_of_cubic_spring_bounded():
    scene = Scene()
    scene.part("p")
    a = scene.cel("a", M=2e-3, f=220.0, X0=1e-3)
    b = scene.cel("b", M=3e-3, f=310.0, V0=-1.0)
    scene.lnl("n", a, b, laws.make("cubic", k=500.0, q=1e8, z=0.0))
    scene.listen("o", positions=[(a, 1.0)])
    sim = simulation(scene, RATE, ledger=True)
    drift = []
    for _ in range(10):
        play(sim, 10_000)
        e = sim.energy()
        drift.append(abs(e.produced) / e.start)
        assert abs(e.residual) < 1e-12 * e.flow
    assert max(drift) < 1e-2
    assert math.isfinite(sim.energy().stored)
