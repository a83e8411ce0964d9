"""BUT: plain against the oracle, magic by its restitution, exact by its energy."""

import math

import numpy as np
import pytest
from oracle.core import deviation, play, simulation
from oracle.scene import Scene
from sweep import few

from ergon import _core

RATE = 44100.0


def hammer(**but: float | str | bool) -> Scene:
    """A hammer flies at a bell and a third mass hangs on the bell."""
    scene = Scene()
    scene.part("p")
    sign = -1.0 if but.get("side", "below") == "below" else 1.0
    bell = scene.cel("bell", M=2e-3, f=220.0, t60=1.0)
    hand = scene.mas("hand", M=8e-3, X0=sign * 2.03e-3, V0=-sign * 1.5)
    load = scene.cel("load", M=1e-3, K=500.0, Z=0.02)
    scene.ref("r", bell, load, K=800.0, Z=0.01)
    contact = scene.but("b", hand, bell, **but)
    for mat in (bell, hand, load):
        scene.listen("o", positions=[(mat, 1.0)])
    scene.listen("f", forces=[(contact, 1.0)])
    return scene


@pytest.mark.parametrize("side", few(["below", "above"], ["above"]))
@pytest.mark.parametrize(
    "options",
    few(
        [
            {"K": 2e4},
            {"K": 2e4, "gap": 1e-3, "Z": 3.0},
            {"K": 2e4, "gap": -5e-4, "Z": 30.0, "clamp": True},
            {"K": 4e6, "exponent": 1.5, "gap": 3e-4},
            {"K": 1e9, "exponent": 2.5, "Z": 1.0, "clamp": True},
        ],
        2,
    ),
    ids=["bare", "gap", "clamp", "hertz", "felt"],
)
def test_plain_contact_agrees_with_the_oracle(side: str, options: dict[str, float]):
    assert deviation(hammer(side=side, **options), RATE, 4410) < 1e-12


@pytest.mark.parametrize("side", ["below", "above"])
@pytest.mark.parametrize("options", [{"K": 2e4}, {"K": 1e9}, {"K": 4e6, "exponent": 1.5}])
def test_exact_contact_agrees_with_the_oracle(side: str, options: dict[str, float]):
    assert deviation(hammer(side=side, contact="exact", **options), RATE, 4410) < 1e-11


def test_plain_contact_in_ca_units_agrees_with_oracle():
    scene = Scene()
    scene.part("p", ca_rate=RATE)
    a = scene.mas("a", M=1.0, X0=-2e-3, V0=20.0)
    b = scene.cel("b", M=3.0, K=0.01, Z=1e-3)
    contact = scene.but("c", a, b, K=0.2, Z=0.05, gap=1e-4)
    scene.listen("a", positions=[(a, 1.0)])
    scene.listen("b", positions=[(b, 1.0)])
    scene.listen("f", forces=[(contact, 1.0)])
    assert deviation(scene, RATE, 4410) < 1e-12


def test_clamped_contact_never_pulls():
    pulls = {}
    for clamp in (True, False):
        sim = simulation(hammer(K=2e4, Z=30.0, clamp=clamp), RATE)
        pulls[clamp] = play(sim, 4410)[:, 3].min()
    assert pulls[True] >= 0.0
    assert pulls[False] < -1.0  # the rule of the field: Z may pull at the exit


# --- magic ---


@pytest.mark.parametrize(("restitution", "steps"), [(1.0, 2), (1.0, 3), (0.5, 2), (0.9, 8)])
def test_magic_contact_returns_its_restitution_at_every_phase(restitution: float, steps: int):
    """T4: speeds after over speeds before, 2000 phases of the first touch within a sample."""
    worst = 0.0
    for phase in np.linspace(0.0, 1.0, 2000, endpoint=False):
        network = _core.Network()
        network.part("p")
        a = network.mas("a", M=1e-3, X0=-(2.0 + phase) / RATE, V0=1.0)
        b = network.mas("b", M=4e-3)
        network.but("c", a, b, K=1.0, contact="magic", restitution=restitution, steps=steps)
        network.listen("o", positions=[(a, 1, 1.0)])
        sim = _core.Simulation(network, _core.Timeline(network, RATE))
        play(sim, steps + 6)
        va, vb = sim.velocities()
        worst = max(worst, abs((vb - va) - restitution))
        assert 1e-3 * va + 4e-3 * vb == pytest.approx(1e-3, rel=1e-12)  # momentum
    assert worst < 1e-13


