"""A whole scene and its parts' meetings: the core against the oracle, block by block."""

import numpy as np
import pytest
from oracle import linear
from oracle.core import deviation, play, simulation
from oracle.engine import simulate
from oracle.scene import Scene
from oracle.scenes import complete_scene

from ergon import _core

RATE = 44100.0


def test_complete_scene_agrees_with_oracle():
    assert deviation(complete_scene(), RATE, 44100) < 1e-12


@pytest.mark.parametrize("block", [1, 64, 997])
def test_complete_scene_independent_of_block_size(block: int):
    reference = play(simulation(complete_scene(0.3), RATE), 12_000)
    assert (
        play(simulation(complete_scene(0.3), RATE), 12_000, block).tobytes() == reference.tobytes()
    )


@pytest.mark.parametrize("snapshot_frame", [1, 6_400, 7_777])
def test_complete_scene_restored_from_snapshot(snapshot_frame: int):
    """In the middle of gestures, contacts and strikes; restored into another simulation, too."""
    sim = simulation(complete_scene(0.5), RATE, ledger=True)
    play(sim, snapshot_frame)
    saved = sim.snapshot()
    rest, energy = play(sim, 8_000), sim.energy()
    sim.restore(saved)
    assert play(sim, 8_000).tobytes() == rest.tobytes()
    assert sim.energy().stored == energy.stored
    assert sim.energy().flow == energy.flow
    other = simulation(complete_scene(0.5), RATE, ledger=True)
    other.restore(saved)
    assert play(other, 8_000).tobytes() == rest.tobytes()


def test_scene_frame_zero_is_initial_state():
    scene = Scene()
    scene.part("p")
    a = scene.mas("a", M=1e-3, X0=1e-3, V0=5.0)
    b = scene.cel("b", M=1e-3, f=500.0, t60=1.0, X0=-2e-3, V0=-1.0, rest=1e-4)
    link = scene.ref("r", a, b, K=100.0)
    scene.listen("a", positions=[(a, 1.0)])
    scene.listen("b", positions=[(b, 1.0)])
    scene.listen("f", forces=[(link, 1.0)])
    sim = simulation(scene, RATE)
    assert sim.frame == 0
    assert sim.positions() == pytest.approx([1e-3, -2e-3], abs=0.0)
    first = play(sim, 1)[0]
    assert first == pytest.approx([1e-3, -2e-3, 0.3], rel=1e-14)
    assert sim.frame == 1


def test_linked_cell_start_converges_with_order_two():
    """Against the matrix exponential; without the links' half step these are 6 dB a halving."""
    scene = Scene()
    scene.part("p")
    a = scene.cel("a", M=2e-3, f=440.0)
    b = scene.mas("b", M=3e-3, X0=1e-3)
    scene.ref("ab", a, b, K=2e3)
    scene.listen("a", positions=[(a, 1.0)])
    errors = []
    for rate in (RATE, 2 * RATE, 4 * RATE):
        n = int(rate * 0.1)
        truth = linear.exact(scene, rate, n)[:, [a]]
        out = play(simulation(scene, rate), n)
        errors.append(20.0 * np.log10(np.linalg.norm(out - truth) / np.linalg.norm(truth)))
    assert 11.5 < errors[0] - errors[1] < 12.5
    assert 11.5 < errors[1] - errors[2] < 12.5


def test_weight_and_imposed_points_agree_with_the_oracle():
    scene = Scene()
    scene.part("p")
    hung = scene.mas("hung", M=5e-3, X0=1e-3)
    hook = scene.sol("hook")
    heavy = scene.cel("heavy", M=2e-2, K=500.0, Z=0.1)
    scene.ref("r", hook, hung, K=300.0, Z=0.05, rest=-1e-2)
    scene.but("b", hung, heavy, K=2e3, Z=0.1, gap=-2e-2)
    scene.listen("hung", positions=[(hung, 1.0)])
    scene.listen("heavy", positions=[(heavy, 1.0)])
    scene.drive(hung, "force", constant=-9.81 * 5e-3)
    scene.drive(heavy, "force", constant=0.5)
    scene.drive(hook, "position", constant=2e-3)
    assert deviation(scene, RATE, 22_050) < 1e-12


def coupled(start: float | None, stop: float | None = None) -> tuple[_core.Network, _core.Timeline]:
    network = _core.Network()
    network.part("p")
    a = network.cel("a", M=2e-3, f=200.0, X0=1e-3)
    b = network.cel("b", M=2e-3, f=200.0)
    link = network.ref("r", a, b, K=300.0)
    network.listen("b", positions=[(b, 1, 1.0)])
    network.listen("f", forces=[(link, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    if start is not None:
        timeline.couple(link, start, stop)
    return network, timeline


def test_coupling_acts_only_within_its_interval():
    """Silence before; a fade of 20 ms; the link's own force within; nothing after the fade."""
    out = play(_core.Simulation(*coupled(0.1, 0.3)), 22_050)
    begin, end = int(0.1 * RATE) - 64, int(0.32 * RATE) + 128
    assert (out[:begin] == 0.0).all()
    assert np.abs(out[begin : begin + 1500, 0]).max() > 0.0
    assert np.abs(out[int(0.15 * RATE) : int(0.3 * RATE), 1]).max() > 0.01
    assert (out[end:, 1] == 0.0).all()
    assert np.abs(out[end:, 0]).max() > 1e-4
    # fading: no sample of the force jumps by more than it would at full strength
    full_force = play(_core.Simulation(*coupled(None)), 22_050)[1:, 1]
    assert np.abs(np.diff(out[:, 1])).max() < 1.5 * np.abs(np.diff(full_force)).max()


def test_network_unchanged_by_simulation():
    """Timeline and Simulation keep copies: a second one from the same network is the same."""
    scene = complete_scene(0.2)
    network, timeline = scene.build(_core, RATE)
    first = play(_core.Simulation(network, timeline), 4000)
    second = play(_core.Simulation(network, timeline), 4000)
    assert first.tobytes() == second.tobytes()
    assert np.abs(simulate(scene, RATE, 4000).out - second).max() < 1e-9
