"""Known keys, the forces that push them, and a sensor that reads them."""

import numpy as np
from numpy.typing import NDArray

from ergon import _core
from ergon.workshop.metrology.gesture import Gesture, gesture_from_arrays
from ergon.workshop.metrology.parameters import START, total_mass

Floats = NDArray[np.float64]
RATE = 44100 / 44
# 380 g with a mode of 20 g at 180 Hz; 60 N/m, 1.2 Ns/m, 50 mN, a weight, a delay of a tick.
KEY = np.array([0.38, 60.0, 1.2, 0.15, 0.05, -2.5e-3, 1 / RATE, 0.0, 0.0, 0.0, 0.02, 180.0, 0.02])
PLAIN = np.array([0.4, *KEY[1:10]])  # the same without a mode
QUANTUM = 30e-3 / 4096  # of the sensor [m]
FORCE = 0.9 * 1.56  # the most that is asked for [N]
FORCE_STEP = 1.56 / 127
REACH = 12e-3  # how far the key may go [m]


def wire(force: Floats) -> Floats:
    """The forces as eight bits encode them."""
    lsb = np.clip(np.round(force / FORCE_STEP), -127, 127)
    return np.asarray(lsb * FORCE_STEP)


def path(
    row: Floats, force: Floats, steps: int | None = None, start: float | None = None
) -> Floats:
    row = row.copy()
    row[START] = row[START] if start is None else start
    return _core.key_path(row, force, RATE, columns=(), steps=steps)[0]


def rain(row: Floats, seconds: float = 10.0, seed: int = 3, share: float = 0.8) -> Floats:
    """Single ticks of random sign, and strokes as strong as the travel allows."""
    chance, n = np.random.default_rng(seed), round(seconds * RATE)
    ticks, strokes, position = chance.choice([-1.0, 1.0], n), np.zeros(n), 0
    while position < n:
        to = position + int(chance.uniform(0.1, 0.6) * RATE)
        strokes[position:to] = chance.uniform(-1, 1)
        position = to
    gain = 1.0 - share
    while True:
        force = wire(FORCE * np.clip(share * ticks + gain * strokes, -1, 1))
        if np.abs(path(row, force)).max() <= REACH:
            return force
        gain *= 0.85


def knocks(row: Floats, seconds: float = 8.0) -> Floats:
    """Knocks, a slow push and quick knocks of many heights, for a key without dry friction."""
    chance, n, rest = np.random.default_rng(99), round(seconds * RATE), row[START]
    x, position = np.full(n, rest), int(0.3 * RATE)

    def go(to: float, duration: float) -> None:
        nonlocal position
        steps = int(duration * RATE)
        s = np.arange(1, steps + 1) / steps
        before = x[position]
        x[position : position + steps] = before + (to - before) * s**3 * (10 - 15 * s + 6 * s * s)
        x[position + steps :] = to
        position += steps

    for _ in range(6):
        go(rest + 6e-3, 0.09)
        go(rest, 0.12)
        position += int(0.15 * RATE)
    go(6e-3, 0.5)
    position += int(1.0 * RATE)
    go(rest, 0.8)
    for _ in range(12):
        go(rest + chance.uniform(2e-3, 5e-3), 0.06)
        go(rest, 0.07)
    v = np.gradient(x) * RATE
    force = total_mass(row) * np.gradient(v) * RATE + row[2] * v + row[1] * (x - rest)
    return wire(np.clip(force, -FORCE, FORCE))


def read(x: Floats, seed: int) -> Floats:
    """The readings of a 12-bit sensor, with noise of half its step."""
    noise = 0.5 * np.random.default_rng(seed).standard_normal(x.size)
    return np.asarray(np.round(x / QUANTUM + noise) * QUANTUM)


def gesture(row: Floats, force: Floats, seed: int, start: float | None = None) -> Gesture:
    """A gesture on a key, computed with time steps four times finer than those of the fit."""
    return gesture_from_arrays(force, read(path(row, force, 176, start), seed), RATE)
