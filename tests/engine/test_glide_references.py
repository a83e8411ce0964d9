"""Glides beside the exact motion with parameters that change in time: two octaves in a bar.

What is linear has a closed form; the rest is solved by DOP853.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import jv, jvp, yv, yvp
from sweep import few

from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage

RATE = 44_100
GRID = 64  # frames from one value of a glide to the next
BEGIN, LENGTH, END = 0.25, 1.5, 2.0  # a glide of 6/8 of a bar, and what sounds of it [s]
SIGMA = math.log(1000.0)  # times 1/t60: the decay rate

SCORE = """\
ergon: 1
tempo: [{{at: 1|1, bpm: 120, meter: 4/4}}]
{keys}instruments:
  a:
    modules:
{modules}
    out: {{SOX: {heard}}}
automation: [{lines}]
accuracy: {accuracy}
render: {{tail: 2s}}
"""


def ratio(t: float) -> float:
    """Two octaves up, evenly in pitch."""
    return 4.0 ** min(1.0, max(0.0, (t - BEGIN) / LENGTH))


def rendered(modules: str, out: str, lines: str, accuracy: str = "{error: -60dB}", keys: str = ""):
    text = SCORE.format(modules=modules, heard=out, lines=lines, accuracy=accuracy, keys=keys)
    loaded = load("s.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    complete = stage(loaded.piece, planned=True)
    sound = np.zeros((complete.n_frames, complete.simulation.n_out))
    complete.simulation.process(sound)
    return sound[:, 0]


def reference(
    forces: Callable[[float, np.ndarray, np.ndarray], np.ndarray], x0: np.ndarray, n_frames: int
) -> np.ndarray:
    """Positions (n_mat, n_frames) of ẍ = forces(t, x, ẋ), by DOP853."""
    n = len(x0)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], forces(t, y[:n], y[n:])])

    result = solve_ivp(
        slope,
        (0.0, n_frames / RATE),
        np.concatenate([x0, np.zeros(n)]),
        method="DOP853",
        rtol=1e-9,
        atol=1e-14,
        t_eval=np.arange(n_frames) / RATE,
    )
    return result.y[:n]


def mode(f: float, sigma: float, share: float, x0: float, n_frames: int) -> np.ndarray:
    """Positions of ẍ + 2·s·σ·ẋ + s·((2πf·ratio)² + σ²)·x = 0 from x0, at rest; s is `share`.

    x = exp(-s·σ·t)·y makes it ÿ + (s·(2πf·ratio)² + s·σ²·(1 - s))·y = 0. Before the glide and after
    it that is an oscillation; where the pitch goes evenly, at a = ln 4/LENGTH, it is Bessel's
    equation in z = √s·2πf·ratio/a, of the order ν = √(s·(s - 1))·σ/a (DLMF 10.13.6).
    """
    t = np.arange(n_frames) / RATE
    if share < 1e-9:
        return np.full(n_frames, x0)
    a = math.log(4.0) / LENGTH
    omega = math.sqrt(share) * 2 * math.pi * f
    extra = share * (1.0 - share) * sigma**2

    def oscillation(w: float, t: np.ndarray, y: float, v: float) -> tuple[np.ndarray, np.ndarray]:
        rate = math.sqrt(w**2 + extra)
        c, s = np.cos(rate * t), np.sin(rate * t)
        return y * c + v / rate * s, v * c - y * rate * s

    end = BEGIN + LENGTH
    before, glide, after = t < BEGIN, (t >= BEGIN) & (t < end), t >= end
    y = np.empty(n_frames)
    begun = (x0, share * sigma * x0)  # ẏ of a mass that is at rest
    y[before] = oscillation(omega, t[before], *begun)[0]
    y1, v1 = (float(at) for at in oscillation(omega, np.array(BEGIN), *begun))
    # The order is imaginary below the first mode, which only a rigid body has here.
    order = math.sqrt(max(0.0, -extra)) / a
    z1 = omega / a
    system = [[jv(order, z1), yv(order, z1)], [omega * jvp(order, z1), omega * yvp(order, z1)]]
    p, q = np.linalg.solve(system, [y1, v1])
    z = z1 * np.exp(a * (t[glide] - BEGIN))
    y[glide] = p * jv(order, z) + q * yv(order, z)
    z2 = 4.0 * z1
    y2 = p * jv(order, z2) + q * yv(order, z2)
    v2 = 4.0 * omega * (p * jvp(order, z2) + q * yvp(order, z2))
    y[after] = oscillation(4.0 * omega, t[after] - end, float(y2), float(v2))[0]
    return np.exp(-share * sigma * t) * y


@pytest.mark.parametrize("share", [1.0, 7.5])
def test_glide_closed_form_against_dop853(share: float):
    f, sigma = 20.0, SIGMA / 2.0

    def forces(t, x, v):
        square = (2 * math.pi * f * ratio(t)) ** 2 + sigma**2
        return -share * (square * x + 2 * sigma * v)

    truth = reference(forces, np.array([1e-3]), N)[0]
    assert error_db(mode(f, sigma, share, 1e-3, N), truth) <= -140.0


def error_db(sound: np.ndarray, truth: np.ndarray) -> float:
    n = min(len(sound), len(truth))
    difference = sound[:n] - truth[:n]
    return float(10 * np.log10((difference**2).mean() / (truth[:n] ** 2).mean()))


GLIDE = "{{set: a.m.f, to: x4, at: {at}, over: {over}}}".format(at="0.25s", over="1.5s")
N = int(END * RATE)


def laplacian(across: int, up: int) -> np.ndarray:
    """K of springs of 1 on a square lattice with a free rim   (n_mat, n_mat)."""
    matrix = np.zeros((across * up, across * up))
    index = np.arange(across * up).reshape(up, across)
    pairs = [*zip(index[:, :-1].ravel(), index[:, 1:].ravel(), strict=True)]
    pairs += [*zip(index[:-1].ravel(), index[1:].ravel(), strict=True)]
    for i, j in pairs:
        matrix[[i, j], [i, j]] += 1.0
        matrix[[i, j], [j, i]] -= 1.0
    return matrix


@pytest.mark.parametrize(("f", "accuracy"), [(110.0, "{method: ca}"), (440.0, "{error: -60dB}")])
def test_cel_pitch_glide_error(f: float, accuracy: str):
    t60 = 3.0
    module = f"      m: {{CEL: {{M: 2g, f: {f}Hz, t60: {t60}s, X0: 1mm}}}}"
    truth = mode(f, SIGMA / t60, 1.0, 1e-3, N)
    assert error_db(rendered(module, "m", GLIDE, accuracy), truth) <= -60.0


@pytest.mark.slow
def test_string_pitch_glide_error():
    n, f, t60 = 12, 110.0, 3.0
    module = (
        f"      m: {{STRING: {{masses: {n}, M: 8g, f: {f}Hz, t60: {t60}s, X0: {{at: 3, x: 1mm}}}}}}"
    )
    matrix = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    truth = body(matrix, 4 * math.sin(math.pi / 2 / (n + 1)) ** 2, f, t60, 3)
    assert error_db(rendered(module, "m.5", GLIDE), truth[5]) <= -60.0


@pytest.mark.slow
def test_plate_pitch_glide_error():
    across, up, f, t60 = 5, 4, 110.0, 2.0
    module = (
        f"      m: {{PLATE: {{shape: rectangle, sides: [{across}, {up}], M: 300g, f: {f}Hz, "
        f"t60: {t60}s, X0: {{at: 6, x: 1mm}}}}}}"
    )
    matrix = laplacian(across, up)
    truth = body(matrix, np.linalg.eigvalsh(matrix)[1], f, t60, 6)
    assert error_db(rendered(module, "m.7", GLIDE), truth[7]) <= -60.0


def body(matrix: np.ndarray, lowest: float, f: float, t60: float, mass_index: int) -> np.ndarray:
    """A linear body that begins 1 mm out at one mass, and whose K go with the pitch's square.

    Its modes stay as they are, and each is by itself.
    """
    squares, shapes = np.linalg.eigh(matrix)
    modes = [
        mode(f, SIGMA / t60, square / lowest, 1e-3 * weight, N)
        for square, weight in zip(squares, shapes[mass_index], strict=True)
    ]
    return shapes @ np.array(modes)


@pytest.mark.slow
def test_decay_glide_at_constant_pitch():
    n, f = 8, 220.0
    module = (
        f"      m: {{STRING: {{masses: {n}, M: 8g, f: {f}Hz, t60: 4s, X0: {{at: 3, x: 1mm}}}}}}"
    )
    line = "{set: a.m.t60, to: 0.5s, at: 0.25s, over: 1.5s}"
    matrix = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    lowest = 4 * math.sin(math.pi / 2 / (n + 1)) ** 2

    def forces(t, x, v):
        u = min(1.0, max(0.0, (t - 0.25) / 1.5))
        sigma = SIGMA / 4.0 + (SIGMA / 0.5 - SIGMA / 4.0) * u
        square = ((2 * math.pi * f) ** 2 + sigma**2) / lowest
        return -(square * (matrix @ x) + 2 * sigma / lowest * (matrix @ v))

    x0 = np.zeros(n)
    x0[3] = 1e-3
    truth = reference(forces, x0, N)[5]
    assert error_db(rendered(module, "m.5", line), truth) <= -60.0


def test_bank_pitch_glide_of_members():
    module = "      m: {BANK: {count: 3, f: 110Hz..330Hz, t60: 3s..3s, M: 2g, X0: 1mm}}"
    pitches = [110.0, math.sqrt(110.0 * 330.0), 330.0]
    truth = np.sum([mode(f, SIGMA / 3.0, 1.0, 1e-3, N) for f in pitches], axis=0)
    assert error_db(rendered(module, "m.all", GLIDE), truth) <= -60.0


@pytest.mark.slow
def test_plate_glide_preserves_hardening():
    """Where it glides to is the plate that is written so; its q·d³ has not gone with it."""
    across, up, f, q = 4, 3, 60.0, 3e7
    module = (
        f"      m: {{PLATE: {{shape: rectangle, sides: [{across}, {up}], M: 300g, f: {f}Hz, "
        f"t60: 2s, hardening: {q:g}N/m3, X0: {{at: 5, x: 2mm}}}}}}"
    )
    matrix = laplacian(across, up)
    lowest, sigma = np.linalg.eigvalsh(matrix)[1], SIGMA / 2.0
    mass = 0.3 / (across * up)
    index = np.arange(across * up).reshape(up, across)
    a = np.concatenate([index[:, :-1].ravel(), index[:-1].ravel()])
    b = np.concatenate([index[:, 1:].ravel(), index[1:].ravel()])

    def forces(t, x, v):
        square = ((2 * math.pi * f * ratio(t)) ** 2 + sigma**2) / lowest
        result = -(square * (matrix @ x) + 2 * sigma / lowest * (matrix @ v))
        cubes = q * (x[b] - x[a]) ** 3 / mass
        np.add.at(result, a, cubes)
        np.add.at(result, b, -cubes)
        return result

    x0 = np.zeros(across * up)
    x0[5] = 2e-3
    truth = reference(forces, x0, N)[6]
    # A hardening body parts from itself at every rounding: its beginning and the glide's are held.
    half = N // 2
    assert error_db(rendered(module, "m.6", GLIDE, "{method: bm4}")[:half], truth[:half]) <= -60.0


def struck_stop(
    f: float, gap: float, z: float, growth: float, begin: float, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """A cell on a stop that presses it, or that it strikes, whose K grows: rendered at -60 dB, and
    the motion itself."""
    t60, k, m = 3.0, 500.0, 2e-3
    sigma = SIGMA / t60
    modules = (
        f"      m: {{CEL: {{M: {m}kg, f: {f}Hz, t60: {t60}s, X0: 1mm}}}}\n"
        "      s: {SOL: {X0: 0m}}\n"
        f"      c: {{BUT: {{between: [s, m], K: {k}N/m, Z: {z}Ns/m, gap: {gap}m}}}}"
    )

    def forces(t, x, v):
        stiff = k * (1.0 + (growth - 1.0) * min(1.0, max(0.0, (t - begin) / length)))
        depth = -x - gap
        push = np.where(depth > 0.0, stiff * depth - z * v, 0.0)
        return -((2 * math.pi * f) ** 2 + sigma**2) * x - 2 * sigma * v + push / m

    line = f"{{set: a.c.K, to: x{growth}, at: {begin}s, over: {length}s}}"
    return rendered(modules, "m", line), reference(forces, np.array([1e-3]), N)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gap", "z"), few([(-2e-3, 0.0), (3e-4, 0.0), (3e-4, 0.02)], [(3e-4, 0.02)])
)
def test_contact_stiffness_glide_between_frames(gap: float, z: float):
    assert error_db(*struck_stop(110.0, gap, z, 16.0, BEGIN, LENGTH)) <= -60.0


def test_contact_stiffness_glide_after_the_pilot():
    """A pilot of 0.3 s sees no change: two steps a frame keep -63 dB until then, and -33 dB over
    all."""
    begin, length = 400 * GRID / RATE, 300 * GRID / RATE
    assert error_db(*struck_stop(200.0, -1e-4, 0.0, 50.0, begin, length)) <= -60.0
