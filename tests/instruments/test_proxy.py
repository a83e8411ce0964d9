"""Proxies: points between masses, still or moved by another MAT."""

from itertools import pairwise

import numpy as np
import pytest
from checked import check_reports
from one_instrument import rendered, score
from planned_sound import off_db, played, ready
from scipy.integrate import solve_ivp
from sweep import crossed

from ergon import _core

STRING = "s: {STRING: {masses: 20, M: 6g, f: 110Hz, t60: 3s}}, wall: {SOL: {}}"
HAMMER = "h: {MAS: {M: 2g, X0: -1mm, V0: 1m/s}}"
CONTACT = "BUT: {between: [h, %s], K: 4kN/m, Z: 0.1Ns/m}"


def block(modules: str) -> str:
    """Modules of a flow mapping, a line each."""
    return modules.replace("}}, ", "}}\n")


@pytest.mark.parametrize(
    ("source", "accuracy"),
    crossed(
        ["of: s, at: 6", "of: [wall, s, wall], at: 7", "of: s.6, shares: 1"],
        ["method: ca", "error: -60dB"],
    ),
)
def test_proxy_at_mass_equals_mass(source: str, accuracy: str):
    out = "a: {SOX: s.15}, f: {SOF: felt}"
    plain = score(block(f"{STRING}, {HAMMER}, felt: {{{CONTACT % 's.6'}}}"), out, accuracy)
    with_proxy = f"{STRING}, {HAMMER}, p: {{PROXY: {{{source}}}}}, felt: {{{CONTACT % 'p'}}}"
    ours = rendered(score(block(with_proxy), out, accuracy))
    theirs = rendered(plain)
    assert np.abs(theirs).min(axis=0).max() < np.abs(theirs[:, 0]).max()
    if accuracy == "method: ca":
        np.testing.assert_array_equal(ours, theirs)
    else:  # contacts at masses are solved finer
        assert off_db(ours, theirs) < -50.0


ROW = """\
a: {MAS: {M: 2g, X0: 1mm}}
b: {MAS: {M: 3g, V0: 0.3m/s}}
c: {CEL: {M: 5g, K: 900N/m}}
ab: {RES: {between: [a, b], K: 700N/m}}
bc: {RES: {between: [b, c], K: 500N/m}}
h: {MAS: {M: 4g, X0: -0.5mm, V0: 0.5m/s}}
finger: {MAS: {M: 1g, X0: 10mm, V0: 2m/s}}
hit: {BUT: {between: [h, p], K: 3kN/m, Z: 0.2Ns/m}}
rub: {LNL: {between: [h, p], law: "300*d + 4e6*d**3", damping: "0.1*v"}}
"""
MASSES = np.array([2e-3, 3e-3, 5e-3, 4e-3])
STIFF = np.array([[700, -700, 0, 0], [-700, 1200, -500, 0], [0, -500, 1400, 0], [0] * 4], float)
WAYS = {
    "shares": ("of: [a, b, c], shares: [0.5, -0.3, 1.1]", lambda t: np.array([0.5, -0.3, 1.1])),
    "at": ("of: [a, b, c], at: 1.3", lambda t: np.array([0.0, 0.7, 0.3])),
    # From 0.3 of the way to the end, and there it stays.
    "follows": ("of: [a, b, c], follows: finger, span: 50mm, offset: 5mm", None),
}


def weights(t: float) -> np.ndarray:
    at = 2.0 * min(1.0, (10e-3 + 2.0 * t + 5e-3) / 50e-3)
    return np.maximum(0.0, 1.0 - np.abs(at - np.arange(3)))