@pytest.mark.parametrize(
    ("restitution", "steps", "kappa", "zeta"),
    [
        (1.0, 2, 2.0, 0.0),
        (1.0, 3, 1.0, 0.0),
        (0.5, 2, 1.5, 0.5),
        (0.9, 8, 0.15042024111289853, 0.025996253574703365),
    ],
)
def test_magic_contact_has_the_published_stiffness(restitution, steps, kappa, zeta):
    """From the first force: (κ_μ·p + ζ_μ·(p - p⁻))·μ on a fixed wall, where μ is the mass."""
    network = _core.Network()
    network.part("p")
    a = network.mas("a", M=2e-3, X0=1e-6, V0=0.1)
    wall = network.sol("w")
    link = network.but("c", a, wall, K=1.0, contact="magic", restitution=restitution, steps=steps)
    network.listen("x", positions=[(a, 1, 1.0)])
    network.listen("f", forces=[(link, 1, 1.0)])
    out = play(_core.Simulation(network, _core.Timeline(network, RATE)), 2)
    # frame 1 is in contact as well, and its p - p⁻ is known from the outputs
    force = 2e-3 * RATE**2 * (kappa * out[1, 0] + zeta * (out[1, 0] - out[0, 0]))
    assert out[1, 1] == pytest.approx(force, rel=1e-9)


def magic_on(mat: str, parameters: dict[str, float], **but: float | bool) -> None:
    """Build all that there is to build of a magic contact on such a MAT."""
    network = _core.Network()
    network.part("p")
    a, b = network.mas("a", M=1e-3), getattr(network, mat)("b", M=1e-3, **parameters)
    network.but("c", a, b, K=1.0, contact="magic", **but)
    network.listen("o", positions=[(a, 1, 1.0)])
    _core.Simulation(network, _core.Timeline(network, RATE))


def test_magic_refuses_to_clamp_a_lossy_contact():
    magic_on("mas", {}, clamp=True)
    with pytest.raises(_core.EngineError):
        magic_on("mas", {}, restitution=0.5, clamp=True)


def test_magic_refuses_grounded_mass():
    with pytest.raises(_core.EngineError):
        magic_on("cel", {"f": 200.0, "t60": 1.0})


# --- exact ---


@pytest.mark.parametrize("stiffness", [1e4, 1e8, 1e12])
def test_exact_contact_conserves_energy(stiffness: float):
    """T5: two undamped cells that collide for 2e5 steps; energy from positions and last steps."""
    T, m, f = 1.0 / RATE, np.array([1e-3, 2e-3]), np.array([30.0, 47.0])
    ground = m / T**2 * (2.0 * np.sin(math.pi * f * T)) ** 2  # κM of a pole-exact cell
    network = _core.Network()
    network.part("p")
    a = network.cel("a", M=m[0], f=f[0], X0=-1e-3, V0=1.0)
    b = network.cel("b", M=m[1], f=f[1], X0=2e-4)
    link = network.but("c", a, b, K=stiffness, contact="exact")
    network.listen("f", forces=[(link, 1, 1.0)])
    sim = _core.Simulation(network, _core.Timeline(network, RATE))

    def energy() -> float:
        x, step = sim.positions(), sim.velocities() * T
        old = x - step
        bent = [max(y[0] - y[1], 0.0) for y in (x, old)]
        moving = 0.5 * m @ (step / T) ** 2 + 0.5 * ground @ (x * old)
        return float(moving + 0.25 * stiffness * (bent[0] ** 2 + bent[1] ** 2))

    play(sim, 1)
    start, worst, touches = energy(), 0.0, 0
    for _ in range(20):
        touches += int((np.diff((play(sim, 10_000)[:, 0] > 0.0).astype(int)) == 1).sum())
        worst = max(worst, abs(energy() / start - 1.0))
    assert touches > 100
    assert worst < 1e-10


def test_contacts_sharing_a_mass_conserve_energy():
    """A light ball thrown between two heavy ones, both contacts stiff and closed at once."""
    network = _core.Network()
    network.part("p")
    left = network.mas("left", M=0.1)
    ball = network.mas("ball", M=1e-3, X0=1e-4, V0=1.0)
    right = network.mas("right", M=0.1, X0=2e-4)
    network.but("a", left, ball, K=1e6, contact="exact", gap=-3e-4)
    network.but("b", ball, right, K=1e8, contact="exact", exponent=1.5, gap=-3e-4)
    sim = _core.Simulation(network, _core.Timeline(network, 44100.0), ledger=True)
    worst = 0.0
    for _ in range(50):
        sim.process(np.zeros((20, 0)))
        energy = sim.energy()
        worst = max(worst, abs(energy.stored - energy.start) / energy.start)
    assert worst < 1e-11
    assert abs(energy.produced) < 1e-11 * energy.start
