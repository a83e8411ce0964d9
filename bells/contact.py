"""The contact of a hammer: what a push of some length leaves of high modes, and its spring."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergon.bells.bands import Array

HAMMER = 0.008  # mass [kg]
SPEED = 1.0  # at which it strikes [m/s]
LENGTH = 1e-4  # of a contact, where strokes do not tell it: hardly heard [s]
_TRIED = np.geomspace(5e-5, 1e-2, 80)  # lengths [s]
_REACH = 1.2  # f·length up to which the spectrum of a push is that of half a sine
_LEAST = 3  # modes that tell a length
_KNOWN = 0.03  # levels are no better than this, relatively


def spectrum(f: Array, length: float) -> Array:
    """|spectrum| of a push of half a sine `length` [s] long over that at 0 Hz, at each f [Hz]."""
    x = f * length
    near = np.abs(x - 0.5) < 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.cos(np.pi * x) / (1.0 - 4.0 * x * x)
    return np.abs(np.where(near, np.pi / 4.0, value))


def stiffness(length: float, mass: float = HAMMER, speed: float = SPEED) -> float:
    """K [N/m^1.5] of Hertz's contact which a mass [kg] at a speed [m/s] closes for a time [s]."""
    return 1.25 * mass * float((2.943 / (length * speed**0.2)) ** 2.5)


@dataclass(frozen=True)
class Strokes:
    """Strokes at one place: levels of modes (n,), and of each stroke its impulse and length [s].

    Impulses are relative to the hardest; lengths are None where there is one stroke.
    """

    levels: Array
    impulses: Array
    lengths: tuple[float | None, ...]


def levels(f: Array, amplitudes: Array, errors: Array) -> Strokes:
    """What strokes at one place have in common; `amplitudes`, relative errors (strokes, n)."""
    n_strokes = len(amplitudes)
    hardest = int(np.argmax(np.sum(amplitudes**2, axis=1)))
    if n_strokes == 1:
        return Strokes(amplitudes[0], np.ones(1), (None,))
    with np.errstate(divide="ignore"):
        logs = np.where(amplitudes > 0.0, np.log(np.maximum(amplitudes, 1e-300)), -700.0)
    weights = 1.0 / (np.minimum(errors, 1e3) ** 2 + _KNOWN**2)
    shapes = np.log(np.maximum(np.stack([spectrum(f, one) for one in _TRIED]), 1e-3))
    sure = np.stack([f * one < _REACH for one in _TRIED])
    lengths = np.full(n_strokes, -1)
    best = np.inf
    others = [s for s in range(n_strokes) if s != hardest]
    for own in range(len(_TRIED)):  # the hardest stroke's; then each other's beside it
        chosen, cost = {hardest: own}, 0.0
        for s in others:
            costs = [
                _apart(
                    logs[s] - shapes[i] - logs[hardest] + shapes[own],
                    _both(weights[s], weights[hardest]) * (sure[i] & sure[own]),
                )
                for i in range(own, len(_TRIED))  # softer strokes last longer
            ]
            at = int(np.argmin(costs))
            chosen[s], cost = own + at, cost + costs[at]
        if cost < best:
            best = cost
            lengths[list(chosen)] = list(chosen.values())
    common = np.zeros((n_strokes, f.size))
    impulses = np.zeros(n_strokes)
    for s in range(n_strokes):
        common[s] = logs[s] - shapes[lengths[s]]
        known = _both(weights[s], weights[hardest]) * sure[lengths[s]]
        away = common[s] - (logs[hardest] - shapes[lengths[hardest]])
        impulses[s] = np.sum(known * away) / max(np.sum(known), 1e-300)
        common[s] -= impulses[s]
    share = weights * np.stack([np.maximum(sure[i], 1e-6) for i in lengths])
    mean = np.sum(share * common, axis=0) / np.sum(share, axis=0)
    return Strokes(np.exp(mean), np.exp(impulses), tuple(float(_TRIED[i]) for i in lengths))


def _both(a: Array, b: Array) -> Array:
    return a * b / (a + b)


def _apart(logs: Array, weights: Array) -> float:
    """How far levels differ, apart from a common factor; the fewer modes tell it, the less it is
    believed."""
    known = np.count_nonzero(weights)
    if known < max(_LEAST, logs.size / 3.0):
        return np.inf
    mean = np.sum(weights * logs) / np.sum(weights)
    square = float(np.sum(weights * (logs - mean) ** 2) / np.sum(weights))
    return (square + _KNOWN * _KNOWN) * (logs.size / known) ** 2
