"""How gestures begin, meet, add up, and what they do when they cannot have their way."""

from typing import Any

import numpy as np
import pytest
from oracle.core import play
from oracle.gesture import path
from oracle.key import KEYS, RATE, SMOOTH, grid, lone, moved, worst

from ergon import _core


def frames(sim: Any, n: int) -> np.ndarray:
    """What the key is asked, frame by frame (n,): NaN when no gesture runs."""
    out, first = np.empty(n), np.empty((1, sim.n_out))
    for i in range(n):
        out[i] = sim.asked()[0]
        sim.process(first)
    return out


def test_join_starts_at_key_position_smoothly():
    """After 5 mm at rest the light key swings; 0.3 s later it is taken up in 20 ms, C2."""
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, [0.0, 0.2], [0.0, 5e-3], SMOOTH[:2])
    timeline.gesture(key, [0.5, 0.7], [2e-3, 0.0], SMOOTH[:2])
    done, sim = moved(network, timeline, 0.8)
    n, join = round(0.5 * RATE), round(0.02 * RATE)
    assert abs(done[n] - 2e-3) < 1e-9
    asked = path([0.5, 0.7], [2e-3, 0.0], SMOOTH[:2], grid(len(done)))
    assert worst(done, asked) < 1e-9
    assert not sim.reports()[1].first_point_missed
    # One quintic over the join: it fits to rounding, meets the free swing and the rest after it.
    u = np.linspace(0.0, 1.0, join + 1)[2:-2]
    fit = np.polynomial.Polynomial.fit(u, done[n - join + 2 : n - 1], 5, domain=[0.0, 1.0])
    assert np.abs(fit(u) - done[n - join + 2 : n - 1]).max() < 1e-9
    first, second = fit.deriv(1), fit.deriv(2)
    T = 1.0 / join
    free = done[n - join - 2 : n - join + 1]
    speed = (free[2] - free[0]) / (2.0 * T)
    curvature = (free[2] - 2.0 * free[1] + free[0]) / T**2
    size, size2 = np.abs(first(u)).max(), np.abs(second(u)).max()
    assert first(0.0) == pytest.approx(speed, abs=1e-2 * size)
    assert second(0.0) == pytest.approx(curvature, abs=2e-2 * size2)
    assert first(1.0) == pytest.approx(0.0, abs=1e-2 * size)
    assert second(1.0) == pytest.approx(0.0, abs=2e-2 * size2)


def test_join_lasts_20_ms_only_at_mismatch():
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, [0.1, 0.2], [0.0, 5e-3], SMOOTH[:2])  # agrees: no join
    timeline.gesture(key, [0.5, 0.7], [2e-3, 0.0], SMOOTH[:2])
    asked = frames(_core.Simulation(network, timeline), int(0.6 * RATE))
    running = np.flatnonzero(~np.isnan(asked)) / RATE
    first, second = running[running < 0.4], running[running > 0.4]
    assert first[0] == pytest.approx(0.1, abs=2.0 / RATE)
    assert first[-1] == pytest.approx(0.2, abs=2.0 / RATE)
    assert second[0] == pytest.approx(0.48, abs=3.0 / RATE)


def test_join_shortened_after_running_gesture():
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, [0.1, 0.49], [0.0, 5e-3], SMOOTH[:2])
    timeline.gesture(key, [0.5, 0.7], [2e-3, 0.0], SMOOTH[:2])
    done, sim = moved(network, timeline, 0.8)
    for t, x in (([0.1, 0.49], [0.0, 5e-3]), ([0.5, 0.7], [2e-3, 0.0])):
        assert worst(done, path(t, x, SMOOTH[:2], grid(len(done)))) < 1e-9
    assert not sim.reports()[1].first_point_missed


def test_later_gesture_cuts_earlier_and_joins():
    network, timeline, key = lone(**KEYS["light"])
    timeline.gesture(key, [0.0, 2.0], [0.0, 8e-3], SMOOTH[:2])
    timeline.gesture(key, [1.0, 1.3], [0.0, 3e-3], SMOOTH[:2])
    done, sim = moved(network, timeline, 1.4)
    when = grid(len(done))
    first = path([0.0, 2.0], [0.0, 8e-3], SMOOTH[:2], when)
    second = path([1.0, 1.3], [0.0, 3e-3], SMOOTH[:2], when)
    cut, joined = int(RATE) - 1, round(1.02 * RATE) + 1
    assert np.abs(done - first)[:cut].max() < 1e-9
    inside = slice(joined, round(1.3 * RATE))
    assert np.abs(done - second)[inside].max() < 1e-9
    single, two = sim.reports()
    assert single.stop == pytest.approx(1.0, abs=2.0 / RATE)
    assert not single.first_point_missed
    assert two.first_point_missed
    # no jump of velocity anywhere in the join: the third difference stays that of a quintic
    assert np.abs(np.diff(done, 2))[cut - 5 : joined + 5].max() * RATE**2 < 200.0


