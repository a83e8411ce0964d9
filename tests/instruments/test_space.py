"""Instruments in space: their motion beside DOP853 and closed forms, names of points, mistakes."""

import numpy as np
import pytest
import yaml
from checked import check, check_reports
from jsonschema import Draft7Validator
from oracle import matter
from scipy.optimize import fsolve
from sweep import few

from ergon.scores.reading.schema import schema
from ergon.scores.staging.stage import stage

G = 9.81


def rendered(text: str, rate: int = 44_100) -> np.ndarray:
    """Outputs of a score, stepped by CA (n_frames, n_out)."""
    lines = f"rates: {{audio: {rate}Hz}}\naccuracy: {{method: ca}}\n"
    built = stage(check(lines + text).piece, planned=True)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    return sound


TANGLE = """\
ergon: 1
instruments:
  t:
    space: %d
    gravity: 9.81m/s2
    modules:
%s
    out: {%s}
render: {bits: float, tail: 0.1s}
"""


def tangle(
    seed: int, axes: int, damping: float = 0.02
) -> tuple[str, dict[str, np.ndarray], list[matter.Link]]:
    """A fixed point and five masses, most pairs joined by a spring or a contact."""
    draw = np.random.default_rng(seed)
    n = 6
    x0 = draw.uniform(-0.05, 0.05, (n, axes)).round(4)
    v0 = draw.uniform(-0.5, 0.5, (n, axes)).round(3)
    mass = draw.uniform(2e-3, 2e-2, n).round(5)
    mass[0], v0[0] = 0.0, 0.0
    lines = [f"      m0: {{SOL: {{X0: {x0[0].tolist()}}}}}"]
    for i in range(1, n):
        place, speed = x0[i].tolist(), v0[i].tolist()
        lines.append(f"      m{i}: {{MAS: {{M: {mass[i]}kg, X0: {place}, V0: {speed}}}}}")
    links = []
    for b in range(n):
        for a in range(b):
            length = float(np.linalg.norm(x0[b] - x0[a]))
            stiff, damp = round(draw.uniform(50, 400), 2), round(draw.uniform(0, damping), 4)
            ends = f"between: [m{a}, m{b}], K: {stiff}, Z: {damp}"
            if (a + b) % 3 == 1:
                gap = round(length * draw.uniform(0.5, 1.1), 5)
                lines.append(f"      c{a}{b}: {{BUT: {{{ends}, gap: {gap}, exponent: 1.5}}}}")
                links.append(matter.Link(a, b, stiff, damp, gap, True, 1.5))
            elif (a + b) % 3 == 2:
                lines.append(f"      s{a}{b}: {{REF: {{{ends}}}}}")
                links.append(matter.Link(a, b, stiff, damp, length))
            else:
                core = round(draw.uniform(0.01, 0.05), 4)
                ends = f"between: [m{a}, m{b}], K: {stiff}, core: {core}"
                lines.append(f"      a{a}{b}: {{ATTRACTION: {{{ends}}}}}")
                links.append(matter.Link(a, b, stiff, 0.0, 0.0, core=core))
    names = "xyz"[:axes]
    outputs = ", ".join(f"m{i}{c}: {{SOX: m{i}.{c}}}" for i in range(1, n) for c in names)
    return (
        TANGLE % (axes, "\n".join(lines), outputs),
        {"x0": x0, "v0": v0, "mass": mass},
        links,
    )