@pytest.mark.parametrize("method", WAYS)
def test_proxy_links_against_dop853(method: str):
    """A contact and a law with damping; the path of what it follows is a straight line."""
    written, shares = WAYS[method]
    shares = shares or weights
    curvature = 35e-3 / 2.0  # when the moving one has come to the end [s]

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        x, v, w = y[:4], y[4:], shares(t)
        # A moving proxy has the speed of its masses and that of its place.
        step = 1e-7
        moved = (shares(t + step) - w) / step @ x[:3] if method == "follows" else 0.0
        d, stretched = w @ x[:3] - x[3], w @ v[:3] + moved - v[3]
        f = 300 * d + 4e6 * d**3 + 0.1 * stretched
        f += 3e3 * d + 0.2 * stretched if d < 0 else 0.0
        force = -STIFF @ x
        force[:3] -= w * f
        force[3] += f
        return np.concatenate([v, force / MASSES])

    errors = []
    out = "a: {SOX: a}, b: {SOX: b}, c: {SOX: c}, h: {SOX: h}, p: {SOX: p}"
    for hertz in (88_200, 176_400):
        text = score(f"p: {{PROXY: {{{written}}}}}\n{ROW}", out, rate=hertz)
        ours = rendered(text)
        when = np.arange(len(ours)) / hertz
        y, parts = np.array([1e-3, 0, 0, -0.5e-3, 0, 0.3, 0, 0.5]), []
        knots = (
            [0.0, 5e-3, curvature, when[-1] + 1e-9]
            if method == "follows"
            else [0.0, when[-1] + 1e-9]
        )
        for start, stop in pairwise(knots):
            inside = when[(when >= start) & (when < stop)]
            position = [*inside, stop]
            done = solve_ivp(rate, (start, stop), y, "DOP853", position, rtol=1e-10, atol=1e-13)
            y = done.y[:, -1]
            parts.append(done.y[:, :-1])
        exact = np.hstack(parts)[:4].T
        errors.append(np.abs(ours[:, :4] - exact).max() / np.abs(exact).max())
        place = [shares(t) @ x[:3] for t, x in zip(when, ours, strict=True)]
        np.testing.assert_allclose(ours[:, 4], place, rtol=0, atol=1e-12)
    assert errors[1] < 2e-3
    assert errors[0] > 1.6 * errors[1], "of the first order at least, as explicit damping is"


def energy(modules: str, out: str = "a: {SOX: h}") -> tuple[_core.Simulation, _core.Energy]:
    built = ready(score(modules, out))
    simulation = _core.Simulation(built.network, built.timeline, ledger=True)
    simulation.process(np.empty((1764, simulation.n_out)))
    return simulation, simulation.energy()


@pytest.mark.parametrize("method", WAYS)
def test_proxy_ledger_closes(method: str):
    """Also where something moves it, and so works on what it touches."""
    written, _ = WAYS[method]
    push = "push: {ENF: {to: p, from: 0.2N}}\n"
    _, ledger = energy(f"p: {{PROXY: {{{written}}}}}\n{push}{ROW}")
    assert ledger.flow > 1e-3
    assert abs(ledger.residual) < 1e-11 * ledger.flow


def test_proxy_between_four_plate_masses():
    """Along both sides linear; its rim is the first and the last place."""
    plate = "s: {PLATE: {shape: rectangle, sides: [4, 3], M: 40g, f: 200Hz, t60: 1s, rim: fixed}}"
    outs = ", ".join(f"m{i}: {{SOX: s.{i}}}" for i in range(12))
    modules = (
        f"{plate}\nwall: {{SOL: {{}}}}\n{HAMMER}\np: {{PROXY: {{of: s, rim: wall, at: [%s]}}}}"
    )
    modules += f"\nfelt: {{{CONTACT % 'p'}}}"
    for position, corner in (("1.25, 2.6", True), ("0.5, 2", False)):
        sound = rendered(score(modules % position, f"p: {{SOX: p}}, {outs}"))
        grid = np.zeros((len(sound), 5, 6))
        grid[:, 1:4, 1:5] = sound[:, 1:].reshape(-1, 3, 4)
        row = {True: [0, 0.75, 0.25, 0, 0], False: [0.5, 0.5, 0, 0, 0]}[corner]
        column = {True: [0, 0, 0.4, 0.6, 0, 0], False: [0, 0, 1, 0, 0, 0]}[corner]
        expected = np.einsum("nij,i,j->n", grid, row, column)
        assert np.abs(expected).max() > 1e-5
        np.testing.assert_allclose(sound[:, 0], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("share", "refused"), [(0.95, False), (1.05, True)])
