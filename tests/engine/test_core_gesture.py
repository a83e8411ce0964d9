"""Written gestures on keys: free, tracked and leaning on an instrument."""

from typing import Any

import numpy as np
import pytest
from oracle.core import deviation, play, simulation
from oracle.gesture import path
from oracle.key import KEYS, RATE, SMOOTH, grid, lone, moved, worst
from oracle.scene import Scene

from ergon import _core


@pytest.mark.parametrize("name", KEYS)
@pytest.mark.parametrize(
    ("t", "x", "curve"),
    [
        ([0.05, 0.17, 0.31, 0.52, 0.9], [0.0, 6e-3, -3e-3, 2e-3, 0.0], SMOOTH[:5]),
        ([0.1, 0.2, 0.45, 0.7], [0.0, 6e-3, 6e-3, 1e-3], ["smooth", "smooth", "hold", "smooth"]),
        ([0.0, 0.25, 0.5, 0.8], [0.0, 4e-3, 4e-3, 0.0], ["line", "line", "hold", "line"]),
        ([0.0, 0.2, 0.21, 0.6], [0.0, 1e-3, 1.1e-3, 0.0], SMOOTH[:4]),
    ],
    ids=["smooth", "hold", "line", "crowded"],
)
def test_free_key_follows_path_at_every_sample(name: str, t: Any, x: Any, curve: Any):
    network, timeline, key = lone(**KEYS[name])
    timeline.gesture(key, t, x, curve)
    done, _ = moved(network, timeline, 1.0)
    asked = path(t, x, curve, grid(len(done)))
    assert np.isfinite(asked).sum() > 0.4 * RATE
    assert worst(done, asked) < 1e-9
    # before the first point a key at rest is not touched
    assert np.abs(done[: int(t[0] * RATE)]).max(initial=0.0) < 1e-12


def test_key_swings_free_after_last_point():
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, [0.0, 0.25], [0.0, 5e-3], SMOOTH[:2])
    done, _ = moved(network, timeline, 1.0)
    t = grid(len(done))[round(0.25 * RATE) :] - 0.25
    sigma, omega = 3.0 * np.log(10.0) / 0.6, 2.0 * np.pi * 8.0
    free = 5e-3 * np.exp(-sigma * t) * (np.cos(omega * t) + sigma / omega * np.sin(omega * t))
    # a held position becomes a free one: the discrete start differs by half a step of the spring
    assert np.abs(done[-len(t) :] - free).max() < 5e-3 * 2.0 * omega / RATE


def test_throw_gesture_meets_written_points():
    t, x = [0.1, 0.1733, 0.29, 0.35, 0.5], [0.0, 6e-3, 0.0, -4e-3, 1e-3]
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, t, x, ["throw"] * 5)
    done, sim = moved(network, timeline, 0.8, record=True)
    position = np.floor(np.array(t) * RATE + 0.5).astype(int)
    assert np.abs(done[position] - x).max() < 1e-9
    assert len(sim.ergons()["time"]) == 4


def test_throw_on_bare_mass_is_ballistic():
    network, timeline, key = lone(M=0.3)
    timeline.gesture(key, [0.1, 0.2, 0.4], [0.0, 5e-3, 1e-3], ["throw"] * 3)
    done, _ = moved(network, timeline, 0.41)
    asked = np.interp(grid(len(done)), [0.1, 0.2, 0.4], [0.0, 5e-3, 1e-3])
    assert np.abs(done - asked)[: int(0.4 * RATE)].max() < 1e-9


@pytest.mark.parametrize("grain", [1e-3, 5e-3])
def test_grain_gesture_meets_its_knots(grain: float):
    rate, t, x = 48000.0, [0.0, 0.2, 0.5], [0.0, 6e-3, 0.0]
    network, timeline, key = lone(rate, **KEYS["light"])
    timeline.gesture(key, t, x, SMOOTH[:3], grain=grain)
    done, sim = moved(network, timeline, 0.6, record=True)
    step = round(grain * rate)
    asked = path(t, x, SMOOTH[:3], grid(len(done), rate))
    knots = np.arange(0, int(0.5 * rate) + 1, step)
    assert np.abs(done[knots] - asked[knots]).max() < 1e-9
    between = np.setdiff1d(np.arange(int(0.5 * rate)), knots)
    assert np.abs(done[between] - asked[between]).max() > 1e-9  # ballistic between
    assert abs(len(sim.ergons()["time"]) - len(knots)) <= 2


def test_grain_longer_than_quarter_period_is_refused():
    def build(grain: float) -> None:
        network, timeline, key = lone(**KEYS["light"])
        timeline.gesture(key, [0.0, 0.5], [0.0, 5e-3], SMOOTH[:2], grain=grain)
        _core.Simulation(network, timeline)

    build(0.02)
    with pytest.raises(_core.EngineError):
        build(0.04)


def bell_scene(touch: str, **but: float) -> Scene:
    """A key that meets a bell at 1 mm and leans on it."""
    scene = Scene()
    scene.part("k")
    hand = scene.cel("m", M=0.4, K=60.0, Z=1.2)
    scene.part("bell")
    bell = scene.cel("m", M=2e-3, f=220.0, t60=2.5)
    contact = scene.but("b", hand, bell, gap=1e-3, **but)
    scene.listen("key", positions=[(hand, 1.0)])
    scene.listen("bell", positions=[(bell, 1.0)])
    scene.listen("f", forces=[(contact, 1.0)])
    key = scene.key("k", hand)
    t = [0.0, 0.12, 0.25, 0.5, 0.62]  # on the grid of samples
    scene.gesture(key, t, [0.0, 6e-3, 0.0, 1.5e-3, 0.0], SMOOTH[:5], touch=touch)
    return scene