@pytest.mark.parametrize(
    ("seed", "axes", "damping", "order"),
    few([(1, 2, 0.02, 1), (2, 3, 0.0, 2), (3, 3, 0.0, 2)], 2),
)
def test_space_network_motion_against_dop853(seed: int, axes: int, damping: float, order: int):
    """By the second order of the step; where damping lags half a step behind, by the first."""
    text, arguments, links = tangle(seed, axes, damping)
    errors = []
    for rate in (44_100, 88_200):
        ours = rendered(text, rate)
        when = np.arange(0, len(ours), rate // 4410) / rate
        exact = matter.solve(**arguments, links=links, when=when, gravity=G)
        apart = ours[:: rate // 4410] - exact[:, 1:].reshape(len(when), -1)
        errors.append(np.abs(apart).max())
    size = np.abs(exact).max()
    assert errors[1] < 1e-4 * size
    assert 0.75 * 2**order < errors[0] / errors[1] < 1.25 * 2**order


def test_space_law_of_distance_against_dop853():
    """A molecule that turns on a damped spring that hardens; its law is endless where d is 0."""
    text = """\
ergon: 1
instruments:
  t:
    space: 3
    modules:
      sun: {SOL: {X0: [0, 0, 0]}}
      a: {MAS: {M: 5g, X0: [4cm, 0, 0], V0: [0, 0.3m/s, 0]}}
      b: {MAS: {M: 3g, X0: [9cm, 0, 1cm], V0: [0, 0.2m/s, 0.1m/s]}}
      bond: {LNL: {between: [a, b], law: "grip*((size/d)**7 - (size/d)**13)", grip: 0.4N,
        size: 45mm, rest: 0}}
      hard: {LNL: {between: [sun, b], law: k*d + q*d**3, damping: z*v, k: 20N/m, q: 1e4, z: 0.01}}
    out: {x: {SOX: b.x}, y: {SOX: b.y}, z: {SOX: b.z}, f: {SOF: bond}}
render: {bits: float, tail: 0.3s}
"""
    x0 = np.array([(0, 0, 0), (0.04, 0, 0), (0.09, 0, 0.01)])
    v0 = np.array([(0, 0, 0), (0, 0.3, 0), (0, 0.2, 0.1)])
    size, length = 0.045, float(np.hypot(0.09, 0.01))

    def bond(d: float, _: float) -> float:
        return 0.4 * ((size / d) ** 7 - (size / d) ** 13)

    links = [
        matter.Link(1, 2, 0.0, 0.0, 0.0, law=bond),
        matter.Link(0, 2, 0.0, 0.0, length, law=lambda d, v: 20 * d + 1e4 * d**3 + 0.01 * v),
    ]
    mass, errors = np.array([0.0, 5e-3, 3e-3]), []
    for rate in (44_100, 88_200):
        ours = rendered(text, rate)
        when = np.arange(0, len(ours), rate // 4410) / rate
        exact = matter.solve(x0, v0, mass, links, when)
        errors.append(np.abs(ours[:: rate // 4410, :3] - exact[:, 2]).max())
        apart = np.linalg.norm(exact[:, 2] - exact[:, 1], axis=1)
        np.testing.assert_allclose(ours[:: rate // 4410, 3], [-bond(d, 0) for d in apart], 0, 2e-3)
    assert errors[1] < 1e-4 * np.abs(exact).max()
    assert 1.5 < errors[0] / errors[1] < 2.5  # damping lags half a step behind


def test_attraction_orbit_period():
    """Its period is 2 pi / sqrt(K/M (1 + (r/core)^2)^-1.5): far away that of Kepler's third law."""
    r, core, stiff, mass = 0.12, 0.02, 3e3, 5e-3
    speed = r * np.sqrt(stiff / mass * (1 + (r / core) ** 2) ** -1.5)
    text = f"""ergon: 1
instruments:
  t:
    space: 2
    modules:
      sun: {{SOL: {{X0: [0, 0]}}}}
      planet: {{MAS: {{M: {mass}kg, X0: [{r}, 0], V0: [0, {float(speed)!r}]}}}}
      pull: {{ATTRACTION: {{between: [sun, planet], K: {stiff}, core: {core}}}}}
    out: {{x: {{SOX: planet.x}}, y: {{SOX: planet.y}}}}
render: {{tail: 1s}}
"""
    errors = []
    for rate in (44_100, 88_200):
        ours = rendered(text, rate)
        turn = speed / r * np.arange(len(ours)) / rate
        exact = r * np.stack([np.cos(turn), np.sin(turn)], 1)
        errors.append(float(np.abs(ours - exact).max()))
    assert turn[-1] > 4 * np.pi  # it goes round more than twice
    assert errors[0] < 3e-5 * r
    assert 3.5 < errors[0] / errors[1] < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(50))
def test_space_networks_of_fifty_seeds(seed: int):
    text, arguments, links = tangle(seed + 100, 2 + seed % 2)

    def error(rate: int) -> float:
        """Largest error, as a share of the largest coordinate."""
        ours, every = rendered(text, rate), rate // 4_410
        when = np.arange(0, len(ours), every) / rate
        exact = matter.solve(**arguments, links=links, when=when, gravity=G)
        apart = ours[::every] - exact[:, 1:].reshape(len(when), -1)
        return float(np.abs(apart).max() / np.abs(exact).max())

    # Where two points nearly meet, finer steps are needed: in one of the fifty.
    assert error(352_800) < 1e-4 or error(705_600) < 2e-5


def test_chain_at_rest_is_catenary():
    n, mass, stiff, width, length = 9, 0.02, 400.0, 0.4, 0.06
    text = f"""\
ergon: 1
instruments:
  rope:
    space: 2
    gravity: {G}
    CHAIN: {{masses: {n}, M: {mass}kg, from: [0, 0], to: [{width}, 0], K: {stiff}, Z: 0.5,
      rest: {length}, drag: 0.05}}
    out: {{{", ".join(f"{c}{i}: {{SOX: rope.{i}.{c}}}" for i in range(1, n - 1) for c in "xy")}}}
strikes: {{a: {{to: rope.1..7.y, at: 0, impulse: 1mNs}}}}
render: {{bits: float, tail: 4s}}
"""
    rest = rendered(text, 8_000)[-1].reshape(-1, 2)
    each = np.full(n, mass / (n - 2))
    links = [matter.Link(i, i + 1, stiff, 0.0, length) for i in range(n - 1)]

    def left(inner: np.ndarray) -> np.ndarray:
        x = np.array([(0.0, 0.0), *inner.reshape(-1, 2), (width, 0.0)])
        return matter.forces(x, np.zeros_like(x), each, links, G)[1:-1].ravel()

    across = np.linspace(0, width, n)[1:-1]
    guess = np.stack([across, -0.1 * np.sin(np.pi * across / width)], 1)
    exact = fsolve(left, guess.ravel(), xtol=1e-13).reshape(-1, 2)
    assert exact[:, 1].min() < -0.05
    np.testing.assert_allclose(rest, exact, atol=1e-9)


def test_link_of_one_axis_to_coordinate():
    """A mass that hangs on a spring between its y and a CEL: an oscillator of two masses."""
    text = """\
ergon: 1
instruments:
  ball:
    space: 2
    modules: {m: {MAS: {M: 10g, X0: [3cm, 0], V0: [0, 0.1m/s]}}}
    out: {x: {SOX: m.x}, y: {SOX: m.y}}
  bell:
    modules:
      c: {CEL: {M: 20g, K: 500N/m}}
      s: {RES: {between: [ball.m.y, c], K: 300N/m}}
    out: {SOX: c}
render: {bits: float, tail: 0.1s}
"""
    rate = 176_400
    x, y, bell = rendered(text, rate).T
    stiffness = np.array([[300.0, -300.0], [-300.0, 800.0]])
    roots = np.diag([0.01**-0.5, 0.02**-0.5])
    squares, modes = np.linalg.eigh(roots @ stiffness @ roots)
    on_first = modes.T @ np.linalg.inv(roots) @ np.array([0.1, 0.0])
    t = np.arange(len(y))[:, None] / rate
    exact = (on_first * np.sin(np.sqrt(squares) * t) / np.sqrt(squares)) @ (roots @ modes).T
    np.testing.assert_allclose(np.stack([y, bell], 1), exact, atol=1e-6 * np.abs(exact).max())
    assert set(x) == {0.03}


def test_cloth_mass_and_link_count():
    text = """\
ergon: 1
instruments:
  net:
    space: 3
    CLOTH: {sides: [4, 3], M: 60g, at: [0, 0, 0], across: [3cm, 0, 0], up: [0, 4cm, 0],
      K: 1kN/m, shear: 200N/m, held: corners}
    out: {z: {SOX: net.5.z}}
strikes: {a: {to: net.5.z, at: 0, impulse: 1mNs, lasts: 0s}}
render: {tail: 10ms}
"""
    built = stage(check(text).piece)
    network = built.built_network.network
    # 3 rows of 3 springs, 4 columns of 2, 12 across the 6 meshes.
    assert (network.n_mat, network.n_lia) == (36, 9 + 8 + 12)
    sound = np.empty((built.n_frames, built.simulation.n_out))
    built.simulation.process(sound)
    # 60 g on eight points, of which one was struck.
    speed = np.diff(sound[:, 0])[0] * 44_100
    assert speed == pytest.approx(1e-3 / (0.06 / 8), rel=1e-9)


HEAD = "ergon: 1\ninstruments:\n"
CHAIN = "{CHAIN: {masses: 4, M: 1g, from: [0, 0, 0], to: [1m, 0, 0], K: 1}}"
BOB = "      bob: {MAS: {M: 1g, X0: [0, 0, 1m]}}\n      nail: {SOL: {X0: [0, 0, 0]}}\n"
SPACE = HEAD + "  b:\n    space: 3\n    modules:\n" + BOB
CELL = "  c:\n    modules:\n      m: {CEL: {M: 1g, f: A3}}\n"


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        (f"{SPACE}    out: {{SOX: bob}}\n", "E304", "write one of its axes: bob.x, bob.y, bob.z"),
        (f"{SPACE}    out: {{SOX: bob.w}}\n", "E301", "nothing is called 'bob.w'"),
        (
            f"{SPACE}      s: {{RES: {{between: [bob.x, nail], K: 1}}}}\n",
            "E304",
            "'bob.x' is one axis of a point; write the point: bob",
        ),
        (
            f"{SPACE}      s: {{RES: {{between: [bob, c.m], K: 1}}}}\n{CELL}",
            "E304",
            "'c.m' moves along one axis, not in space",
        ),
        (
            f"{SPACE}{CELL}      s: {{RES: {{between: [m, b.bob], K: 1}}}}\n",
            "E304",
            "'b.bob' is a point in space; write one of its axes: b.bob.x, b.bob.y, b.bob.z",
        ),
        (f"{SPACE}    f: A3\n", "E111", "an instrument in space has no such field"),
        (f"{SPACE}    units: ca\n", "E111", "an instrument in space has no such field"),
        (f"{HEAD}{CELL}    gravity: 9.81m/s2\n", "E111", "write space: 2 or 3"),
        (
            f"{HEAD}  b:\n    space: 2\n    modules:\n{BOB}",
            "E106",
            "the number of items is 3, but must be 2: x and y",
        ),
        (
            f"{HEAD}  b:\n    space: 4\n    modules:\n{BOB}",
            "E202",
            "space",
        ),
        (
            f"{SPACE}      s: {{LNL: {{between: [bob, nail], law: k*d}}}}\n",
            "E207",
            "There is no constant `k`",
        ),
        (
            f"{SPACE}      s: {{LNL: {{between: [bob, nail], law: d, points: [[0, 0], [1, 1]]}}}}",
            "E111",
            "keep one of the two",
        ),
        (f"{SPACE}      s: {{REF: {{between: [bob, nail]}}}}\n", "E103", "needs K or Z"),
        (f"{SPACE}      s: {{BUT: {{between: [bob, nail], K: 1}}}}\n", "E103", "'gap'"),
        (f"{SPACE}      n: {{SOL: {{}}}}\n", "E103", "'X0'"),
        (
            f"{SPACE}      r: {CHAIN}\n    out: {{SOX: r.y}}\n",
            "E304",
            "b.r has 4 points",
        ),
        (
            f"{SPACE}  d:\n    like: b\n    modules: {{bob: {{MAS: {{M: 2g}}}}}}\n",
            "E103",
            "write `space: 3` in it too",
        ),
    ],
)
def test_space_fields_with_mistakes(text: str, code: str, said: str):
    reports = check_reports(text)
    assert any(own.startswith(code) and said in sentence for own, _, sentence in reports), reports


def test_space_links_with_zero_rest_and_small_gap():
    lines = "      s: {RES: {between: [bob, nail], K: 10, rest: 0m}}\n"
    lines += "      c: {BUT: {between: [bob, nail], K: 10, gap: 50um}}\n"
    modules = check(f"{SPACE}{lines}render: {{tail: 1s}}\n").piece.instruments["b"].modules
    assert [m.fields.get("rest") for m in modules[2:3]] == [0.0]
    assert [m.fields.get("gap") for m in modules[3:]] == [pytest.approx(5e-5)]


def test_like_with_space_and_gravity():
    text = SPACE + "  d: {like: b, space: 3, gravity: 2}\n"
    piece = check(text + "render: {tail: 1s}\n").piece
    assert piece.instruments["d"].space == type(piece.instruments["d"].space)(3, 2.0)
    assert [m.name for m in piece.instruments["d"].modules] == ["bob", "nail"]


def test_space_link_too_stiff_is_refused_with_module():
    text = SPACE + "      s: {RES: {between: [bob, nail], K: 10000kN/m}}\n    out: {SOX: bob.x}\n"
    with pytest.raises(Exception, match=r"b\.bob\.[xyz]"):
        stage(check(text + "render: {tail: 1s}\n").piece)


def test_schema_accepts_coordinate_lists():
    text = SPACE + "    gravity: 9.81m/s2\n    out: {SOX: bob.x}\n"
    assert not list(Draft7Validator(schema()).iter_errors(yaml.safe_load(text)))
    wrong = text.replace("X0: [0, 0, 1m]", "X0: {q: 1}")
    assert list(Draft7Validator(schema()).iter_errors(yaml.safe_load(wrong)))


PULLED = """\
ergon: 1
instruments:
  w:
    space: 2
    modules:
      a: {SOL: {X0: [0, 0]}}
      b: {MAS: {M: 1kg, X0: [10cm, 0], V0: [0.4m/s, 0]}}
      s: {REF: {between: [a, b], K: 1kN/m%s}}
    out: {x: {SOX: b.x}, f: {SOF: s}}
render: {bits: float, tail: 0.1s}
"""


def test_spring_with_yields_elongates_permanently():
    """Perfect plasticity: 80 mJ against 5 N along the line; then it swings about a new length."""
    x, force = rendered(PULLED % ", yields: 5N").T
    # Until 5 N it takes 12.5 mJ; the rest of 80 mJ is 13.5 mm long.
    stop = 0.1 + 5e-3 + (0.08 - 0.0125) / 5.0
    assert x.max() == pytest.approx(stop, abs=1e-5)
    assert -force.min() == pytest.approx(5.0, rel=1e-9)


def test_spring_with_breaks_never_pulls_again():
    x, force = rendered(PULLED % ", breaks: 8mm").T
    broken = int(np.argmax(x > 0.108))
    assert broken > 0
    assert not force[broken:].any()
    # What is left of the speed after ½·8 N·8 mm stays.
    speed = np.diff(x[broken:]) * 44_100
    np.testing.assert_allclose(speed, np.sqrt(0.4**2 - 2 * 0.032), rtol=2e-3)


def test_cloth_with_breaks_tears():
    text = """\
ergon: 1
instruments:
  net:
    space: 3
    gravity: 9.81m/s2
    modules:
      net: {CLOTH: {sides: [6, 5], M: 20g, at: [0, 0, 0], across: [10cm, 0, 0], up: [0, 0, 8cm],
        K: 300N/m, Z: 0.01Ns/m, held: rim%s}}
      stone: {MAS: {M: 60g, X0: [5cm, 4cm, 4cm], V0: [0, -1.5m/s, 0]}}
      hit: {BUT: {between: [stone, net.all], K: 2kN/m, gap: 25mm}}
    out: {y: {SOX: stone.y}}
render: {bits: float, tail: 0.4s}
"""
    complete, torn = (rendered(text % more)[:, 0] for more in ("", ", breaks: 4mm"))
    assert complete[-1] > 0.4  # it holds the stone, and throws it back
    assert torn[-1] < -0.3  # the stone is through
