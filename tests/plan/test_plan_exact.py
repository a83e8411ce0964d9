"""Plans by modes against the continuous motion: what is linear is exact, struck when it may be."""

from itertools import pairwise

import numpy as np
import pytest
from oracle import bodies, modes
from oracle.core import render
from oracle.planned import error_db, how, plan
from oracle.planned import render as planned
from oracle.scene import Mat, Scene
from sweep import few

RATE = 44100.0
N = 11025
EXACT_DB = -200.0


def taps(scene: Scene, mats: list[Mat], *held: Mat) -> None:
    """One point; a weighted sum; all of them beside each other, and what is held."""
    scene.listen("one", positions=[(mats[2], 1.0)])
    scene.listen("two", positions=[(mats[1], 0.5), (mats[-2], -2.0)])
    every = [(mat, 1.0 / (1 + i)) for i, mat in enumerate(mats)]
    scene.listen("all", positions=[*every, *((mat, 3.0) for mat in held)])


def strikes(scene: Scene, mats: list[Mat]) -> None:
    """Between frames, on one, just before one, two in one frame, one on what has been struck."""
    when = (0.0, 0.013579, 100.999999 / RATE, 0.05000011, 0.05000013, 0.1234567, 0.2)
    for i, index in enumerate(when):
        scene.strike(mats[(3 * i + 1) % len(mats)], index, impulse=1e-4 * (-1) ** i * (1 + i % 3))
    scene.strike(mats[1], 0.0987, impulse=3e-4)


def displace(scene: Scene, mats: list[Mat]) -> None:
    """Drawn aside near one end; two masses fly."""
    for i, mat in enumerate(mats):
        share = (i + 1) / (len(mats) + 1)
        scene.start(mat, 1e-3 * min(share / 0.2, (1.0 - share) / 0.8), 0.3 * (i in (2, 5)))


def string(ends: str = "fixed", stiffness: float = 0.0, t60: float | None = 2.0) -> Scene:
    scene = Scene()
    scene.part("string")
    mats = bodies.string(
        scene, "s", masses=40, M=8e-3, f=110.0, t60=t60, ends=ends, stiffness=stiffness
    )
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats)
    return scene


def net(alpha: float = 0.0, beta: float = 1e-6) -> Scene:
    """Masses of all sizes in a net with chords, tied, rests and ends off zero, in two parts.

    Z = αM + βK of everything; with α there is no MAS, which has no damping of its own.
    """
    rng = np.random.default_rng(5)
    scene = Scene()
    mats: list[Mat] = []
    for part in ("left", "right"):
        scene.part(part)
        for i in range(9):
            M, K = 10 ** rng.uniform(-3, -2), 10 ** rng.uniform(2, 4)
            if i % 3 and not alpha:
                mats.append(scene.mas(f"m{i}", M=M))
            else:
                mats.append(scene.cel(f"m{i}", M=M, K=K, Z=alpha * M + beta * K, rest=1e-4 * i))
    low, high = scene.sol("low", X0=-4e-4), scene.sol("high", X0=7e-4)
    points = [low, *mats, high]
    for j in range(3 * len(mats)):
        a, b = (j, j + 1) if j < len(points) - 1 else rng.choice(len(points), 2, replace=False)
        K, rest = 10 ** rng.uniform(2, 4.5), rng.normal() * 1e-4
        scene.ref(f"l{j}", points[a], points[b], K=K, Z=beta * K, rest=rest)
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats, low, high)
    return scene


def cells() -> Scene:
    """Nothing joins them: light and heavy, high and slow, one too damped to swing, one undamped."""
    scene = Scene()
    scene.part("sky")
    mats = [
        scene.cel(f"c{i}", M=1e-3, f=110.0 * 1.7**i, t60=2.0 / (1 + i), rest=1e-5 * i)
        for i in range(9)
    ]
    mats.append(scene.cel("creeps", M=0.1, K=1e4, Z=500.0, rest=2e-4))
    mats.append(scene.cel("endless", M=2e-3, K=3e4))
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats)
    scene.listen("ground", ground_forces=[(mat, 1.0 / (1 + i)) for i, mat in enumerate(mats)])
    return scene


def floating() -> Scene:
    """A string that nothing holds but a spring to a point off zero, as damped as the string."""
    scene = Scene()
    scene.part("string")
    mats = bodies.string(scene, "s", masses=24, M=8e-3, f=110.0, t60=2.0, ends="free")
    link = scene.lias[-1]
    scene.ref("tie", mats[7], scene.sol("wall", X0=2e-3), K=300.0, Z=300.0 * link.Z / link.K)
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats)
    return scene


MODES, CELLS = "modes", "oscillators"
SCENES = {
    "string": (string, MODES),
    "string, stiff": (lambda: string(stiffness=0.02), MODES),
    "string, one end": (lambda: string("left", stiffness=0.05), MODES),
    "string, endless": (lambda: string(t60=None), MODES),
    "string, floating": (floating, MODES),
    "net": (net, MODES),
    "net of cells": (lambda: net(3.0), MODES),
    "net, undamped": (lambda: net(beta=0.0), MODES),
    "cells": (cells, CELLS),
}


