"""What no output hears and what nothing moves is not computed, and no byte of the rest tells."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from oracle import bodies
from oracle.core import play, render
from oracle.planned import plan
from oracle.planned import render as planned
from oracle.scene import Mat, Scene
from sweep import few

from ergon import _core

RATE = 44100.0
N = 6000
WISHES: list[dict[str, Any]] = [{}, {"method": "modal"}, {"method": "ca"}, {"error_db": -60.0}]


def add_played_bodies(scene: Scene) -> None:
    """A key that plays a string, a bell beside it, a drop on a wire, and a few cells."""
    scene.part("k1")
    key = scene.cel("m", M=0.4, K=60.0, Z=1.2)
    scene.part("string")
    mats = bodies.string(scene, "s", masses=20, M=8e-3, f=110.0, t60=3.0)
    scene.part("wire")
    wire = bodies.string(scene, "w", masses=12, M=4e-3, f=147.0, t60=2.0, stiffness=0.01)
    scene.part("cells")
    cells = [scene.cel(f"c{i}", M=1e-3, f=300.0 * 1.3**i, t60=0.6) for i in range(5)]
    scene.part("links")
    scene.but("felt", key, mats[6], K=3e4, Z=0.05, gap=1e-3)
    scene.listen("string", positions=[(mats[15], 1.0), (wire[3], 0.5)])
    scene.listen("cells", positions=[(mat, 1.0) for mat in cells])
    hand = scene.key("k1", key)
    scene.gesture(hand, [0.0, 0.04, 0.1], [0.0, 4e-3, 0.0], ["smooth"] * 3)
    scene.strike(wire[7], 0.02, impulse=1e-4)
    for i, mat in enumerate(cells):
        scene.strike(mat, 0.0111 * (1 + i), impulse=1e-5)


def unheard(scene: Scene) -> None:
    """The same things once more, and things that only wait."""
    scene.part("k9")
    key = scene.cel("m", M=0.3, K=90.0, Z=0.8)
    scene.part("mute string")
    mats = bodies.string(scene, "s", masses=15, M=8e-3, f=123.0, t60=3.0)
    scene.part("mute bell")
    bell = scene.cel("m", M=2e-3, f=220.0, t60=2.5, X0=1e-3)
    scene.part("mute links")
    scene.but("felt", key, mats[6], K=3e4, gap=1e-3)
    scene.but("hit", key, bell, K=900.0)
    hand = scene.key("k9", key)
    scene.gesture(hand, [0.0, 0.05, 0.1], [0.0, 5e-3, 0.0], ["smooth"] * 3)
    scene.strike(mats[3], 0.01, impulse=1e-4)
    scene.part("waiting")
    a, b = scene.mas("a", M=1e-3), scene.mas("b", M=2e-3, X0=3e-3)
    scene.ref("r", a, b, K=1e3, rest=3e-3)


def both(first: Callable[[Scene], None], second: Callable[[Scene], None]) -> Scene:
    scene = Scene()
    first(scene)
    second(scene)
    return scene


@pytest.mark.parametrize("wishes", few(WISHES, [{"method": "modal"}, {"method": "ca"}]), ids=str)
def test_plan_skips_inaudible_parts_without_byte_change(wishes: dict[str, Any]):
    alone = Scene()
    add_played_bodies(alone)
    sound = planned(alone, RATE, N, **wishes)
    assert (np.abs(sound).max(axis=0) > 1e-6).all()
    for scene in (both(add_played_bodies, unheard), both(unheard, add_played_bodies)):
        assert planned(scene, RATE, N, **wishes).tobytes() == sound.tobytes()
        rows = plan(scene, RATE, **wishes).rows()
        silent = {" + ".join(row.parts): row for row in rows if row.what in ("unheard", "still")}
        assert {row.what for row in silent.values()} == {"unheard"}
        assert sum(row.n_mat for row in silent.values()) == 15 + 1 + 1 + 2
        assert all(
            (row.cost, row.guarantee, row.modes) == (0.0, None, None) for row in silent.values()
        )
        assert sum(row.n_mat for row in rows) == len(moving(scene))


def moving(scene: Scene) -> list[int]:
    return [i for i, point in enumerate(scene.mats) if np.isfinite(point.M)]


@pytest.mark.parametrize("wishes", WISHES, ids=str)
def test_plan_computes_parts_audible_through_others(wishes: dict[str, Any]):
    """A chain from the key to the ear: nothing of it may be missing, however it is joined."""
    scene = Scene()
    scene.part("a")
    first = scene.mas("m", M=1e-2, V0=0.5)
    scene.part("b")
    second = scene.cel("m", M=1e-2, f=80.0, t60=1.0)
    third = scene.mas("n", M=1e-3)
    last = scene.cel("o", M=1e-3, f=200.0, t60=1.0)
    scene.but("hit", first, second, K=1e3, gap=1e-3)
    scene.ref("r", second, third, K=50.0)
    scene.ref("q", third, last, K=20.0)
    scene.listen("o", positions=[(last, 1.0)])
    rows = plan(scene, RATE, **wishes).rows()
    assert sum(row.n_mat for row in rows if row.what not in ("unheard", "still")) == 4
    ours, plain = planned(scene, RATE, N, **wishes), render(scene, RATE, N)
    assert np.abs(ours - plain).max() < 0.02 * np.abs(plain).max()


# --- what nothing moves -------------------------------------------------------------------------


def still(scene: Scene) -> list[Mat]:
    """At rest off zero: a point, a cell where it rests, masses that a spring holds apart."""
    scene.part("still")
    point = scene.sol("s", X0=2e-3)
    cell = scene.cel("c", M=1e-3, f=330.0, X0=-7e-3, rest=-7e-3)
    a, b = scene.mas("a", M=1e-3), scene.mas("b", M=2e-3, X0=3e-3)
    scene.ref("r", a, b, K=1e3, rest=3e-3)
    return [point, cell, a, b]


@pytest.mark.slow
@pytest.mark.parametrize("wishes", few(WISHES, WISHES[:1]), ids=str)
def test_plan_includes_position_of_resting_part(wishes: dict[str, Any]):
    alone, scene = Scene(), Scene()
    add_played_bodies(alone)
    add_played_bodies(scene)
    point, cell, a, b = still(scene)
    other = scene.sol("t", X0=5e-3)
    pressed = scene.ref("p", point, other, K=200.0)
    between = scene.mas("u", M=1e-3)
    scene.ref("l", between, point, K=500.0)
    held = scene.ref("r", between, scene.sol("w", X0=-2e-3), K=500.0)
    scene.listen("stands", positions=[(point, 1.0), (cell, 2.0), (a, 1.0), (b, -1.0)])
    scene.listen("presses", forces=[(pressed, 1.0), (held, 1.0)], ground_forces=[(cell, 1.0)])
    rows = {row.what: row for row in plan(scene, RATE, **wishes).rows() if "still" in row.parts}
    assert set(rows) == {"still"}
    out = planned(scene, RATE, N, **wishes)
    assert out[:, :2].tobytes() == planned(alone, RATE, N, **wishes).tobytes()
    assert out[:, 2] == pytest.approx(2e-3 - 14e-3 - 3e-3, abs=1e-17)
    assert out[:, 3] == pytest.approx(render(scene, RATE, 1)[0, 3])
    assert abs(out[0, 3]) == pytest.approx(500.0 * 2e-3 - 200.0 * 3e-3)


@pytest.mark.parametrize("wishes", WISHES, ids=str)
def test_plan_computes_timed_coupling_force(wishes: dict[str, Any]):
    network = _core.Network()
    network.part("p")
    link = network.ref("r", network.sol("a"), network.sol("b", X0=3e-3), K=200.0)
    network.listen("f", forces=[(link, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.couple(link, 0.05, 0.1)
    result = _core.Plan(network, timeline, **wishes)
    planned = play(_core.Simulation(network, timeline, plan=result), N)[:, 0]
    assert planned.tobytes() == play(_core.Simulation(network, timeline), N)[:, 0].tobytes()
    assert (planned[0], planned[-1]) == (0.0, 0.0)
    assert abs(planned[int(0.08 * RATE)]) == pytest.approx(0.6)


@pytest.mark.parametrize("wishes", WISHES, ids=str)
@pytest.mark.parametrize(
    "how", ["struck", "flying", "bent", "stretched", "pulled along", "pushed", "met"]
)
def test_plan_computes_part_moved_by_any_cause(how: str, wishes: dict[str, Any]):
    scene = Scene()
    scene.part("p")
    flies, bent = how == "flying", 1e-3 * (how == "bent")
    a = scene.cel("a", M=1e-3, f=330.0, t60=1.0, V0=0.1 * flies, X0=bent)
    b = scene.cel("b", M=2e-3, f=200.0, t60=1.0)
    scene.ref("r", a, b, K=1e3, rest=1e-3 * (how == "stretched"))
    scene.listen("b", positions=[(b, 1.0)])
    if how == "struck":
        scene.strike(a, 0.01, impulse=1e-4)
    if how == "met":
        scene.strike(a, 0.01, mass=1e-3, speed=0.5)
    if how == "pushed":
        scene.drive(a, "force", constant=0.1)
    if how == "pulled along":
        hand = scene.sol("h")
        scene.ref("q", hand, a, K=100.0)
        scene.drive(hand, "position", constant=1e-3)
    rows = plan(scene, RATE, **wishes).rows()
    assert "still" not in {row.what for row in rows}
    ours, plain = planned(scene, RATE, N, **wishes), render(scene, RATE, N)
    assert np.abs(plain).max() > 1e-6
    assert np.abs(ours - plain).max() < 0.2 * np.abs(plain).max()
