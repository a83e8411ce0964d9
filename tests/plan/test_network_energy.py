"""Small networks of contacts and laws make no energy, or it is told, by whatever way they are
computed.
"""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from accuracy import reference
from accuracy.equations import read
from energy_kept import WAYS, look, network_of_text
from random_networks import RATE, network
from sweep import crossed, few

SCENES = Path(__file__).parents[1] / "data" / "energy"
NAMES = ("one-mass-50", "two-masses", "energy-gain-d0", "energy-gain-min")
ENERGY_RATIO_MAX = 1.01  # of the energy that was there
# What is computed once a step keeps another energy than that of the motion: the two differ by a
# part of κ/4, where √κ is the highest frequency in radians a step, and do not drift apart
# (docs/numerics.md). Contacts, whose κ is not counted, come to 4 %.
STEPPED = 1.05
PER_KAPPA = 0.25
EXACT = {"modes", "complex modes", "oscillators", "still", "unheard"}
HALF = 0.5  # [s]
LONG = 20.0  # [s]


def text_of(name: str) -> str:
    return (SCENES / f"{name}.yaml").read_text(encoding="utf-8")


def check(seed: int, setting: str, seconds: float) -> None:
    """The network of a seed makes no energy in a setting of WAYS, or that is reported."""
    drawn = network(seed)
    looked = look(drawn.text(seconds), setting, seconds)
    if looked.stated:
        return
    has_laws = any(set(link.written) - {"REF", "BUT"} for link in drawn.links)
    # A render that is asked for an accuracy has what is stepped tried against finer steps.
    is_once = not setting.endswith("dB") and (has_laws or not set(looked.computed) <= EXACT)
    bound = (
        max(STEPPED, ENERGY_RATIO_MAX + PER_KAPPA * drawn.kappa(looked.x))
        if is_once
        else ENERGY_RATIO_MAX
    )
    assert drawn.gain(looked.x) <= bound, (seed, looked.computed, bound)


@pytest.mark.parametrize("name", NAMES)
def test_exact_motion_energy_gain_is_one(name: str) -> None:
    """DOP853's motion, by the same sum of energies."""
    text = text_of(name)
    scene, single = read(text), network_of_text(text)
    x, _ = reference.integrate(scene, round(0.3 * scene.rate), reference.TIGHT)
    moving = [i for _, i in scene.outputs]
    assert single.gain(x[:, moving], scene.rate) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "method"), crossed(NAMES, ["by ear", "-60 dB", "draft", "session"])
)
def test_masses_with_contacts_and_springs_conserve_energy(name: str, method: str) -> None:
    """They made 80 to 321 times their energy while small bodies were stepped between contacts."""
    text = text_of(name)
    looked = look(text, method, 2.0)
    assert looked.stated == ""
    assert "modes" in looked.computed
    assert network_of_text(text).gain(looked.x, read(text).rate) <= ENERGY_RATIO_MAX


@pytest.mark.parametrize(
    ("damping", "method"),
    few(product([0.0, 1e-3], ["draft", "session", "by ear"]), [(0.0, "draft"), (1e-3, "by ear")]),
)
def test_listened_spring_creates_no_unreported_energy(damping: float, method: str) -> None:
    """The force of an undamped spring is a sum of positions. A damped one is stepped beside the
    contact, and what it makes is told, or computed away.
    """
    plain = text_of("one-mass-50")
    text = plain.replace("out: {SOX: m}", "out: {x: {SOX: m}, f: {SOF: {REF: l}}}")
    text = text.replace("{from: s, to: [1]}", "{from: s.x, to: [1]}, {from: s.f, to: [2]}")
    text = text.replace("channels: 1", "channels: 2")
    text = text.replace("K: 50kN/m,", f"K: 50kN/m, Z: {damping},")
    looked = look(text, method, 2.0)
    built = network_of_text(plain).gain(looked.x[:, :1])
    assert built <= ENERGY_RATIO_MAX or "created energy" in looked.stated
    if damping == 0.0:
        assert (looked.stated, built <= ENERGY_RATIO_MAX) == ("", True)
        x, force = looked.x.T
        assert np.abs(force - force[0] / x[0] * x).max() < 1e-9 * np.abs(force).max()