@pytest.mark.parametrize("name", few(SCENES, 4))
def test_plan_exact_for_linear_scenes(name: str):
    make, what = SCENES[name]
    scene = make()
    rows = plan(scene, RATE, method="modal").rows()
    assert {row.what for row in rows if row.what != "still"} == {what}
    truth = modes.outputs(scene, modes.exact(scene, RATE, N))
    assert error_db(planned(scene, RATE, N, method="modal"), truth) < EXACT_DB
    if what == MODES:  # not that anything would do: the plain scheme is far off
        assert error_db(render(scene, RATE, N), truth) > -65.0


@pytest.mark.parametrize("rate", [11025.0, 96000.0])
def test_plan_exact_at_any_rate(rate: float):
    """At 11 kHz the scheme would not even be stable."""
    scene = string(stiffness=0.02)
    scene.part("more")
    high = scene.cel("high", M=1e-3, K=1e-3 * (2.0 * np.pi * 7e3) ** 2, X0=1e-3)
    scene.ref("r", high, scene.sol("g"), K=1e6)
    scene.listen("high", positions=[(high, 1.0)])
    truth = modes.outputs(scene, modes.exact(scene, rate, N))
    assert error_db(planned(scene, rate, N, method="modal"), truth) < EXACT_DB


def test_plan_exact_for_body_in_ca_units():
    """There the scheme is the truth, and strikes fall on frames."""
    scene = Scene()
    scene.part("old", ca_rate=RATE)
    mats = [scene.cel(f"m{i}", M=1.0 + i, K=1e-2 * i, Z=1e-5 * (1 + i)) for i in range(12)]
    for i, (a, b) in enumerate(pairwise(mats)):
        scene.ref(f"l{i}", a, b, K=0.1 * (1 + i % 3))
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats)
    assert how(scene, RATE, method="modal") == [("old", "modes")]
    assert error_db(planned(scene, RATE, N, method="modal"), render(scene, RATE, N)) < EXACT_DB


def test_plan_exact_for_body_beside_open_contact():
    """Cut out of its island, seen from where a hammer might have struck it."""
    alone, scene = string(stiffness=0.02), string(stiffness=0.02)
    mats = [Mat(i) for i in range(40)]
    scene.part("hammer")
    hammer = scene.cel("m", M=8e-3, K=60.0, Z=0.1, V0=0.1)
    scene.but("b", hammer, mats[5], K=1e4, gap=1.0)
    scene.ref("air", hammer, scene.sol("wall"), K=10.0)
    rows = plan(scene, RATE, method="modal").rows()
    assert [(row.what, row.n_mat) for row in rows] == [("stepped", 1), ("modes", 40)]
    truth = modes.outputs(alone, modes.exact(alone, RATE, N))
    assert error_db(planned(scene, RATE, N, method="modal"), truth) < EXACT_DB


def test_plan_exact_strikes_on_cell_beside_contact():
    """Though it is stepped: what a contact does is added to a motion that is its own."""
    alone, scene = Scene(), Scene()
    for item in (alone, scene):
        item.part("bell")
        bell = item.cel("m", M=0.011, f=1473.0, t60=0.16)
        strikes(item, [bell, bell])
        item.listen("o", positions=[(bell, 1.0)])
    hammer = scene.cel("h", M=2e-3, K=10.0, V0=0.01)
    scene.but("b", hammer, bell, K=1e4, gap=1.0)
    assert how(scene, RATE, error_db=-60.0) == [("bell", "stepped")]
    truth = modes.outputs(alone, modes.exact(alone, RATE, N))
    assert error_db(planned(scene, RATE, N, error_db=-60.0), truth) < EXACT_DB


@pytest.mark.parametrize("change", ["free", "damped"])
def test_free_and_damped_bodies_use_complex_modes(change: str):
    """Nothing holds it, or a damper couples the modes that it has without."""
    scene = string("free" if change == "free" else "fixed")
    if change == "damped":
        scene.ref("r", Mat(3), scene.sol("wall"), K=10.0, Z=1.0)
    (row,) = plan(scene, RATE, method="modal").rows()
    assert (row.what, row.because) == ("complex modes", None)


def test_plan_steps_network_without_modes():
    """A discrete network that is the truth, damped at one point: its own steps, to the last bit."""
    scene = Scene()
    scene.part("old", ca_rate=RATE)
    mats = [scene.cel(f"m{i}", M=1.0 + i, K=1e-2 * i, Z=1e-5 * (1 + i)) for i in range(12)]
    for i, (a, b) in enumerate(pairwise(mats)):
        scene.ref(f"l{i}", a, b, K=0.1 * (1 + i % 3), Z=1e-3 * (i == 4))
    displace(scene, mats)
    strikes(scene, mats)
    taps(scene, mats)
    (row,) = plan(scene, RATE, method="modal").rows()
    assert row.what == "stepped"
    assert "proportional" in (row.because or "")
    assert np.array_equal(planned(scene, RATE, 2000, method="modal"), render(scene, RATE, 2000))
