"""Replies out of step with the ticks: the device's clock says when forces acted."""

import numpy as np
from measured_keys import PLAIN, RATE, read, wire

from ergon import _core
from ergon.workshop.metrology.gesture import Gesture, gesture_from_rows, sensor_step
from ergon.workshop.metrology.output_error import Fit, fit
from ergon.workshop.metrology.parameters import INDEX, START

FINE = 40  # parts of a tick, in which a device's motor may switch
N = 6000
COLUMNS = [INDEX[name] for name in ("mass", "stiffness", "damping", "weight", "dry", "delay")]


def fitted(gesture: Gesture) -> Fit:
    return fit([gesture], PLAIN, COLUMNS)


def test_gesture_late_replies_ordered_by_device_clock():
    chance = np.random.default_rng(8)
    late = np.clip(np.round(FINE * 0.06 * chance.standard_normal(N)), -10, 10).astype(int)
    late[:60] = 0
    start = FINE * np.arange(1, N + 1) + late  # parts of ticks
    ticks = chance.choice([-1.0, 1.0], N)
    strokes = np.repeat(chance.uniform(-1.0, 1.0, N // 250), 250)
    sent = wire(0.3 * ticks + 0.6 * strokes)
    sent[:60] = 0.0
    # A force acts from the instant on at which its reply reads the position.
    held = np.searchsorted(start, np.arange(start[-1] + 1), side="right") - 1
    force = np.where(held >= 0, sent[held], 0.0)
    row = PLAIN.copy()
    row[INDEX["delay"]] = 0.0
    row[START] = -row[INDEX["weight"]] / row[INDEX["stiffness"]]
    true = _core.key_path(row, force, RATE * FINE, columns=(), steps=4)[0]
    position = read(true[start], 5)
    clock = np.round(start / FINE / RATE * 1e6).astype(np.uint32)
    every = np.ones(N, bool)
    rows = gesture_from_rows(np.arange(N), sent, position, every, clock, RATE)
    key = fitted(rows)
    assert key.rms < 4.6e-6  # the sensor leaves 4.2
    for name in ("mass", "stiffness", "damping", "dry"):
        index = INDEX[name]
        assert abs(key.parameters[index] - row[index]) < 5 * key.deviation(index), name
    assert abs(key.parameters[INDEX["delay"]] * RATE - 1.0) < 0.01  # the clock's delay: a tick
    step = sensor_step([rows])
    assert step is not None
    assert abs(step / (30e-3 / 4096) - 1) < 1e-6
    # As if each reply had come on its tick:
    rounded = gesture_from_rows(np.arange(N), sent, position, every, np.zeros(N, np.uint32), RATE)
    assert fitted(rounded).rms > 4 * key.rms


def test_gesture_lost_forces_reconstructed():
    """Bursts of lost requests, 6 % of the ticks: the device holds the force before each."""
    chance = np.random.default_rng(4)
    lost = np.zeros(N, bool)
    for start in chance.choice(np.arange(200, N - 10), 150, replace=False):
        lost[start : start + chance.integers(1, 5)] = True
    assert lost.mean() > 0.05
    sent = wire(0.5 * chance.choice([-1.0, 1.0], N) + 0.3 * chance.uniform(-1.0, 1.0, N))
    sent[:60] = 0.0
    held = np.maximum.accumulate(np.where(lost, 0, np.arange(N)))
    force = sent[held]
    row = PLAIN.copy()
    row[START] = -row[INDEX["weight"]] / row[INDEX["stiffness"]]
    position = read(_core.key_path(row, force, RATE, columns=())[0], 6)
    # A position is that of the tick's beginning; a reply comes after its force has acted.
    rows = gesture_from_rows(
        np.arange(N),
        np.roll(sent, -1),
        position,
        np.roll(~lost, -1),
        np.zeros(N, np.uint32),
        RATE,
    )
    ticks = rows.unknown_forces.ticks
    assert 200 < ticks.size <= lost.sum()
    key = fitted(rows)
    assert key.rms < 4.6e-6  # the sensor leaves 4.2
    for name in ("mass", "stiffness", "damping", "dry"):
        index = INDEX[name]
        assert abs(key.parameters[index] - row[index]) < 5 * key.deviation(index), name