@pytest.mark.parametrize("touch", ["open", "tracked"])
def test_key_on_bell_agrees_with_oracle(touch: str):
    assert deviation(bell_scene(touch, K=900.0, Z=0.1), RATE, 30_000) < 1e-11


def test_tracked_key_follows_path_against_stiff_instrument():
    scene = bell_scene("tracked", K=1e6, Z=1.0)
    sim = simulation(scene, RATE)
    out = play(sim, 30_000)
    gesture = scene.gestures[0]
    asked = path(gesture.t, gesture.x, gesture.curve, grid(30_000))
    assert out[:, 2].max() > 10.0  # newtons: the instrument does push
    assert worst(out[:, 0], asked) < 1e-9
    assert sim.reports()[0].worst < 1e-9


def test_open_key_deviation_report_against_instrument():
    scene = bell_scene("open", K=1e5, Z=1.0)
    sim = simulation(scene, RATE)
    out = play(sim, 30_000)
    gesture = scene.gestures[0]
    asked = path(gesture.t, gesture.x, gesture.curve, grid(30_000))
    off = np.nan_to_num(np.abs(out[:, 0] - asked))
    report = sim.reports()[0]
    assert off.max() > 1e-4
    assert report.worst == pytest.approx(off.max(), rel=1e-6)
    assert report.worst_at == pytest.approx(off.argmax() / RATE, abs=1.5 / RATE)
    assert report.rms == pytest.approx(np.sqrt((off[: int(0.62 * RATE)] ** 2).mean()), rel=1e-2)
    assert (report.start, report.stop) == pytest.approx((0.0, 0.62), abs=2.0 / RATE)


def test_tracked_key_ergons_equal_forces():
    """Impulse·rate against the bell's push and the key's own law, from the outputs."""
    scene = bell_scene("tracked", K=1e5, Z=1.0)
    sim = simulation(scene, RATE, record=True)
    out = play(sim, 30_000)
    record = sim.ergons()
    kappa, zeta = cell_of(60.0, 1.2, 0.4)
    for t, impulse in list(zip(record["time"], record["impulse"], strict=True))[100:20_000:997]:
        n = round(t * RATE)
        x = out[n - 1 : n + 2, 0]
        single = 0.4 * RATE**2 * (x[2] - (2 - kappa - zeta) * x[1] + (1 - zeta) * x[0])
        assert impulse * RATE == pytest.approx(single + out[n, 2], abs=1e-6)


def cell_of(K: float, Z: float, M: float) -> tuple[float, float]:
    sigma = Z / (2.0 * M)
    omega, s = np.sqrt(K / M - sigma**2), sigma / RATE
    kappa = np.expm1(-s) ** 2 + 4.0 * np.exp(-s) * np.sin(omega / (2.0 * RATE)) ** 2
    return float(kappa), float(-np.expm1(-2.0 * s))


def test_grain_instants_and_written_points():
    """5 ms are 220.5 frames: the k-th strike falls on round(k·220.5), not on k times 221."""
    network, timeline, key = lone(**KEYS["placeholder"])
    t, x = [0.0, 1.0, 2.0], [0.0, 3e-3, 1e-3]
    timeline.gesture(key, t, x, SMOOTH[:3], grain=5e-3)
    out, sim = moved(network, timeline, 2.1, record=True)
    struck = np.rint(sim.ergons()["time"] * RATE).astype(int)
    due = (np.arange(401) * 441 + 1) // 2
    assert struck.tolist() == due[:400].tolist()
    asked = path(t, x, SMOOTH[:3], grid(len(out)))
    assert np.abs(out[due] - asked[due]).max() < 1e-9


def test_asked_position_of_gesture_and_layers():
    network, timeline, key = lone(**KEYS["placeholder"])
    timeline.gesture(key, [0.0, 1.0, 2.0], [0.0, 3e-3, 0.0], SMOOTH[:3])
    timeline.gesture(key, [0.5, 1.0, 1.5], [0.0, 1e-3, 0.0], SMOOTH[:3], layer=True)
    _, sim = moved(network, timeline, 1.0)
    assert sim.asked()[0] == pytest.approx(4e-3, abs=1e-9)
    assert sim.positions()[0] == pytest.approx(4e-3, abs=1e-9)
    assert sim.reports()[0].worst < 1e-9


def test_free_key_with_exact_contact_inside():
    """The key's own damper stops are part of the free key that the ergons are computed for."""
    network = _core.Network()
    network.part("k")
    struck = network.cel("m", M=0.08, f=8.0, t60=0.6)
    stop = network.cel("stop", M=0.08, f=8.0, t60=0.6)
    network.but("b", struck, stop, K=1e9, gap=1e-3, contact="exact")
    network.listen("x", positions=[(struck, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.gesture(timeline.key("k", struck), [0.0, 0.2], [0.0, 5e-3], SMOOTH[:2])
    sim = _core.Simulation(network, timeline)
    out = play(sim, int(0.2 * RATE))
    asked = path([0.0, 0.2], [0.0, 5e-3], SMOOTH[:2], grid(len(out)))
    assert worst(out[:, 0], asked) < 1e-9
