"""By complex modes: linear bodies of any damping, such as nothing holds, such as tell a force."""

import numpy as np
import pytest
from accuracy import audit, random_scenes
from accuracy.__main__ import NAMED
from accuracy.equations import read
from accuracy.reference import solve
from planned_sound import off_db
from sweep import few

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import PreparedPiece, prepare

EXACT_DB = -120.0
RATE = 44_100.0
ALL = "complex modes ×1"
HEAD = """
ergon: 1
title: body
instruments:
  s:
    modules:
"""
TAIL = "render: {tail: 0.25s, bits: float}\n"


def score(modules: str, out: str, more: str = "") -> str:
    lines = "".join(f"      {line}\n" for line in modules.strip().splitlines())
    return f"{HEAD.lstrip()}{lines}    out: {out}\n{more}{TAIL}"


def ready(text: str) -> PreparedPiece:
    loaded = load("scene.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return prepare(loaded.piece)


def played(text: str, threads: int = 1, block: int | None = None, **wishes: object) -> np.ndarray:
    stage = ready(text)
    plan = _core.Plan(stage.network, stage.timeline, **wishes)
    assert {row.what for row in plan.rows()} == {"complex modes"}
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=threads)
    sound = np.empty((stage.n_frames, simulation.n_out))
    for first in range(0, len(sound), block or len(sound)):
        part = np.ascontiguousarray(sound[first : first + (block or len(sound))])
        simulation.process(part)
        sound[first : first + len(part)] = part
    return sound


@pytest.mark.parametrize("name", ["nonprop-1", "nonprop-2", "damper"])
def test_complex_modes_exact_at_every_budget(name: str):
    text = (NAMED / f"{name}.yaml").read_text(encoding="utf-8")
    for plan in audit.look(name, text, plain=False).plans:
        assert not plan.refused, plan.refused
        assert plan.how == ALL
        assert plan.render_error <= EXACT_DB
        assert not plan.warned


@pytest.mark.parametrize("family", ["linear", "mesh", "body"])
@pytest.mark.parametrize("seed", few(range(6), 2))
def test_complex_modes_exact_for_random_linear_scenes(family: str, seed: int):
    text = random_scenes.text(family, seed)
    (plan,) = audit.look(f"{family}-{seed}", text, (-140.0,), plain=False).plans
    assert plan.how in (ALL, "modes ×1")
    assert plan.render_error <= EXACT_DB


def test_complex_modes_of_mass_with_damper_only():
    """x = v·m/z·(1 − e^(−z·t/m)), and its damper pulls with z·v."""
    m, z, v = 0.02, 0.5, 1.5
    modules = f"""
w: {{SOL: {{}}}}
a: {{MAS: {{M: {m}kg, V0: {v}m/s}}}}
d: {{FRO: {{between: [w, a], Z: {z}}}}}
"""
    sound = played(score(modules, "{x: {SOX: a}, f: {SOF: {FRO: d}}}"))
    t = np.arange(len(sound)) / RATE
    fall = np.exp(-z * t / m)
    exact = np.stack([v * m / z * (1.0 - fall), -z * v * fall], axis=1)
    assert off_db(sound, exact) <= -200.0


def test_complex_modes_of_free_body():
    """Two masses, a spring and a damper: their middle moves with the sum of the impulses."""
    modules = """
a: {MAS: {M: 10g, V0: 0.5m/s}}
b: {MAS: {M: 30g}}
k: {REF: {between: [a, b], K: 2000, Z: 0.3}}
"""
    strikes = "strikes:\n  hit: {to: s.b, at: 0.0123456s, impulse: 0.004Ns, lasts: 0s}\n"
    sound = played(score(modules, "{a: {SOX: a}, b: {SOX: b}}", strikes))
    t = np.arange(len(sound)) / RATE
    middle = (0.01 * 0.5 * t + 0.004 * np.maximum(t - 0.0123456, 0.0)) / 0.04
    ours = (0.01 * sound[:, 0] + 0.03 * sound[:, 1]) / 0.04
    assert off_db(ours[:, None], middle[:, None]) <= -200.0