def test_proxy_certificate_at_stability_border(share: float, refused: bool):
    """λ of a spring at a proxy is K·(1/M + Σ share²/m), over the square of the rate."""
    inverse = 1 / 2e-3 + 0.6**2 / 1e-3 + 0.4**2 / 3e-3
    stiffness = share * 4 * 44_100**2 / inverse
    modules = f"""\
a: {{MAS: {{M: 1g}}}}
b: {{MAS: {{M: 3g}}}}
h: {{MAS: {{M: 2g, X0: 1um}}}}
p: {{PROXY: {{of: [a, b], shares: [0.6, 0.4]}}}}
l: {{RES: {{between: [h, p], K: {stiffness}N/m}}}}"""
    built = ready(score(modules, "a: {SOX: h}"))
    if refused:
        with pytest.raises(_core.EngineError, match=r"is 4\.200000 and must be below 4"):
            _core.Simulation(built.network, built.timeline)
    else:
        simulation = _core.Simulation(built.network, built.timeline)
        sound = np.empty((44_100, simulation.n_out))
        simulation.process(sound)
        assert np.abs(sound).max() < 1e-4


def test_proxy_on_string_leaves_string_in_modes():
    """A string goes by its modes, and the masses beside the proxy are its ports."""
    modules = block(f"{STRING}, {HAMMER}, p: {{PROXY: {{of: [wall, s, wall], at: 7.35}}}}, ")
    modules += f"felt: {{{CONTACT % 'p'}}}"
    text = score(modules, "a: {SOX: s.15}, f: {SOF: felt}", "error: -60dB")
    exact = played(text.replace("44100Hz", "705600Hz"), method="ca")[::16]
    built = ready(text)
    plan = _core.Plan(built.network, built.timeline, error_db=-60.0)
    rows = plan.rows()
    assert "modes" in [row.what for row in rows]
    sound = played(text, error_db=-60.0)
    worst = max(row.error_db for row in rows if row.error_db is not None)
    n = min(len(sound), len(exact))
    assert off_db(sound[:n], exact[:n]) < min(-55.0, worst + 6.0)


WRONG = {
    "no place": ("p: {PROXY: {of: s}}", "needs at, follows or shares"),
    "two ways": ("p: {PROXY: {of: s, at: 1, shares: 1}}", "keep one of the two"),
    "shares": ("p: {PROXY: {of: s, shares: [1, 2]}}", "20 masses and 2 shares"),
    "beyond": ("p: {PROXY: {of: s, at: 19.5}}", "at 0 to 19"),
    "two sides": ("p: {PROXY: {of: s, at: [1, 2]}}", "write one place"),
    "rows": ("p: {PROXY: {of: s, columns: 7, at: [1, 2]}}", "do not fill rows of 7"),
    "a side": ("p: {PROXY: {of: s, columns: 5, at: 1}}", "a row and a column"),
    "a proxy of a proxy": (
        "q: {PROXY: {of: s, at: 1}}\np: {PROXY: {of: [q, s.3], shares: [1, 1]}}",
        "is a PROXY itself",
    ),
    "no rows": (
        "d: {PLATE: {shape: disc, radius: 3, M: 9g, f: 90Hz}}\np: {PROXY: {of: d, at: 1.5}}",
        "is a disc, whose masses are not in rows",
    ),
    "imposed": (
        "p: {PROXY: {of: s, at: 1}}\nx: {ENX: {to: p, from: 1mm}}",
        "drive one of its masses",
    ),
    "no span": ("p: {PROXY: {of: s, follows: wall, span: 0m}}", "would not move it"),
    "only": ("p: {PROXY: {of: s, at: 1, span: 2m}}", "only a PROXY with follows"),
}


@pytest.mark.parametrize("name", WRONG)
def test_proxy_mistakes_refused_with_line(name: str):
    modules, message = WRONG[name]
    text = score(f"{block(STRING)}\n{modules}", "a: {SOX: s.3}")
    last = 9 + modules.count("\n")
    assert [line for _, line, told in check_reports(text) if message in told] == [last]


def test_proxy_as_strike_target_is_refused():
    text = score(f"{block(STRING)}\np: {{PROXY: {{of: s, at: 1.5}}}}", "a: {SOX: p}")
    output = check_reports(text + "strikes: {a: {to: i.p, at: 0s, impulse: 1mNs}}\n")
    assert [line for code, line, message in output if "strike the masses" in message] == [12]
