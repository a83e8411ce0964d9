"""What a key is pushed by while it is measured: strokes, rain, strikes; and knocks that judge."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from .parameters import INDEX, START, total_mass

if TYPE_CHECKING:
    from .gesture import Floats

STILL = 0.15  # s without force at the beginning, by which the sensor's noise is known
_STRIKES = 60.0  # a second


def strokes(n: int, rate: float, chance: np.random.Generator) -> Floats:
    """Forces from -1 to 1 that jump every 0.1 to 0.6 s, (n,)."""
    force, at = np.zeros(n), 0
    while at < n:
        to = at + int(chance.uniform(0.1, 0.6) * rate)
        force[at:to] = chance.uniform(-1, 1)
        at = to
    return force


def rain(n: int, chance: np.random.Generator) -> Floats:
    """Single ticks of random sign, (n,)."""
    return chance.choice([-1.0, 1.0], n)


def strikes(n: int, rate: float, chance: np.random.Generator) -> Floats:
    """Pushes of two ticks at random instants, each of random sign and taken back at once, (n,)."""
    force = np.zeros(n)
    for at in np.flatnonzero(chance.random(n - 4) < _STRIKES / rate):
        force[at : at + 4] = chance.choice([-1.0, 1.0]) * np.array([1.0, 1.0, -1.0, -1.0])
    return force


def jolts(n: int, rate: float, chance: np.random.Generator, length: float = 1.0) -> Floats:
    """Pushes of 6 to 16 ms that are taken back at once, so that no key keeps a speed of them, (n,).

    `length` makes them longer.
    """
    force, at = np.zeros(n), 0
    while at < n:
        half = int(length * chance.uniform(0.006, 0.016) * rate)
        way = chance.choice([-1.0, 1.0])
        force[at : at + half], force[at + half : at + 2 * half] = way, -way
        at += 2 * half
    return force


def mixed(n: int, rate: float, chance: np.random.Generator, quick: Floats, share: float) -> Floats:
    """Strokes, and `share` of something quicker (n,); from -1 to 1."""
    return np.clip(share * quick + (1.0 - share) * strokes(n, rate, chance), -1, 1)


def framed(force: Floats, rate: float) -> tuple[Floats, int]:
    """The force after a still beginning, and the ticks of that."""
    still = round(STILL * rate)
    return np.concatenate([np.zeros(still), force]), still


def within(force: Floats, rate: float, row: Floats, reach: float, least: float = 0.05) -> Floats:
    """The force, weakened until a key goes no farther than `reach` [m] from where it rests.

    Quick forces move a key little; so of the force the part below 20 Hz gives way first.
    """
    spectrum = np.fft.rfft(force)
    slow = np.fft.irfft(spectrum * (np.fft.rfftfreq(force.size, 1 / rate) < 20.0), force.size)
    quick, share, all_of_it = force - slow, 1.0, 1.0
    row = row.copy()
    row[START] = row[INDEX["weight"]] = 0.0
    while True:
        weakened: Floats = all_of_it * (share * slow + quick)
        path = _core.key_path(row, weakened, rate, columns=())[0]
        if np.abs(path).max() <= reach or all_of_it < least:
            return weakened
        if share > least:
            share *= 0.85
        else:
            all_of_it *= 0.85


def knocks(row: Floats, rate: float, seconds: float, reach: float, most: float) -> Floats:
    """Forces [N] of knocks, a lean and quick knocks of many heights, by a rough model of the key.

    They take a key without dry friction `reach` [m] far, or as far as `most` [N] does.
    """
    n, chance = round(seconds * rate), np.random.default_rng(99)
    x, at = np.zeros(n), 0

    def go(to: float, duration: float, rest: float = 0.0) -> None:
        nonlocal at
        steps = min(int(duration * rate), n - 1 - at)
        if steps <= 0:
            return
        s = np.arange(1, steps + 1) / steps
        before = x[at]
        x[at : at + steps] = before + (to - before) * s**3 * (10 - 15 * s + 6 * s * s)
        x[at + steps :] = to
        at = min(at + steps + int(rest * rate), n - 1)

    while at < n - 1:
        for _ in range(6):
            go(1.0, 0.09)
            go(0.0, 0.12, 0.15)
        go(1.0, 0.5, 1.0)
        go(0.0, 0.8)
        for _ in range(12):
            go(chance.uniform(0.3, 0.9), 0.06)
            go(0.0, 0.07)
    return _forces(reach * x, row, rate, most)


def led(path: Floats, row: Floats, rate: float, reach: float, most: float) -> Floats:
    """Forces [N] that lead a rough model of a key along a path (n,) [m] from where it rests, (n,).

    A path that goes farther than `reach` [m] is made smaller as a whole.
    """
    x = path - path[0]
    return _forces(min(1.0, reach / max(np.abs(x).max(), 1e-12)) * x, row, rate, most)


def _forces(x: Floats, row: Floats, rate: float, most: float) -> Floats:
    """Forces (n,) [N] that lead a key without dry friction along x (n,) [m], at most `most`."""
    v = np.gradient(x) * rate
    force = total_mass(row) * np.gradient(v) * rate + row[2] * v + row[1] * x
    # Leans weigh little, knocks much: where a knock needs too much, it is weakened alone.
    clipped: Floats = np.clip(
        force * min(1.0, 2.0 * most / max(np.abs(force).max(), 1e-12)), -most, most
    )
    return clipped
