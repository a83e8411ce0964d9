"""A part that goes non-finite: named and stopped, or muted alone while all else goes on."""

import math

import numpy as np
import pytest
from oracle import laws
from oracle.core import play, simulation
from oracle.engine import simulate
from oracle.scene import Scene

from ergon import _core

RATE = 44100.0
# Speeds of a strike [m/s]: the scheme diverges by the first, eight steps a frame by the other too.
HARD, TOO_HARD = 1e3, 3e4


def doomed(speed: float) -> Scene:
    """A hard cubic spring, stable at rest: fast enough, it leaves the stable range and diverges."""
    scene = Scene()
    scene.part("good")
    for i in range(5):
        mat = scene.cel(f"m{i}", M=2e-3, f=220.0 * (i + 1), t60=2.0, X0=1e-4 * (i + 1))
        scene.listen(f"g{i}", positions=[(mat, 1.0)])
    scene.part("bad")
    a = scene.cel("a", M=1e-3, f=300.0, t60=1.0)
    b = scene.mas("b", M=1e-3)
    scene.lnl("l", a, b, laws.make("cubic", k=500.0, q=1e10, z=0.0))
    scene.listen("bad", positions=[(b, 1.0)])
    scene.strike(b, 1000 / RATE, impulse=1e-3 * speed)
    return scene


def fall() -> int:
    """First frame at which the oracle's part is not finite."""
    out = simulate(doomed(TOO_HARD), RATE, 4000).out
    return int(np.flatnonzero(~np.isfinite(out[:, -1]))[0])


@pytest.mark.slow
def test_fault_scene_diverges_only_after_hard_strike():
    assert np.isfinite(simulate(doomed(0.1), RATE, 4000).out).all()
    assert 1000 < fall() < 3000
    simulation(doomed(TOO_HARD), RATE)  # certified: what is wrong comes by the strike


def test_diverging_part_computed_finer():
    assert not np.isfinite(simulate(doomed(HARD), RATE, 4000).out).all()
    sim = simulation(doomed(HARD), RATE)
    out = play(sim, 4000)
    assert np.isfinite(out).all()
    ((name, frames, limit),) = sim.finer()
    assert name == "bad"
    assert 0 < frames <= 3000
    assert limit in (2, 4, 8)
    healthy = simulation(doomed(0.0), RATE)
    assert out[:, :5].tobytes() == play(healthy, 4000)[:, :5].tobytes()
    assert healthy.finer() == []
    # The mass swings on the spring that it is on, as far as the strike's energy takes it.
    truth = play(simulation(doomed(HARD), 8 * RATE), 32_000)[::8, 5]
    assert np.abs(out[:, 5]).max() == pytest.approx(np.abs(truth).max(), rel=0.1)


def test_diverged_error_names_part_and_frame():
    sim = simulation(doomed(TOO_HARD), RATE)
    with pytest.raises(_core.DivergedError) as error:
        play(sim, 4000)
    assert error.value.module is not None
    assert error.value.module.startswith("bad.")
    # eight steps a frame hold it a little longer
    assert abs(error.value.frame - fall()) <= 8
    assert "bad." in str(error.value)


@pytest.mark.parametrize("block", [1, 64, 4000])
def test_diverged_frame_independent_of_block_size(block: int):
    result = []
    for size in (block, 997):
        with pytest.raises(_core.DivergedError) as error:
            play(simulation(doomed(TOO_HARD), RATE), 4000, size)
        result.append((error.value.frame, error.value.module))
    assert result[0] == result[1]


def test_muted_part_changes_no_other_part():
    healthy = play(simulation(doomed(0.0), RATE), 8000)
    sim = simulation(doomed(TOO_HARD), RATE, on_fault="mute")
    out = play(sim, 8000)
    assert np.isfinite(out).all()
    assert out[:, :5].tobytes() == healthy[:, :5].tobytes()
    ((name, frame),) = sim.muted()
    assert name == "bad"
    assert abs(frame - fall()) <= 8


def test_muted_part_silent_within_5_ms():
    sim = simulation(doomed(TOO_HARD), RATE, on_fault="mute")
    out = play(sim, 8000)[:, 5]
    ((_, frame),) = sim.muted()
    fade = math.ceil(0.005 * RATE)
    assert (out[frame + fade + 1 :] == 0.0).all()
    tail = np.abs(out[frame : frame + fade])
    assert (np.diff(tail) <= 0.0).all()
    assert tail[0] > tail[fade // 2] > 0.0


def test_muting_independent_of_block_size():
    bytes_of = []
    for block in (1, 64, 997, 8000):
        sim = simulation(doomed(TOO_HARD), RATE, on_fault="mute")
        bytes_of.append((play(sim, 8000, block).tobytes(), sim.muted()))
    assert all(found == bytes_of[0] for found in bytes_of)


def test_mute_on_fault_of_healthy_scene():
    sim = simulation(doomed(0.1), RATE, on_fault="mute")
    play(sim, 4000)
    assert sim.muted() == []


def led_links(*, beside_runaway: bool) -> tuple[np.ndarray, list[_core.MutedPart]]:
    """Two led links; then a part that a strike drives beyond all bounds, and a link that makes all
    one island but is too weak to be noticed."""
    network = _core.Network()
    network.part("bad")
    a = network.cel("a", M=1e-3, f=30.0, t60=1.0)
    b = network.mas("b", M=1e-3)
    network.lnl("l", a, b, laws.make("cubic", k=-500.0, q=0.0, z=0.0).on(_core))
    network.part("good")
    cells = [network.cel(name, M=1e-3, f=100.0, t60=2.0, X0=1e-3) for name in "cde"]
    spring = network.ref("s", cells[0], cells[1], K=2e3, Z=0.01)
    contact = network.but("t", cells[1], cells[2], K=1e4)
    if beside_runaway:
        network.part("between")
        network.ref("j", b, cells[0], K=1e-30)
    for name, cell in zip("cde", cells, strict=True):
        network.listen(name, positions=[(cell, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    if beside_runaway:
        timeline.strike(b, 1000 / RATE, impulse=1.0)
    timeline.lead(spring, [(0.0, 1.0, 1.0), (0.2, 4.0, 1.0)])
    timeline.lead(contact, [(0.0, 1.0, 1.0), (0.2, 0.25, 1.0)])
    sim = _core.Simulation(network, timeline, on_fault="mute")
    return play(sim, 12_000), sim.muted()


def test_led_links_after_mute_of_another_part():
    healthy, muted = led_links(beside_runaway=False)
    assert muted == []
    out, muted = led_links(beside_runaway=True)
    assert [name for name, _ in muted] == ["bad"]
    assert np.abs(out - healthy).max() < 1e-12 * np.abs(healthy).max()
