"""LNL in a network: the law as text in the core against the law as arithmetic in the oracle."""

import numpy as np
import pytest
from oracle import laws
from oracle.core import deviation
from oracle.scene import Scene

from ergon import _core

RATE = 44100.0
CONSTANTS = {
    "cubic": {"k": 300.0, "q": 5e8, "z": 0.02},
    "rope": {"k": 2e3, "z": 0.1},
    "bow": {"F": 0.3, "a": 100.0, "u": 0.2},
    "coulomb": {"k": 400.0, "F": 0.05, "s": 0.1},
}


def between(law: laws.Law, *, ca: bool = False, rest: float = 0.0) -> Scene:
    """A law between a bell and a swinging mass on a spring."""
    unit = RATE**2 if ca else 1.0
    scene = Scene()
    scene.part("p", ca_rate=RATE if ca else None)
    a = scene.cel("a", M=2e-3 * unit, K=4e3, Z=0.01 * (RATE if ca else 1.0), X0=1e-3)
    b = scene.mas("b", M=3e-3 * unit, X0=-1e-3, V0=0.3)
    wall = scene.sol("w")
    scene.ref("r", b, wall, K=900.0)
    link = scene.lnl("l", a, b, law, rest=rest)
    scene.listen("a", positions=[(a, 1.0)])
    scene.listen("b", positions=[(b, 1.0)])
    scene.listen("f", forces=[(link, 1.0)])
    return scene


@pytest.mark.parametrize("name", CONSTANTS)
@pytest.mark.parametrize("rest", [0.0, -4e-4])
def test_network_with_law_agrees_with_oracle(name: str, rest: float):
    law = laws.make(name, **CONSTANTS[name])
    assert deviation(between(law, rest=rest), RATE, 4410) < 1e-11


def test_law_rate_per_sample_in_ca_units():
    for name, constants in (
        ("cubic", {"k": 300.0, "q": 5e8, "z": 500.0}),
        ("coulomb", {"k": 400.0, "F": 0.05, "s": 2e-6}),
    ):
        assert deviation(between(laws.make(name, **constants), ca=True), RATE, 4410) < 1e-11


@pytest.mark.parametrize("name", CONSTANTS)
def test_law_force_equals_formula(name: str):
    law = laws.make(name, **CONSTANTS[name])
    in_core, values = law.on(_core), np.array(law.values())
    for d in np.linspace(-3e-3, 3e-3, 31):
        for v in np.linspace(-1.0, 1.0, 11):
            wanted = laws.law(law.number, values, d, v)
            assert in_core.force(d, v) == pytest.approx(wanted, rel=1e-13, abs=1e-15)


def test_lever_scales_law_preserving_power():
    law = _core.Law("k*d + q*d**3", "z*v", {"k": 300.0, "q": 5e8, "z": 0.02})
    seen = _core.Law("k*d + q*d**3", "z*v", {"k": 300.0, "q": 5e8, "z": 0.02}, reach=2.5)
    for d, v in ((1e-3, 0.0), (-2e-3, 0.4), (0.0, -1.0)):
        assert seen.force(d, v) == pytest.approx(law.force(d / 2.5, v / 2.5) / 2.5, rel=1e-13)
        assert seen.potential(d) == pytest.approx(law.potential(d / 2.5), rel=1e-12, abs=1e-18)


def test_law_is_active_only_with_energy_gain():
    assert laws.make("bow", **CONSTANTS["bow"]).on(_core).is_active(1e-3, 1.0)
    for name in ("cubic", "rope", "coulomb"):
        assert not laws.make(name, **CONSTANTS[name]).on(_core).is_active(1e-3, 1.0)
