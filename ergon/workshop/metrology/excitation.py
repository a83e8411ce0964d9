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
    forces, begin = np.zeros(n), 0
    while begin < n:
        end = begin + int(chance.uniform(0.1, 0.6) * rate)
        forces[begin:end] = chance.uniform(-1, 1)
        begin = end
    return forces


def rain(n: int, chance: np.random.Generator) -> Floats:
    """Single ticks of random sign, (n,)."""
    return chance.choice([-1.0, 1.0], n)


def strikes(n: int, rate: float, chance: np.random.Generator) -> Floats:
    """Pushes of two ticks at random instants, each of random sign and followed at once by its
    opposite, (n,).
    """
    forces = np.zeros(n)
    for start in np.flatnonzero(chance.random(n - 4) < _STRIKES / rate):
        forces[start : start + 4] = chance.choice([-1.0, 1.0]) * np.array([1.0, 1.0, -1.0, -1.0])
    return forces


def jolts(n: int, rate: float, chance: np.random.Generator, length_ratio: float = 1.0) -> Floats:
    """Pushes of 6 to 16 ms, each followed at once by its opposite, so that the key keeps no speed,
    (n,).

    `length_ratio` multiplies their duration.
    """
    forces, begin = np.zeros(n), 0
    while begin < n:
        half_length = int(length_ratio * chance.uniform(0.006, 0.016) * rate)
        direction = chance.choice([-1.0, 1.0])
        (
            forces[begin : begin + half_length],
            forces[begin + half_length : begin + 2 * half_length],
        ) = (
            direction,
            -direction,
        )
        begin += 2 * half_length
    return forces


def mixed(n: int, rate: float, chance: np.random.Generator, quick: Floats, share: float) -> Floats:
    """Strokes with a share `share` of quicker forces (n,); from -1 to 1."""
    return np.clip(share * quick + (1.0 - share) * strokes(n, rate, chance), -1, 1)


def framed(force: Floats, rate: float) -> tuple[Floats, int]:
    """The force after a beginning without force, and the number of ticks of that beginning."""
    still_ticks = round(STILL * rate)
    return np.concatenate([np.zeros(still_ticks), force]), still_ticks


def scaled_to_reach(
    push_forces: Floats, rate: float, parameter_row: Floats, reach: float, share_min: float = 0.05
) -> Floats:
    """The force, reduced until a key goes no farther than `reach` [m] from its rest.

    Quick forces move a key little, so the part of the force below 20 Hz is reduced first.
    """
    spectrum = np.fft.rfft(push_forces)
    slow_forces = np.fft.irfft(
        spectrum * (np.fft.rfftfreq(push_forces.size, 1 / rate) < 20.0), push_forces.size
    )
    quick_forces, slow_share, total_share = push_forces - slow_forces, 1.0, 1.0
    parameter_row = parameter_row.copy()
    parameter_row[START] = parameter_row[INDEX["weight"]] = 0.0
    while True:
        reduced_forces: Floats = total_share * (slow_share * slow_forces + quick_forces)
        path = _core.key_path(parameter_row, reduced_forces, rate, columns=())[0]
        if np.abs(path).max() <= reach or total_share < share_min:
            return reduced_forces
        if slow_share > share_min:
            slow_share *= 0.85
        else:
            total_share *= 0.85


def knocks(
    parameter_row: Floats, rate: float, gesture_seconds: float, reach: float, force_max: float
) -> Floats:
    """Forces [N] of a gesture of knocks, a slow push and quick knocks of many heights, by a rough
    model of the key.

    They move a key without dry friction by `reach` [m], or as far as `force_max` [N] can.
    """
    n, chance = round(gesture_seconds * rate), np.random.default_rng(99)
    target_path, move_begin = np.zeros(n), 0

    def move_to(target_position: float, duration: float, rest_duration: float = 0.0) -> None:
        nonlocal move_begin
        tick_count = min(int(duration * rate), n - 1 - move_begin)
        if tick_count <= 0:
            return
        time_shares = np.arange(1, tick_count + 1) / tick_count
        begin_position = target_path[move_begin]
        target_path[move_begin : move_begin + tick_count] = begin_position + (
            target_position - begin_position
        ) * time_shares**3 * (10 - 15 * time_shares + 6 * time_shares * time_shares)
        target_path[move_begin + tick_count :] = target_position
        move_begin = min(move_begin + tick_count + int(rest_duration * rate), n - 1)

    while move_begin < n - 1:
        for _ in range(6):
            move_to(1.0, 0.09)
            move_to(0.0, 0.12, 0.15)
        move_to(1.0, 0.5, 1.0)
        move_to(0.0, 0.8)
        for _ in range(12):
            move_to(chance.uniform(0.3, 0.9), 0.06)
            move_to(0.0, 0.07)
    return _forces(reach * target_path, parameter_row, rate, force_max)


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
    forces = (
        total_mass(parameter_row) * np.gradient(v) * rate
        + parameter_row[2] * v
        + parameter_row[1] * x
    )
    # Slow pushes need little force and knocks much: if only knocks need too much, only they are
    # clipped.
    clipped_forces: Floats = np.clip(
        forces * min(1.0, 2.0 * force_max / max(np.abs(forces).max(), 1e-12)),
        -force_max,
        force_max,
    )
    return clipped_forces
