"""Gestures that a key was measured by: the forces on it, and the positions it was read at."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ergon._core import Recording

    Floats = NDArray[np.float64]

_FRESH = 1  # of a recording's flags
_TICKS_MIN = 500
_STILL = 50  # ticks of a still beginning by which the sensor's noise is known


class MeasurementError(ErgonError):
    """Takes that no key can be measured by; the message is a sentence."""


@dataclass(frozen=True, slots=True)
class Gesture:
    """Forces on a key and its positions, by ticks; sizes: n ticks.

    `force` (n,) [N] is held from each tick to the next; `position` (n,) [m] is read at each tick's
    beginning; `counts` (n,) says which positions are compared with a model's. `rate` [Hz] is that
    of the ticks.
    """

    force: Floats
    position: Floats
    counts: NDArray[np.bool_]
    rate: float

    @property
    def still(self) -> int:
        """The number of ticks, at least one, before the force changes for the first time."""
        changes = np.flatnonzero(self.force != self.force[0])
        return int(changes[0]) if changes.size else self.force.size

    @property
    def start(self) -> float:
        """Mean position [m] before the force changes."""
        return float(self.position[: self.still].mean())

    def parted(self, share: float) -> tuple[Gesture, Gesture]:
        """The gesture twice: its first `share` counts in the one, the rest in the other."""
        first = np.arange(self.force.size) < share * self.force.size
        return (
            replace(self, counts=self.counts & first),
            replace(self, counts=self.counts & ~first),
        )


def of_arrays(force: Floats, position: Floats, rate: float) -> Gesture:
    """A gesture of forces (n,) [N] and positions (n,) [m]. Raises MeasurementError."""
    force, position = (np.ascontiguousarray(x, float) for x in (force, position))
    if force.shape != position.shape or force.ndim != 1:
        raise MeasurementError("forces and positions must be arrays of the same length")
    if force.size < _TICKS_MIN:
        raise MeasurementError(f"a take must have at least {_TICKS_MIN} ticks to measure a key by")
    if not (np.isfinite(force).all() and np.isfinite(position).all()):
        raise MeasurementError("forces and positions must be finite numbers")
    return Gesture(force, position, np.ones(force.size, bool), rate)


def of_recording(recording: Recording, axis: int) -> Gesture:
    """The gesture of one axis of a recording; a position held from a tick before does not count.

    Raises MeasurementError where the recording is too short, lacks ticks or holds no force.
    """
    ticks = recording.ticks()
    missing = int(ticks[-1] - ticks[0]) + 1 - ticks.size if ticks.size else 0
    if missing:
        raise MeasurementError(
            f"this take lacks {missing:,} ticks, and the forces of these are not known; "
            "measure by a take that is whole"
        )
    sent = recording.sent()[:, axis].astype(float)
    if not sent.any():
        raise MeasurementError(
            "this take holds no force that was sent to the key, and without one it does not tell "
            "what the key is made of"
        )
    rate = recording.rate / recording.frames
    found = of_arrays(sent, recording.positions()[:, axis], rate)
    fresh = recording.flags()[:, axis] & _FRESH != 0
    return replace(found, counts=fresh) if fresh.any() else found


def sensor_noise(gestures: list[Gesture]) -> float | None:
    """Standard deviation [m] of the sensor's noise; None where no gesture begins with rest."""
    # By second differences, which creep hardly changes: there white noise has 6 times its variance.
    parts = [np.diff(g.position[: g.still], 2) for g in gestures if g.still >= _STILL]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2) / 6)) if parts else None