@pytest.mark.parametrize("share", [0.999999, 1.0, 1.000001, 3.0])
def test_complex_modes_near_critical_damping(share: float):
    """x¨ + 2σx˙ + ω²x = 0 where σ is ω, and beside: both roots are one, or nearly."""
    m, k = 0.01, 4e3
    omega = float(np.sqrt(k / m))
    sigma = share * omega
    modules = f"""
w: {{SOL: {{}}}}
a: {{MAS: {{M: {m}kg, X0: 1mm}}}}
k: {{REF: {{between: [w, a], K: {k}, Z: {2.0 * sigma * m!r}}}}}
"""
    sound = played(score(modules, "{x: {SOX: a}, f: {SOF: {REF: k}}}"))
    t = np.arange(len(sound)) / RATE
    root = np.sqrt(complex(sigma**2 - omega**2))
    slide = t if root == 0.0 else np.sinh(root * t) / root
    x = 1e-3 * np.real(np.exp(-sigma * t) * (np.cosh(root * t) + sigma * slide))
    v = -1e-3 * np.real(np.exp(-sigma * t) * slide) * omega**2
    exact = np.stack([x, -(k * x + 2.0 * sigma * m * v)], axis=1)
    assert off_db(sound, exact) <= -150.0


@pytest.mark.parametrize("Z", [1e2, 1e4, 1e5])
def test_complex_modes_with_strong_damper(Z: float):
    modules = f"""
w: {{SOL: {{}}}}
a: {{MAS: {{M: 1g, X0: 1mm}}}}
b: {{MAS: {{M: 1g}}}}
c: {{MAS: {{M: 2g}}}}
k: {{RES: {{between: [a, b], K: 1000}}}}
j: {{RES: {{between: [b, c], K: 3000}}}}
d: {{FRO: {{between: [w, b], Z: {Z}}}}}
"""
    text = score(modules, "{a: {SOX: a}, b: {SOX: b}, f: {SOF: {FRO: d}}}")
    sound = played(text, method="modal")
    exact = solve(read(text), len(sound)).sound
    assert off_db(sound, exact) <= EXACT_DB


def test_complex_modes_with_equal_poles():
    """A ring of equal cells, one of which a damper holds: most of its poles are equal in pairs."""
    n = 12
    cells = [
        f"m{i}: {{CEL: {{M: 5g, K: 3000, Z: 0.01, X0: {(-1) ** (i * i // 3)}mm}}}}"
        for i in range(n)
    ]
    links = [f"r{i}: {{RES: {{between: [m{i}, m{(i + 1) % n}], K: 900}}}}" for i in range(n)]
    modules = "\n".join([*cells, *links, "w: {SOL: {}}", "d: {FRO: {between: [w, m0], Z: 0.7}}"])
    text = score(modules, "{a: {SOX: m3}, b: {SOX: m7}, f: {SOF: {RES: r5}}}")
    sound = played(text)
    assert off_db(sound, solve(read(text), len(sound)).sound) <= EXACT_DB


def test_complex_modes_bytes_with_threads_and_blocks():
    text = random_scenes.text("linear", 1)
    sound = played(text)
    for threads, block in ((2, None), (4, 777), (1, 1)):
        assert played(text, threads, block).tobytes() == sound.tobytes()


def test_complex_modes_plan_from_pins_same_hash():
    stage = ready(random_scenes.text("mesh", 0))
    plan = _core.Plan(stage.network, stage.timeline, error_db=-20.0)
    (row,) = plan.rows()
    assert row.what == "complex modes"
    again = _core.Plan(stage.network, stage.timeline, error_db=-20.0, pins=plan.choices())
    assert again.hash == plan.hash