def test_layered_gesture_adds_to_gesture():
    first = ([0.0, 0.2, 0.8], [0.0, 4e-3, 0.0])
    two = ([0.3, 0.4, 0.6], [0.0, -1e-3, 0.0])
    network, timeline, key = lone(**KEYS["placeholder"])
    timeline.gesture(key, *first, SMOOTH[:3])
    timeline.gesture(key, *two, SMOOTH[:3], layer=True)
    done, _ = moved(network, timeline, 0.8)
    when = grid(len(done))
    both = path(*first, SMOOTH[:3], when) + np.nan_to_num(path(*two, SMOOTH[:3], when))
    assert np.abs(done - both)[: round(0.6 * RATE)].max() < 1e-9


# --- limits ---


@pytest.mark.parametrize("touch", ["open", "tracked"])
def test_force_limit_bounds_ergons_and_reports_misses(touch: str):
    needed = strongest(touch, None)
    limit = 0.4 * needed.force_max
    report, pushes, done = limited(touch, limit)
    assert needed.missed == 0
    assert np.abs(pushes).max() <= limit * (1.0 + 1e-12)
    assert report.force_max <= limit * (1.0 + 1e-12)
    assert report.missed > 10
    asked = path([0.1, 0.2, 0.4], [0.0, 6e-3, 0.0], SMOOTH[:3], grid(len(done)))
    assert np.nanmax(np.abs(done - asked)) > 1e-6


def limited(touch: str, limit: float | None) -> tuple[Any, np.ndarray, np.ndarray]:
    network, timeline, key = lone(**KEYS["placeholder"])
    timeline.gesture(
        key, [0.1, 0.2, 0.4], [0.0, 6e-3, 0.0], SMOOTH[:3], touch=touch, force_limit=limit
    )
    done, sim = moved(network, timeline, 0.5, record=True)
    return sim.reports()[0], sim.ergons()["impulse"] * RATE, done


def strongest(touch: str, limit: float | None) -> Any:
    report, pushes, _ = limited(touch, limit)
    assert report.force_max == pytest.approx(np.abs(pushes).max(), rel=1e-9)
    assert report.n_ergons == len(pushes)
    assert report.strongest == pytest.approx(report.force_max / (0.4 * RATE), rel=1e-6)
    return report


# --- particles ---


@pytest.mark.parametrize("rate", [44100.0, 4410.0])
@pytest.mark.parametrize("step", [1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, -0.02])
def test_particle_impulse_equals_event_impulse(rate: float, step: float):
    """A bare mass thrown over 0.1 s: its speed is path over time whatever throws it."""
    network, timeline, key = lone(rate, M=0.4)
    timeline.gesture(key, [0.1, 0.2], [0.0, 0.1 * step], ["throw"] * 2, ergons="particle")
    sim = _core.Simulation(network, timeline, record=True)
    play(sim, round(0.15 * rate))
    assert sim.velocities()[0] == pytest.approx(step, rel=1e-5)
    record = sim.ergons()
    assert len(record["time"]) == 1
    assert abs(record["speed"][0]) == pytest.approx(1000.0, rel=2e-3)
    assert record["impulse"][0] == pytest.approx(0.4 * step, rel=1e-5)
    m = record["mass"][0]
    arguments = 2.0 * m * 0.4 / (m + 0.4) * record["speed"][0]
    assert arguments == pytest.approx(0.4 * step, rel=1e-3)


# --- endurance ---


def test_bare_mass_key_without_drift_over_two_minutes():
    network, timeline, key = lone(M=0.4)
    for i in range(120):
        timeline.gesture(key, [i, i + 0.25, i + 0.6], [0.0, 6e-3, 0.0], SMOOTH[:3])
    sim = _core.Simulation(network, timeline)
    period = path([0.0, 0.25, 0.6], [0.0, 6e-3, 0.0], SMOOTH[:3], grid(int(RATE)))
    for _ in range(120):
        done = play(sim, int(RATE))[:, 0]
        assert np.abs(done - np.nan_to_num(period)).max() < 1e-9
    assert abs(sim.velocities()[0]) < 5e-9
