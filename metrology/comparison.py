"""A gesture on a key and on its model, and two calibrations of keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from . import excitation, output_error
from .gesture import MeasurementError
from .parameters import INDEX, START

if TYPE_CHECKING:
    from .calibration_file import Calibration
    from .gesture import Floats, Gesture

_RATE = 44100 / 44  # ticks a second of the standard gesture
_SECONDS, _REACH, _MOST = 4.0, 5e-3, 20.0  # of the standard gesture: s, m, N
_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class Replay:
    """A gesture on a real key and on its model: n positions that count.

    `residual` (n,) [m] is real less model at the instants `t` (n,) [s]; `gesture` has the forces
    that were found where nobody knew them, `model` (ticks,) [m] is the model's path.
    """

    gesture: Gesture
    model: Floats
    t: Floats
    residual: Floats

    @property
    def rms(self) -> float:
        """Of the residual [m]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def most(self) -> float:
        """The greatest residual [m]."""
        return float(np.abs(self.residual).max())


def replay(row: Floats, gesture: Gesture) -> Replay:
    """Give a model the forces that a key was given, from where it rested."""
    start = gesture.start
    gesture = output_error.recovered(row, gesture, start)
    model = output_error.path(row, gesture, start)
    at = np.flatnonzero(gesture.counts)
    return Replay(gesture, model, at / gesture.rate, gesture.position[at] - model[at])


def replay_difference(one: Floats, other: Floats) -> float:
    """Rms of the difference [m] of two keys under a standard gesture of knocks."""
    guided = one.copy()
    guided[INDEX["stiffness"]] = max(one[1], 1e-3)
    force = excitation.knocks(guided, _RATE, _SECONDS, _REACH, _MOST)
    paths = []
    for row in (one, other):
        held = row.copy()
        # Each begins where it rests: what is judged is how it moves.
        held[START] = held[INDEX["weight"]] = 0.0
        paths.append(_core.key_path(held, force, _RATE, columns=())[0])
    return float(np.sqrt(np.mean((paths[0] - paths[1]) ** 2)))


def chi_squared(one: Calibration, other: Calibration) -> tuple[float, int]:
    """The sum of the squared differences over their variances, and of how many figures."""
    total, n = 0.0, 0
    for name, deviation in one.deviations.items():
        if name in other.deviations:
            apart = one.figures[name] - other.figures[name]
            total += apart**2 / (deviation**2 + other.deviations[name] ** 2)
            n += 1
    return total, n


def gains(plain: Calibration, loaded: Calibration, mass: float) -> tuple[float, float | None]:
    """What a device makes of forces and lengths, from a key without and with a weighed mass [kg].

    The first is G, the true mass over the one that was found; the second is what the device reads
    for a metre, None for a key that the mass does not sink. Raises MeasurementError.
    """
    heavier = loaded.figures["M"] - plain.figures["M"]
    if heavier <= 0:
        raise MeasurementError("the key with the mass was found no heavier than without it")
    gain = mass / heavier
    rests = (plain.figures.get("rest"), loaded.figures.get("rest"))
    if rests[0] is None or rests[1] is None:
        return gain, None
    sinks = abs(rests[1] - rests[0])
    wobble = 5 * sum(c.deviations.get("rest", 0.0) for c in (plain, loaded))
    # Dry friction holds a key anywhere near there; the fit knows the middle.
    reads = sinks * gain * plain.figures["K"] / (mass * _GRAVITY)
    return gain, float(reads) if sinks > max(wobble, 1e-9) else None