def test_complex_modes_truncated_to_budget():
    """Of many only those that a budget asks for, where that halves the work; else all, exactly."""
    n = 60
    chain = [f"m{i}: {{MAS: {{M: 1g}}}}" for i in range(n)]
    links = [f"r{i}: {{RES: {{between: [m{i}, m{i + 1}], K: 90000}}}}" for i in range(n - 1)]
    held = ["w: {SOL: {}}", "t: {RES: {between: [w, m0], K: 90000}}"]
    damped = [f"d{i}: {{FRO: {{between: [m{i}, m{i + 1}], Z: 0.2}}}}" for i in range(0, n - 1, 3)]
    modules = "\n".join([*chain, *links, *held, *damped])
    strikes = "strikes:\n  hit: {to: s.m59, at: 0.001s, impulse: 1e-4Ns}\n"
    text = score(modules, "{x: {SOX: m30}}", strikes)
    stage = ready(text)
    saved = []
    for budget in (-10.0, -30.0, -120.0):
        plan = _core.Plan(stage.network, stage.timeline, error_db=budget)
        (row,) = plan.rows()
        assert row.what == "complex modes"
        assert row.modes is not None
        saved.append(row.modes[0])
        sound = played(text, error_db=budget)
        exact = solve(read(text), len(sound)).sound
        assert audit.error_db(sound, exact, RATE) <= (budget if saved[-1] < n else EXACT_DB)
    assert saved[0] <= n // 2
    assert saved[-1] == n


def test_complex_modes_not_used_for_ca_units():
    """`units: ca`: its own steps are the sound."""
    modules = """
w: {SOL: {}}
a: {MAS: {M: 1, X0: 1mm}}
b: {MAS: {M: 1}}
k: {REF: {between: [a, b], K: 0.01, Z: 0.001}}
j: {RES: {between: [w, b], K: 0.02}}
"""
    text = score(modules, "{x: {SOX: a}}").replace(
        "  s:\n", "  s:\n    units: ca\n    at: 44100Hz\n"
    )
    stage = ready(text)
    (row,) = _core.Plan(stage.network, stage.timeline).rows()
    assert (row.what, row.because) == (
        "stepped",
        "its damping is not proportional to stiffness and mass",
    )


HAMMER = """
b: {STRING: {masses: 20, M: 8g, f: 220Hz, t60: 2s}}
w: {SOL: {}}
d: {FRO: {between: [w, b.12], Z: 0.05}}
h: {MAS: {M: 4g, X0: -0.2mm, V0: 1m/s}}
c: {BUT: {between: [h, b.4], K: 20000, gap: 0mm}}
"""
BOW = """
b: {STRING: {masses: 20, M: 8g, f: 220Hz, t60: 2s}}
w: {SOL: {}}
d: {FRO: {between: [w, b.12], Z: 0.05}}
l: {LNL: {between: [w, b.4], damping: bow, F: 0.05, a: 40, u: 0.1}}
"""


@pytest.mark.parametrize("modules", few([HAMMER, BOW], 1), ids=["hammer", "bow"])
def test_complex_modes_of_body_with_contacts(modules: str):
    """As exact as a body by its normal modes: the error is that of the contact or the law."""
    strikes = "strikes:\n  hit: {to: s.b.9, at: 0.0503s, impulse: 1e-4Ns}\n"
    text = score(modules, "{a: {SOX: b.15}, b: {SOX: b.4}}", strikes)
    free = text.replace("      d: {FRO: {between: [w, b.12], Z: 0.05}}\n", "")
    (damped,) = audit.look("damped", text, (-80.0,), plain=False).plans
    (normal,) = audit.look("normal", free, (-80.0,), plain=False).plans
    assert "complex modes" in damped.how
    assert "complex modes" not in normal.how
    assert damped.real <= max(-80.0, normal.real + 3.0)
    assert damped.excess <= 1.5


def test_complex_modes_of_body_linked_to_key():
    """A key on a spring at a damped body, led by a hand: against the exact motion."""
    modules = """
b: {STRING: {masses: 12, M: 20g, f: 150Hz, t60: 1s}}
w: {SOL: {}}
d: {FRO: {between: [w, b.8], Z: 0.2}}
c: {REF: {between: [k1, b.3], K: 500, Z: 0.05}}
"""
    more = """keys: {k1: {M: 0.2kg, K: 80, Z: 0.5}}
gestures: {g: {notation: 0m@0 smooth 0.004m@0.05s 0m@0.12s, touch: open}}
players: {p: {key: k1}}
parts: {p: [{at: 0.05s, play: g}]}
"""
    text = score(modules, "{a: {SOX: b.6}, k: {SOX: k1}}", more)
    (plan,) = audit.look("key", text, (-60.0,), plain=False).plans
    assert "complex modes" in plan.how, plan
    assert plan.real <= -60.0
    assert plan.excess <= 1.5
