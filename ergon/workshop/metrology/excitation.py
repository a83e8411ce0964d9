"""The forces by which a key is measured: strokes, rain, strikes; and knocks for validation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from .parameters import INDEX, START, total_mass

if TYPE_CHECKING:
    from .gesture import Floats

STILL_DURATION = 0.15  # s without force at the beginning, by which the sensor's noise is known
_STRIKE_RATE = 60.0  # a second


def strokes(n_ticks: int, rate: float, rng: np.random.Generator) -> Floats:
    """Forces from -1 to 1 that jump every 0.1 to 0.6 s, (n,)."""
    forces, start_tick = np.zeros(n_ticks), 0
    while start_tick < n_ticks:
        end_tick = start_tick + int(rng.uniform(0.1, 0.6) * rate)
        forces[start_tick:end_tick] = rng.uniform(-1, 1)
        start_tick = end_tick
    return forces


def rain(n_ticks: int, rng: np.random.Generator) -> Floats:
    """Single ticks of random sign, (n,)."""
    return rng.choice([-1.0, 1.0], n_ticks)


def strikes(n_ticks: int, rate: float, rng: np.random.Generator) -> Floats:
    """Pushes of two ticks at random instants, each of random sign and followed at once by its
    opposite, (n,).
    """
    forces = np.zeros(n_ticks)
    for start in np.flatnonzero(rng.random(n_ticks - 4) < _STRIKE_RATE / rate):
        forces[start : start + 4] = rng.choice([-1.0, 1.0]) * np.array([1.0, 1.0, -1.0, -1.0])
    return forces


def jolts(n_ticks: int, rate: float, rng: np.random.Generator, length_ratio: float = 1.0) -> Floats:
    """Pushes of 6 to 16 ms, each followed at once by its opposite, so that the key keeps no speed,
    (n,).

    `length_ratio` multiplies their duration.
    """
    forces, start_tick = np.zeros(n_ticks), 0
    while start_tick < n_ticks:
        half_length = int(length_ratio * rng.uniform(0.006, 0.016) * rate)
        direction = rng.choice([-1.0, 1.0])
        (
            forces[start_tick : start_tick + half_length],
            forces[start_tick + half_length : start_tick + 2 * half_length],
        ) = (direction, -direction)
        start_tick += 2 * half_length
    return forces


def mix_with_strokes(
    n_ticks: int, rate: float, rng: np.random.Generator, quick_forces: Floats, quick_share: float
) -> Floats:
    """Strokes with a share `quick_share` of quicker forces (n,); from -1 to 1."""
    return np.clip(
        quick_share * quick_forces + (1.0 - quick_share) * strokes(n_ticks, rate, rng), -1, 1
    )


def with_still_beginning(force: Floats, rate: float) -> tuple[Floats, int]:
    """The force after a beginning without force, and the number of ticks of that beginning."""
    n_still = round(STILL_DURATION * rate)
    return np.concatenate([np.zeros(n_still), force]), n_still


def scaled_to_reach(
    forces: Floats, rate: float, parameters: Floats, excursion_max: float, scale_min: float = 0.05
) -> Floats:
    """The force, reduced until a key goes no farther than `excursion_max` [m] from its rest.

    Quick forces move a key little, so the part of the force below 20 Hz is reduced first.
    """
    spectrum = np.fft.rfft(forces)
    slow_forces = np.fft.irfft(
        spectrum * (np.fft.rfftfreq(forces.size, 1 / rate) < 20.0), forces.size
    )
    quick_forces, slow_scale, total_scale = forces - slow_forces, 1.0, 1.0
    parameters = parameters.copy()
    parameters[START] = parameters[INDEX["weight"]] = 0.0
    while True:
        scaled_forces: Floats = total_scale * (slow_scale * slow_forces + quick_forces)
        path = _core.key_path(parameters, scaled_forces, rate, columns=())[0]
        if np.abs(path).max() <= excursion_max or total_scale < scale_min:
            return scaled_forces
        if slow_scale > scale_min:
            slow_scale *= 0.85
        else:
            total_scale *= 0.85


def knocks(
    parameters: Floats, rate: float, duration_s: float, excursion: float, force_max: float
) -> Floats:
    """Forces [N] of a gesture of knocks, a slow push and quick knocks of many heights, by a rough
    model of the key.

    They move a key without dry friction by `excursion` [m], or as far as `force_max` [N] can.
    """
    n_total, rng = round(duration_s * rate), np.random.default_rng(99)
    path, tick = np.zeros(n_total), 0

    def move_to(target: float, duration: float, rest_duration: float = 0.0) -> None:
        nonlocal tick
        n_ticks = min(int(duration * rate), n_total - 1 - tick)
        if n_ticks <= 0:
            return
        progress = np.arange(1, n_ticks + 1) / n_ticks
        begin_position = path[tick]
        path[tick : tick + n_ticks] = begin_position + (target - begin_position) * progress**3 * (
            10 - 15 * progress + 6 * progress * progress
        )
        path[tick + n_ticks :] = target
        tick = min(tick + n_ticks + int(rest_duration * rate), n_total - 1)

    while tick < n_total - 1:
        for _ in range(6):
            move_to(1.0, 0.09)
            move_to(0.0, 0.12, 0.15)
        move_to(1.0, 0.5, 1.0)
        move_to(0.0, 0.8)
        for _ in range(12):
            move_to(rng.uniform(0.3, 0.9), 0.06)
            move_to(0.0, 0.07)
    return _inverse_dynamics(excursion * path, parameters, rate, force_max)


def forces_along_path(
    path: Floats, parameters: Floats, rate: float, excursion_max: float, force_max: float
) -> Floats:
    """Forces [N] that move a rough model of a key along a path (n,) [m] from its rest, (n,).

    A path that goes farther than `excursion_max` [m] is scaled down as a whole.
    """
    x = path - path[0]
    return _inverse_dynamics(
        min(1.0, excursion_max / max(np.abs(x).max(), 1e-12)) * x, parameters, rate, force_max
    )


def _inverse_dynamics(x: Floats, parameters: Floats, rate: float, force_max: float) -> Floats:
    """Forces (n,) [N] that move a key without dry friction along x (n,) [m], each at most
    `force_max`.
    """
    speed = np.gradient(x) * rate
    forces = (
        total_mass(parameters) * np.gradient(speed) * rate
        + parameters[2] * speed
        + parameters[1] * x
    )
    # Slow pushes need little force and knocks much: if only knocks need too much, only they are
    # clipped.
    clipped_forces: Floats = np.clip(
        forces * min(1.0, 2.0 * force_max / max(np.abs(forces).max(), 1e-12)), -force_max, force_max
    )
    return clipped_forces
