"""What a hand on a key promises: joins, limits, grains, throws and particles, by closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from oracle.core import play
from oracle.gesture import path
from oracle.key import KEYS, RATE, SMOOTH, grid, lone, moved

from ergon import _core

# --- throws: the paper's ballistic gesture, near half the period of a key of 400 g ---


@pytest.mark.parametrize(
    ("t", "x", "ergons", "low", "high", "strongest"),
    [
        ([0.0, 0.125, 0.5, 0.75, 1.0], [0.0, 6.0, 0.0, -4.0, 0.0], 4, -47.1, 6.0, 0.943),
        ([0.0, 0.125, 0.375], [0.0, 12.0, 0.0], 2, 0.0, 98.6, 1.411),
    ],
)
def test_throw_swing_extremes_and_ergons(t, x, ergons, low, high, strongest):
    rate = 48_000.0  # on which these instants lie
    network, timeline, key = lone(rate, **KEYS["placeholder"])
    timeline.gesture(key, t, [1e-3 * mm for mm in x], ["throw"] * len(t))
    sim = _core.Simulation(network, timeline)
    done = play(sim, round(t[-1] * rate) + 1)[:, 0]
    report = sim.reports()[0]
    assert report.n_ergons == ergons
    position = np.rint(np.array(t) * rate).astype(int)
    assert np.abs(done[position] - 1e-3 * np.array(x)).max() < 1e-9
    assert [1e3 * done.min(), 1e3 * done.max()] == pytest.approx([low, high], rel=0.01, abs=0.05)
    assert report.strongest == pytest.approx(strongest, rel=0.01)


def test_line_gesture_in_grains_hardest_at_turns():
    """From 48 mm/s up to 16 mm/s down at 0.125 s, less what the spring has taken since."""
    network, timeline, key = lone(48_000.0, **KEYS["placeholder"])
    x = [0.0, 6e-3, 0.0, -4e-3, 0.0]
    timeline.gesture(key, [0.0, 0.125, 0.5, 0.75, 1.0], x, ["line"] * 5, grain=1.0 / 400.0)
    sim = _core.Simulation(network, timeline, record=True)
    play(sim, 48_000)
    record = sim.ergons()
    assert len(record["time"]) == 400
    hardest = np.argmax(np.abs(record["impulse"]))
    assert record["time"][hardest] == pytest.approx(0.125, abs=1e-9)
    assert abs(record["impulse"][hardest]) / 0.4 == pytest.approx(0.062, abs=1e-3)


@pytest.mark.parametrize("grain", [2.5e-3, 5e-3, 10e-3])
def test_grain_gesture_deviation_bound(grain: float):
    """(1/ω²)(1/cos(ωh/2) - 1)·max|f*|/m: what a harmonic bow over h does under the path's force."""
    result = []
    for h in (None, grain):
        network, timeline, key = lone(48_000.0, **KEYS["light"])
        timeline.gesture(key, [0.0, 0.2, 0.5], [0.0, 6e-3, 0.0], SMOOTH[:3], grain=h)
        sim = _core.Simulation(network, timeline)
        result.append((play(sim, 24_000)[:, 0], sim.reports()[0].force_max))
    (path_of_key, force), (done, _) = result
    omega = 2.0 * math.pi * 8.0
    bound = (1.0 / math.cos(omega * grain / 2.0) - 1.0) / omega**2 * force / 0.08
    worst = np.abs(done - path_of_key).max()
    assert 0.9 * bound < worst < 1.005 * bound
    assert bound == pytest.approx(grain**2 / 8.0 * force / 0.08, rel=0.03)


# --- particles ---


@pytest.mark.parametrize("rate", [44100.0, 4410.0])
@pytest.mark.parametrize("speed", [-0.3, 0.3])
@pytest.mark.parametrize("step", [1e-5, -1e-4, 1e-3, -1e-2, 0.1, 0.5, -0.5])
def test_particle_impulse_on_moving_mass(rate: float, speed: float, step: float):
    network, timeline, key = lone(rate, M=0.4)
    x = [0.0, 0.1 * speed, 0.1 * (2.0 * speed + step)]
    timeline.gesture(key, [0.1, 0.2, 0.3], x, ["throw"] * 3, ergons="particle")
    sim = _core.Simulation(network, timeline)
    play(sim, round(0.25 * rate))
    assert sim.velocities()[0] - speed == pytest.approx(step, rel=1e-5)


@pytest.mark.parametrize("rate", [44100.0, 4410.0])
def test_particle_stream_moves_key_as_events(rate: float):
    """A dense gesture: tens of thousands of contacts, each within 1e-5 of its event."""
    result = []
    for ergons in ("event", "particle"):
        network, timeline, key = lone(rate, **KEYS["light"])
        points = [0.1, 0.2, 0.4], [0.0, 6e-3, 0.0]
        timeline.gesture(key, *points, SMOOTH[:3], ergons=ergons)
        sim = _core.Simulation(network, timeline, record=True)
        result.append((play(sim, round(0.5 * rate))[:, 0], sim.ergons()))
    (event, _), (particle, record) = result
    assert np.abs(particle - event).max() < 1e-5 * np.abs(event).max()
    assert np.abs(record["speed"]) == pytest.approx(1000.0)
    assert (record["mass"] > 0.0).all()  # the mass carries the impulse


