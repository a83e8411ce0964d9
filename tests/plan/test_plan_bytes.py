"""A plan's bytes: whatever threads, blocks, moments and machines it is played by."""

import hashlib
import sys
from functools import cache
from typing import Any

import numpy as np
import pytest
from fresh import PLAIN_GLIBC, digest, disabled
from oracle import bodies
from oracle.core import play
from oracle.scene import Scene
from oracle.scenes import complete_scene
from sweep import few

from ergon import _core

RATE = 44100.0
N = 11025
WISHES: list[dict[str, Any]] = [{}, {"method": "modal"}, {"error_db": -60.0}]
SCRIPT = """
import sys
from tests.plan.test_plan_bytes import told
print(*told(block=int(sys.argv[1]), threads=int(sys.argv[2])))
"""


def orchestra() -> Scene:
    """All that `whole` has, three strings of their own, and two that hammers meet."""
    scene = complete_scene(0.25)
    for i in range(3):
        scene.part(f"wire{i}")
        mats = bodies.string(scene, "w", masses=24 + i, M=4e-3, f=147.0 * 1.2**i, t60=1.5)
        scene.strike(mats[3], 0.01 + 0.0371 * i, impulse=2e-5)
        scene.strike(mats[9], 0.15 - 0.0213 * i, impulse=1e-5)
        scene.listen(f"wire{i}", positions=[(mats[17], 1.0)])
    for i in range(2):
        scene.part(f"piano{i}")
        mats = bodies.string(scene, "s", masses=20, M=4e-3, f=98.0 * 1.3**i, t60=1.5)
        head = scene.mas("h", M=4e-3, X0=-1e-3, V0=0.4 + 0.1 * i)
        scene.but("b", head, mats[4], K=2e4, Z=0.1)
        scene.listen(f"piano{i}", positions=[(mats[15], 1.0)])
    return scene


@cache
def planned(**wishes: Any) -> tuple[_core.Network, _core.Timeline, _core.Plan]:
    network, timeline = orchestra().build(_core, RATE)
    return network, timeline, _core.Plan(network, timeline, **wishes)


def simulation(threads: int = 1, **wishes: Any) -> _core.Simulation:
    network, timeline, made = planned(**wishes)
    return _core.Simulation(network, timeline, plan=made, threads=threads)


def digest_and_sound(block: int, threads: int) -> tuple[str, bool]:
    """A hash of the sound and of the plan, and whether there is a sound."""
    out = play(simulation(threads, error_db=-60.0), N, block)
    built = planned(error_db=-60.0)[-1]
    rows = [(r.parts, r.what, r.modes, r.left_out_db, r.cost) for r in built.rows()]
    known = repr(rows) + built.hash
    sha256 = hashlib.sha256(out.tobytes() + known.encode()).hexdigest()
    return sha256, bool(np.abs(out).max() > 0.0)


def test_plan_scene_contains_all_row_kinds():
    assert {row.what for row in planned()[-1].rows()} == {"modes", "oscillators", "stepped"}


@pytest.mark.parametrize("wishes", few(WISHES, 1), ids=str)
def test_plan_bytes_with_threads_and_blocks(wishes: dict[str, Any]):
    sound = play(simulation(**wishes), N)
    assert (np.abs(sound).max(axis=0) > 0.0).all()
    for threads, block in ((1, 1), (1, 64), (2, 0), (2, 64), (2, 997), (7, 5000)):
        again = play(simulation(threads, **wishes), N, block)
        assert again.tobytes() == sound.tobytes(), (threads, block)


@pytest.mark.parametrize("wishes", WISHES, ids=str)
@pytest.mark.parametrize("first", [1, 255, 1000, 4099])
def test_plan_bytes_after_restored_snapshot(first: int, wishes: dict[str, Any]):
    """Also in another simulation of the same plan, and played by more threads in other blocks."""
    sim = simulation(**wishes)
    play(sim, first, 64)
    saved = sim.snapshot()
    then = play(sim, 3000)
    sim.restore(saved)
    assert sim.frame == first
    assert play(sim, 3000, 997).tobytes() == then.tobytes()
    other = simulation(**wishes)
    play(other, 77)
    other.restore(saved)
    assert play(other, 3000, 1).tobytes() == then.tobytes()


@pytest.fixture(scope="module")
def reference() -> str:
    return digest_and_sound(N, 1)[0]


@pytest.mark.slow
def test_plan_bytes_in_fresh_interpreter(reference: str):
    assert digest(SCRIPT, "997", "2") == reference


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="GLIBC_TUNABLES is glibc's")
def test_plan_bytes_without_libc_vector_instructions(reference: str):
    assert digest(SCRIPT, "997", "1", GLIBC_TUNABLES=PLAIN_GLIBC) == reference


@pytest.mark.slow
def test_plan_bytes_without_numpy_vector_instructions(reference: str):
    assert digest(SCRIPT, "64", "2", NPY_DISABLE_CPU_FEATURES=disabled()) == reference
