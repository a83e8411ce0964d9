"""The forces by which a key is measured: strokes, rain, strikes; and knocks for validation."""

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
    stroke_forces, stroke_start = np.zeros(n), 0
    while stroke_start < n:
        stroke_stop = stroke_start + int(chance.uniform(0.1, 0.6) * rate)
        stroke_forces[stroke_start:stroke_stop] = chance.uniform(-1, 1)
        stroke_start = stroke_stop
    return stroke_forces


def rain(n: int, chance: np.random.Generator) -> Floats:
    """Single ticks of random sign, (n,)."""
    return chance.choice([-1.0, 1.0], n)


def strikes(n: int, rate: float, chance: np.random.Generator) -> Floats:
    """Pushes of two ticks at random instants, each of random sign and followed at once by its
    opposite, (n,).
    """
    strike_forces = np.zeros(n)
    for start in np.flatnonzero(chance.random(n - 4) < _STRIKES / rate):
        strike_forces[start : start + 4] = chance.choice([-1.0, 1.0]) * np.array(
            [1.0, 1.0, -1.0, -1.0]
        )
    return strike_forces


def jolts(n: int, rate: float, chance: np.random.Generator, jolt_length: float = 1.0) -> Floats:
    """Pushes of 6 to 16 ms, each followed at once by its opposite, so that the key keeps no speed,
    (n,).

    `jolt_length` multiplies their duration.
    """
    jolt_forces, jolt_start = np.zeros(n), 0
    while jolt_start < n:
        half = int(jolt_length * chance.uniform(0.006, 0.016) * rate)
        direction = chance.choice([-1.0, 1.0])
        (
            jolt_forces[jolt_start : jolt_start + half],
            jolt_forces[jolt_start + half : jolt_start + 2 * half],
        ) = (
            direction,
            -direction,
        )
        jolt_start += 2 * half
    return jolt_forces


def mixed(n: int, rate: float, chance: np.random.Generator, quick: Floats, share: float) -> Floats:
    """Strokes with a share `share` of quicker forces (n,); from -1 to 1."""
    return np.clip(share * quick + (1.0 - share) * strokes(n, rate, chance), -1, 1)


def framed(force: Floats, rate: float) -> tuple[Floats, int]:
    """The force after a beginning without force, and the number of ticks of that beginning."""
    still_ticks = round(STILL * rate)
    return np.concatenate([np.zeros(still_ticks), force]), still_ticks


def scaled_to_reach(
    push_forces: Floats, rate: float, parameter_row: Floats, reach: float, least: float = 0.05
) -> Floats:
    """The force, reduced until a key goes no farther than `reach` [m] from its rest.

    Quick forces move a key little, so the part of the force below 20 Hz is reduced first.
    """
    spectrum = np.fft.rfft(push_forces)
    low_passed = np.fft.irfft(
        spectrum * (np.fft.rfftfreq(push_forces.size, 1 / rate) < 20.0), push_forces.size
    )
    quick, quick_share, all_of_it = push_forces - low_passed, 1.0, 1.0
    parameter_row = parameter_row.copy()
    parameter_row[START] = parameter_row[INDEX["weight"]] = 0.0
    while True:
        weakened: Floats = all_of_it * (quick_share * low_passed + quick)
        path = _core.key_path(parameter_row, weakened, rate, columns=())[0]
        if np.abs(path).max() <= reach or all_of_it < least:
            return weakened
        if quick_share > least:
            quick_share *= 0.85
        else:
            all_of_it *= 0.85


def knocks(
    parameter_row: Floats, rate: float, gesture_seconds: float, reach: float, force_max: float
) -> Floats:
    """Forces [N] of a gesture of knocks, a slow push and quick knocks of many heights, by a rough
    model of the key.

    They move a key without dry friction by `reach` [m], or as far as `force_max` [N] can.
    """
    n, chance = round(gesture_seconds * rate), np.random.default_rng(99)
    x, push_start = np.zeros(n), 0

    def go(target_position: float, duration: float, rest_duration: float = 0.0) -> None:
        nonlocal push_start
        push_steps = min(int(duration * rate), n - 1 - push_start)
        if push_steps <= 0:
            return
        step_shares = np.arange(1, push_steps + 1) / push_steps
        position_before = x[push_start]
        x[push_start : push_start + push_steps] = position_before + (
            target_position - position_before
        ) * step_shares**3 * (10 - 15 * step_shares + 6 * step_shares * step_shares)
        x[push_start + push_steps :] = target_position
        push_start = min(push_start + push_steps + int(rest_duration * rate), n - 1)

    while push_start < n - 1:
        for _ in range(6):
            go(1.0, 0.09)
            go(0.0, 0.12, 0.15)
        go(1.0, 0.5, 1.0)
        go(0.0, 0.8)
        for _ in range(12):
            go(chance.uniform(0.3, 0.9), 0.06)
            go(0.0, 0.07)
    return _forces(reach * x, parameter_row, rate, force_max)


def forces_along_path(
    path: Floats, parameter_row: Floats, rate: float, reach: float, force_max: float
) -> Floats:
    """Forces [N] that move a rough model of a key along a path (n,) [m] from its rest, (n,).

    A path that goes farther than `reach` [m] is scaled down as a whole.
    """
    x = path - path[0]
    return _forces(
        min(1.0, reach / max(np.abs(x).max(), 1e-12)) * x, parameter_row, rate, force_max
    )


def _forces(x: Floats, parameter_row: Floats, rate: float, force_max: float) -> Floats:
    """Forces (n,) [N] that move a key without dry friction along x (n,) [m], at most "
    "`force_max`."""
    v = np.gradient(x) * rate
    path_forces = (
        total_mass(parameter_row) * np.gradient(v) * rate
        + parameter_row[2] * v
        + parameter_row[1] * x
    )
    # Slow pushes need little force and knocks much: if only knocks need too much, only they are
    # clipped.
    clipped: Floats = np.clip(
        path_forces * min(1.0, 2.0 * force_max / max(np.abs(path_forces).max(), 1e-12)),
        -force_max,
        force_max,
    )
    return clipped