# --- joins ---


def leaning(touch: str) -> tuple[np.ndarray, Any]:
    """A key that a strong spring holds 2.7 mm away from where it would be alone; a rest at 2 s."""
    network = _core.Network()
    network.part("k1")
    key = network.cel("m", **KEYS["placeholder"])
    network.part("wall")
    network.ref("r", key, network.sol("w", X0=3e-3), K=600.0)
    network.listen("x", positions=[(key, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    timeline.gesture(timeline.key("k1", key), [2.0, 2.5], [0.0, 2e-3], SMOOTH[:2], touch=touch)
    sim = _core.Simulation(network, timeline)
    return play(sim, int(2.4 * RATE))[:, 0], sim.reports()[0]


def test_tracked_gesture_joins_from_key_position():
    """One quintic from rest to rest in 20 ms: its greatest acceleration is (10/√3)·D/T²."""
    done, report = leaning("tracked")
    first, last = round(1.98 * RATE), round(2.0 * RATE)
    away = done[first - 1]
    assert away > 2.6e-3
    assert abs(done[last]) < 1e-12
    curvature = np.abs(np.diff(done[first - 20 : last + 1], 2)).max() * RATE**2
    assert curvature == pytest.approx(10.0 / math.sqrt(3.0) * away / 0.02**2, rel=0.03)
    assert report.worst < 1e-9


def test_open_gesture_joins_from_free_key_position():
    """The free key is at the first point already: nothing strikes before it, nothing jumps."""
    done, report = leaning("open")
    assert np.abs(np.diff(done[round(1.97 * RATE) : round(2.0 * RATE)], 2)).max() * RATE**2 < 0.5
    assert report.start == pytest.approx(2.0, abs=1.5 / RATE)
    assert report.worst > 2.5e-3  # the spring's doing, and said


# --- limits ---


@pytest.mark.parametrize("key", ["placeholder", "overdamped"])
@pytest.mark.parametrize("share", [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
def test_force_limited_gesture_lags_and_recovers(key: str, share: float):
    """It brakes in time: it never swings past the path by as much as it fell behind."""
    points = [0.1, 0.2, 0.8], [0.0, 6e-3, 6e-3], ["smooth", "smooth", "hold"]
    limit: float | None = None
    for _ in range(2):
        network, timeline, index = lone(**KEYS[key])
        timeline.gesture(index, *points, force_limit=limit)
        done, sim = moved(network, timeline, 0.8)
        report = sim.reports()[0]
        limit = limit or share * report.force_max
    off = (done - path(*points, grid(len(done))))[round(0.1 * RATE) : round(0.79 * RATE)]
    behind = -off.min()
    assert report.missed > 0
    assert behind > 1e-5
    assert off[off.argmin() :].max() < 0.7 * behind
    assert abs(off[-1]) < 1e-9  # it has come back, and stays


# --- keys that are networks ---


def rich(kind: str) -> tuple[Any, Any, int]:
    """A key of two masses, hung by its weight or held by a law: (network, timeline, key)."""
    network = _core.Network()
    network.part("k1")
    struck, arm = network.mas("m", M=0.2), network.cel("arm", M=0.3, K=90.0, Z=1.0)
    if kind == "law":
        law = _core.Law("k*d + q*d**3", "z*v", {"k": 400.0, "q": 2e6, "z": 0.5})
        network.lnl("l", struck, arm, law)
    else:
        network.ref("l", struck, arm, K=400.0, Z=0.5)
    network.listen("x", positions=[(struck, 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    if kind == "weight":
        timeline.drive(struck, "force", constant=-0.2 * 9.81)
    return network, timeline, timeline.key("k1", struck)


@pytest.mark.parametrize("kind", ["linear", "weight", "law"])
@pytest.mark.parametrize("curve", ["smooth", "line", "throw"])
def test_network_key_follows_path(kind: str, curve: str):
    t, x = [0.1, 0.16, 0.23, 0.28], [0.0, 4e-3, -1e-3, 2e-3]
    network, timeline, key = rich(kind)
    timeline.gesture(key, t, x, [curve] * 4)
    done, _ = moved(network, timeline, 0.3)
    if curve == "throw":
        first = 0 if kind != "weight" else 1  # a throw begins from where the key hangs
        position = np.floor(np.array(t) * RATE + 0.5).astype(int)[first:]
        assert np.abs(done[position] - x[first:]).max() < 1e-9
    else:
        asked = path(t, x, [curve] * 4, grid(len(done)))
        assert np.nanmax(np.abs(done - asked)) < 1e-9