def struck_wall(x0: float, v0: float, link: str) -> str:
    """A gram on a soft spring that meets a stiff link to the ground; its position is heard."""
    mass = f"{{MAS: {{M: 1g, X0: {x0!r}m, V0: {v0!r}m/s}}}}"
    spring = "{REF: {between: [e, m], K: 4kN/m}}"
    modules = f"{{e: {{SOL: {{}}}}, m: {mass}, s: {spring}, w: {link}}}"
    return f"""ergon: 1
rates: {{audio: {RATE:.0f}Hz}}
instruments: {{a: {{modules: {modules}, out: {{x: {{SOX: m}}}}}}}}
mix: {{channels: 1, route: [{{from: a.x, to: [1]}}]}}
render: {{bits: float, tail: 500ms}}
"""


# By bm4 and ieq, a contact with a mass inside the mesh foresees the next frame less exactly: above
# κ = 1,000 the first bounces may give energy, and later ones take all of it.
CASES = [
    (kappa, setting)
    for kappa in (0.5, 2.0, 5.0, 1e3, 1e6)
    for setting in WAYS
    if kappa < 1e3 or setting not in ("bm4", "ieq")
]


@pytest.mark.parametrize(
    ("kappa", "setting"), few(CASES, [case for case in CASES if case[0] in (2.0, 1e6)])
)
def test_energy_of_start_inside_exact_contact(kappa: float, setting: str) -> None:
    """The step before frame 0 was made by the whole force at frame 0: × 17 of the energy."""
    k = kappa * 1e-3 * RATE**2
    wall = f"{{BUT: {{between: [e, m], K: {k!r}, gap: 0m, side: below, contact: exact}}}}"
    for x0, v0 in ((-1e-3, 0.0), (-1e-3, 2.0), (2e-4, -30.0)):
        looked = look(struck_wall(x0, v0, wall), setting, 0.5)
        start_energy = 0.5e-3 * v0**2 + 0.5 * 4e3 * x0**2 + 0.5 * k * min(x0, 0.0) ** 2
        outside = looked.x[np.abs(looked.x[:, 0]).argmax()]
        assert looked.stated == ""
        assert 0.5 * 4e3 * float(outside[0]) ** 2 <= ENERGY_RATIO_MAX * start_energy


def test_bm4_energy_report_for_stiff_rope() -> None:
    """A rope that goes taut at 31 kHz gave × 2e5 of its energy, and no account was kept of it: it
    has no energy in closed form.
    """
    rope = f"{{LNL: {{between: [e, m], law: rope, k: {20e-3 * RATE**2!r}, rest: -1mm}}}}"
    looked = look(struck_wall(-1e-3, 0.0, rope), "bm4", 0.5)
    assert "created energy" in looked.stated


# First seeds whose networks are planned quickly; each setting is among them.
QUICK = [0, 5, 10, 25, 35, 45, 55, 60, 65, 75, 85, 90]


def setting_of(seed: int) -> str:
    """One of WAYS for a seed: those without trials, and now and then those with."""
    if seed % 10 == 0:
        return ("by ear", "-60 dB")[seed // 10 % 2]
    return ("draft", "session", "ca")[seed % 3]


@pytest.mark.parametrize("first", few(range(0, 100, 5), QUICK))
def test_random_networks_create_no_energy(first: int) -> None:
    for seed in range(first, first + 5):
        check(seed, setting_of(seed), HALF)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 2_000, 10))
def test_random_networks_create_no_energy_long(first: int) -> None:
    settings = list(WAYS)
    for seed in range(first, first + 10):
        check(seed, settings[seed % len(settings)], LONG)
