"""Constants of laws, and masses, that follow a MAT."""

from itertools import pairwise

import numpy as np
import pytest
from checked import check_reports
from one_instrument import rendered, score
from planned_sound import off_db, played, ready
from scipy.integrate import solve_ivp

from ergon import _core

PRESS = "finger: {MAS: {M: 1g, X0: 2mm, V0: 0.5m/s}}"  # from 2 mm on, past 12 mm at 20 ms
PAIR = f"""\
{PRESS}
a: {{MAS: {{M: 2g, X0: 1mm}}}}
b: {{CEL: {{M: 3g, K: 900N/m, V0: 0.3m/s}}}}
wall: {{SOL: {{}}}}
tie: {{RES: {{between: [wall, a], K: 500N/m}}}}
"""
LAW = """\
rub: {LNL: {between: [a, b], law: "k*d + 4e6*d**3", damping: "z*v*exp(-(v/2)**2)", follows: {
  k: {of: finger, from: 100N/m, to: 900N/m, offset: 1mm, span: 10mm},
  z: {of: finger, from: 0.3Ns/m, to: 0.05Ns/m, span: 8mm}}}}"""
HEAVY = "a: {MAS: {M: 2g, X0: 1mm, follows: {M: {of: finger, from: 2g, to: 5g, span: 12mm}}}}"


def numbers(t: float) -> tuple[float, float]:
    """k and z of the law."""
    x = 2e-3 + 0.5 * t
    to = lambda low, high, at: low + (high - low) * min(max(at, 0.0), 1.0)  # noqa: E731
    return to(100, 900, (x + 1e-3) / 10e-3), to(0.3, 0.05, x / 8e-3)


def mass(t: float) -> float:
    return 2e-3 + 3e-3 * min((2e-3 + 0.5 * t) / 12e-3, 1.0)


@pytest.mark.parametrize("is_heavy", [False, True])
def test_following_constants_against_dop853(is_heavy: bool):
    modules = PAIR + LAW.replace("\n", " ")
    if is_heavy:
        modules = modules.replace("a: {MAS: {M: 2g, X0: 1mm}}", HEAVY)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        (x, v), (k, z) = (y[:2], y[2:]), numbers(t)
        d, w = x[1] - x[0], v[1] - v[0]
        f = k * d + 4e6 * d**3 + z * w * np.exp(-((w / 2) ** 2))
        single = mass(t) if is_heavy else 2e-3
        return np.array([*v, (-500 * x[0] + f) / single, (-900 * x[1] - f) / 3e-3])

    errors = []
    for hertz in (88_200, 176_400):
        ours = rendered(score(modules, "a: {SOX: a}, b: {SOX: b}", rate=hertz))
        when = np.arange(len(ours)) / hertz
        y, parts = np.array([1e-3, 0, 0, 0.3]), []
        knots = [0.0, 12e-3, 14e-3, 20e-3, when[-1] + 1e-9]  # where ends are reached [s]
        for start, stop in pairwise(knots):
            position = [*when[(when >= start) & (when < stop)], stop]
            done = solve_ivp(rate, (start, stop), y, "DOP853", position, rtol=1e-11, atol=1e-14)
            y = done.y[:, -1]
            parts.append(done.y[:2, :-1])
        exact = np.hstack(parts).T
        errors.append(np.abs(ours - exact).max() / np.abs(exact).max())
    assert errors[1] < 1e-3
    assert errors[0] > 1.6 * errors[1], "of the first order at least, as explicit damping is"


@pytest.mark.parametrize("is_heavy", [False, True])
def test_following_constants_ledger_closes(is_heavy: bool):
    """What a value brings in as it changes is work from outside."""
    modules = PAIR + LAW.replace("\n", " ")
    if is_heavy:
        modules = modules.replace("a: {MAS: {M: 2g, X0: 1mm}}", HEAVY)
    built = ready(score(modules, "a: {SOX: a}"))
    simulation = _core.Simulation(built.network, built.timeline, ledger=True)
    simulation.process(np.empty((1764, simulation.n_out)))
    energy = simulation.energy()
    assert abs(energy.injected) > 1e-5 * energy.start
    assert abs(energy.residual) < 1e-11 * energy.flow


def test_following_spring_stiffness_injects_energy():
    """A spring held at 2 mm goes from 100 N/m to 900 N/m: (900 - 100)/2·(2 mm)² come in."""
    modules = f"""\
{PRESS}
a: {{MAS: {{M: 1000t, X0: 2mm}}}}
wall: {{SOL: {{}}}}
tie: {{LNL: {{between: [wall, a], law: "k*d", follows: {{k: {{of: finger, from: 100N/m, \
to: 900N/m, offset: -2mm, span: 10mm}}}}}}}}"""
    built = ready(score(modules, "a: {SOX: a}").replace("1000t", "1000000kg"))
    simulation = _core.Simulation(built.network, built.timeline, ledger=True)
    simulation.process(np.empty((1764, simulation.n_out)))
    energy = simulation.energy()
    assert energy.injected == pytest.approx(0.5 * 800 * 4e-6, rel=1e-6)


@pytest.mark.parametrize(("share", "refused"), [(0.95, False), (1.05, True)])
@pytest.mark.parametrize("what", ["a law", "a mass"])
def test_following_constants_certificate_at_both_ends(what: str, share: float, refused: bool):
    """λ is K·(1/M + 1/m) where K is greatest and M least, over the square of the rate."""
    greatest = share * 4 * 44_100**2 / (1 / 1e-3 + 1 / 2e-3)
    law = f"from: {greatest}N/m, to: 10N/m"
    stay = "{M: 1g, X0: 1um}"
    if what == "a mass":
        law = f"from: {greatest}N/m, to: {greatest}N/m"
        stay = "{M: 3g, X0: 1um, follows: {M: {of: finger, from: 3g, to: 1g, span: 8mm}}}"
    modules = f"""\
{PRESS}
a: {{MAS: {stay}}}
b: {{MAS: {{M: 2g}}}}
l: {{LNL: {{between: [a, b], law: "k*d", follows: {{k: {{of: finger, {law}, span: 9mm}}}}}}}}"""
    built = ready(score(modules, "a: {SOX: a}"))
    if refused:
        with pytest.raises(_core.EngineError, match=r"4\.200000 and must be below 4"):
            _core.Simulation(built.network, built.timeline)
    else:
        simulation = _core.Simulation(built.network, built.timeline)
        sound = np.empty((44_100, simulation.n_out))
        simulation.process(sound)
        assert np.abs(sound).max() < 1e-4


STRING = "s: {STRING: {masses: 20, M: 6g, f: 110Hz, t60: 3s, X0: {at: 5, x: 1mm}}}"
FOLLOWING_LINK = """\
felt: {LNL: {between: [wall, s.8], law: "k*d", damping: "z*v", z: 10mNs/m, follows: {
  k: {of: finger, from: 0N/m, to: 2kN/m, span: 10mm}}}}"""


def test_following_law_leaves_string_in_modes():
    """A string goes by its modes; the mass where the law ends is a port."""
    modules = f"{PRESS}\nwall: {{SOL: {{}}}}\n{STRING}\n" + FOLLOWING_LINK.replace("\n", " ")
    text = score(modules, "a: {SOX: s.15}, f: {SOF: felt}", "error: -60dB")
    fine, finer = (
        played(text.replace("44100Hz", f"{44_100 * times}Hz"), method="ca")[::times]
        for times in (16, 32)
    )
    exact = (2 * finer - fine)[:, 0]  # of the first order
    built = ready(text)
    plan = _core.Plan(built.network, built.timeline, error_db=-60.0)
    rows = plan.rows()
    assert "modes" in [row.what for row in rows]
    sound = played(text, error_db=-60.0)
    worst = max(row.error_db for row in rows if row.error_db is not None)
    assert off_db(sound[: len(exact), 0], exact) < min(-60.0, worst)


def test_follows_mass_of_string():
    """A string's own point presses the felt of another: both are one island."""
    modules = f"{STRING}\nwall: {{SOL: {{}}}}\na: {{CEL: {{M: 3g, K: 900N/m, X0: 1mm}}}}\n"
    modules += 'l: {LNL: {between: [wall, a], law: "k*d", follows: {k: {of: s.5, '
    modules += "from: 0N/m, to: 300N/m, offset: 1mm, span: 2mm}}}}"
    out = "a: {SOX: a}, s: {SOX: s.5}"
    plain, planned = (rendered(score(modules, out, how)) for how in ("method: ca", "error: -60dB"))
    assert np.abs(plain[:, 0]).max() > 5e-4
    assert off_db(planned[:, 1], plain[:, 1]) < -30.0  # what CA leaves of a string
    free = rendered(score(modules.replace("to: 300N/m", "to: 0N/m"), out))
    assert np.abs(free[:, 0] - plain[:, 0]).max() > 1e-4


def test_following_constants_bytes_for_blocks_and_threads():
    """Blocks, threads and a snapshot change no bit."""
    modules = f"{PRESS}\nwall: {{SOL: {{}}}}\n{STRING}\n" + FOLLOWING_LINK.replace("\n", " ")
    built = ready(score(modules, "a: {SOX: s.15}"))
    complete = _core.Simulation(built.network, built.timeline, threads=1)
    sound = np.empty((1764, complete.n_out))
    complete.process(sound)
    parts = _core.Simulation(built.network, built.timeline, threads=2)
    pieces = [np.empty((n, parts.n_out)) for n in (1, 63, 700, 1000)]
    for piece in pieces:
        parts.process(piece)
    np.testing.assert_array_equal(np.vstack(pieces), sound)


WRONG = {
    "no constant": (LAW.replace("  z:", "  y:"), "no constant 'y'"),
    "twice": (LAW.replace("follows", "k: 3N/m, follows", 1), "it follows a MAT too"),
    "no name": (LAW.replace("k: {of: finger", "k: {of: fingre"), "nothing is called 'fingre'"),
    "no span": (LAW.replace("span: 8mm", "span: 0m"), "would change nothing"),
    "no from": (LAW.replace("from: 100N/m, ", ""), "has no 'from'"),
    "no unit": (LAW.replace("to: 900N/m", "to: 9q"), "to"),
    "no mass": (HEAVY.replace("to: 5g", "to: -5g").replace("a:", "c:"), "mass"),
    "K of a mass": (HEAVY.replace("{M: {", "{K: {").replace("a:", "c:"), "only M follows"),
    "itself": (HEAVY.replace("of: finger", "of: c").replace("a:", "c:"), "is this mass itself"),
}


@pytest.mark.parametrize("name", WRONG)
def test_follows_with_mistakes_refused_at_line(name: str):
    modules, message = WRONG[name]
    text = score(f"{PAIR}{modules}".replace("\n  ", " "), "a: {SOX: a}")
    output = [(line, output) for _, line, output in check_reports(text) if message in output]
    assert [line for line, _ in output] == [12], check_reports(text)


def test_follows_in_key_is_refused():
    text = """ergon: 1
keys:
  k:
    struck: m
    modules:
      m: {MAS: {M: 20g}}
      p: {MAS: {M: 20g, follows: {M: {of: m, from: 1g, to: 2g}}}}
"""
    assert any("not to a key" in message for *_, message in check_reports(text))
