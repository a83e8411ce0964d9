"""Gestures by which a key was measured: the forces on it, and the positions read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ergon._core import Recording

    Floats = NDArray[np.float64]

_FRESH_FLAG = 1  # bit in a recording's flags
TICKS_MIN = 500
LATE_SHARE_MAX = 0.1  # largest share of late ticks whose forces can be found
_GRID_DEVIATION_MAX = 0.2  # deviation, in steps, above which there is no grid
_JITTER_TICKS = 5e-3  # replies nearer to their tick than this count as on it [ticks]
_REPLY_DISTANCE_MAX = 0.75  # largest distance of a reply from its tick [ticks]
_UNKNOWN_SHARE_MIN = 0.01  # share of a tick with an unknown force that can be ignored
_STILL_TICKS = 50  # ticks of a still beginning by which the sensor's noise is known


class MeasurementError(ErgonError):
    """Takes from which no key can be measured; the message is a sentence."""


@dataclass(frozen=True, slots=True)
class UnknownForces:
    """Unknown forces (q,): their ticks, and their lower and upper bounds [N]."""

    ticks: NDArray[np.int64]
    lower: Floats
    upper: Floats

    @property
    def middle(self) -> Floats:
        """The forces midway between the bounds (q,) [N]."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half_range(self) -> Floats:
        """Distance of the bounds from the middle (q,) [N]."""
        return 0.5 * (self.upper - self.lower)


_NO_UNKNOWN_FORCES = UnknownForces(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Gesture:
    """Forces on a key and its positions, by ticks; sizes: n ticks.

    `force` (n,) [N] is held from each tick to the next; `position` (n,) [m] is read at each tick's
    beginning; `is_compared` (n,) says which positions are compared with a model's. `rate` [Hz] is
    that of the ticks. `unknown_forces` are forces at ticks whose packets or rows were lost or late:
    there `force` is a guess, and a fit finds the value. `readings` holds the sensor's readings if
    `position` was interpolated to other instants.
    """

    force: Floats
    position: Floats
    is_compared: NDArray[np.bool_]
    rate: float
    unknown_forces: UnknownForces = _NO_UNKNOWN_FORCES
    readings: Floats | None = None

    def with_forces(self, forces: Floats) -> Gesture:
        """The gesture with other forces [N] at its unknown ticks."""
        force = self.force.copy()
        force[self.unknown_forces.ticks] = forces
        return replace(self, force=force)

    @property
    def n_still(self) -> int:
        """The number of ticks, at least one, before the force changes for the first time.

        The force of the first tick does not count: it may stand for a speed.
        """
        changes = 1 + np.flatnonzero(self.force[1:] != self.force[1])
        changes = np.union1d(changes, self.unknown_forces.ticks[self.unknown_forces.ticks > 0])
        return int(changes[0]) if changes.size else self.force.size

    @property
    def start(self) -> float:
        """Mean position [m] before the force changes."""
        return float(self.position[: self.n_still].mean())

    def with_unknown_speed(self) -> Gesture:
        """The gesture of a key that need not begin at rest.

        The force of the first tick becomes unknown, up to the greatest force of the gesture: the
        push of one tick stands for the speed at which the key begins.
        """
        force_max = float(np.abs(self.force).max())
        ticks, lower, upper = (
            self.unknown_forces.ticks,
            self.unknown_forces.lower,
            self.unknown_forces.upper,
        )
        if force_max == 0.0 or 0 in ticks:
            return self
        unknown = UnknownForces(
            np.concatenate([[0], ticks]),
            np.concatenate([[self.force[0] - force_max], lower]),
            np.concatenate([[self.force[0] + force_max], upper]),
        )
        return replace(self, unknown_forces=unknown)

    def split(self, fraction: float) -> tuple[Gesture, Gesture]:
        """The gesture twice: its first `fraction` counts in one copy, the rest in the other."""
        is_first = np.arange(self.force.size) < fraction * self.force.size
        return (
            replace(self, is_compared=self.is_compared & is_first),
            replace(self, is_compared=self.is_compared & ~is_first),
        )


def gesture_from_arrays(forces: Floats, positions: Floats, rate: float) -> Gesture:
    """A gesture from forces (n,) [N] and positions (n,) [m]. Raises MeasurementError."""
    forces, positions = (np.ascontiguousarray(x, float) for x in (forces, positions))
    if forces.shape != positions.shape or forces.ndim != 1:
        raise MeasurementError("forces and positions must be arrays of the same length")
    if forces.size < TICKS_MIN:
        raise MeasurementError(f"a take must have at least {TICKS_MIN} ticks to measure a key by")
    if not (np.isfinite(forces).all() and np.isfinite(positions).all()):
        raise MeasurementError("forces and positions must be finite numbers")
    return Gesture(forces, positions, np.ones(forces.size, bool), rate)


def gesture_from_rows(
    ticks: NDArray[np.integer],
    forces: Floats,
    positions: Floats,
    has_reply: NDArray[np.bool_],
    clocks: NDArray[np.uint32],
    rate: float,
    is_known: NDArray[np.bool_] | None = None,
    is_force_known: NDArray[np.bool_] | None = None,
) -> Gesture:
    """A gesture from ticks (n,): forces [N], position [m], the device's clock [us] of each reply.

    `is_known` (n,) says at which ticks the force is certain; by default at those with a reply.
    `is_force_known` (n,) says at which ticks `forces` holds the force sent; by default at all.

    A force acts from the reply before its own on, because in lockstep a reply comes after the
    force has acted; otherwise the delay is a tick longer. A tick without a reply has no position
    that counts. If replies are not in step with the ticks of the device's clock, the force of a
    tick is the mean of the forces that acted in it, and its position is extrapolated from the
    nearest reply at the key's speed.
    Raises MeasurementError.
    """
    forces, has_reply = np.asarray(forces, float), np.asarray(has_reply)
    is_certain = np.asarray(has_reply if is_known is None else is_known)
    reply_times = _reply_times(np.asarray(ticks, np.int64), has_reply, np.asarray(clocks), rate)
    # Of two replies within one tick of the device, the later one counts.
    tick_numbers = np.maximum.accumulate(np.round(reply_times).astype(np.int64))
    n_ticks = int(tick_numbers[-1]) + 1
    reply_indices = np.searchsorted(tick_numbers, np.arange(1, n_ticks + 1), side="right") - 1
    tick_forces, tick_positions = forces[reply_indices], np.zeros(n_ticks)
    tick_positions[tick_numbers], is_counted = positions, np.zeros(n_ticks, bool)
    is_counted[tick_numbers] = has_reply
    last_reply_tick = np.maximum.accumulate(
        np.where(np.isin(np.arange(n_ticks), tick_numbers), np.arange(n_ticks), 0)
    )
    gesture = replace(
        gesture_from_arrays(tick_forces, tick_positions[last_reply_tick], rate),
        is_compared=is_counted,
    )
    begin_instants = tick_numbers - 1.0
    tick_offsets = (reply_times - tick_numbers)[has_reply]
    if np.sqrt(np.mean(tick_offsets**2)) >= _JITTER_TICKS:
        reply_instants = np.maximum.accumulate(reply_times)
        begin_instants = reply_instants - 1.0
        gesture = _resampled(gesture, reply_instants, forces, np.asarray(positions), has_reply)
    lower, upper = forces.copy(), forces.copy()
    if is_force_known is not None and is_force_known.any():
        lower[~is_force_known], upper[~is_force_known] = (
            forces[is_force_known].min(),
            forces[is_force_known].max(),
        )
    unknown = _unknown_forces(begin_instants, (lower, upper), is_certain, n_ticks)
    return replace(gesture, unknown_forces=unknown).with_forces(unknown.middle)


def _resampled(
    gesture: Gesture,
    reply_times: Floats,
    forces: Floats,
    reply_positions: Floats,
    has_reply: NDArray[np.bool_],
) -> Gesture:
    """The gesture resampled from replies at instants `reply_times` (k,) [ticks] between its
    ticks.
    """
    n_ticks = gesture.force.size
    tick_edges = np.arange(n_ticks + 1.0)
    reply_instants, positions = reply_times[has_reply], reply_positions[has_reply]
    # Two replies at the same instant give no speed.
    is_later = np.concatenate([[True], np.diff(reply_instants) > 0])
    reply_instants, positions = reply_instants[is_later], positions[is_later]
    speed = np.gradient(positions, reply_instants)
    nearest_replies = np.round(
        np.interp(tick_edges[:-1], reply_instants, np.arange(reply_instants.size))
    ).astype(np.int64)
    reply_offsets = tick_edges[:-1] - reply_instants[nearest_replies]
    return replace(
        gesture,
        force=_interval_means(reply_times - 1.0, forces, tick_edges),
        position=positions[nearest_replies] + speed[nearest_replies] * reply_offsets,
        is_compared=gesture.is_compared & (np.abs(reply_offsets) < _REPLY_DISTANCE_MAX),
        readings=positions,
    )


def _unknown_forces(
    begin_instants: Floats, bounds: tuple[Floats, Floats], is_known: NDArray[np.bool_], n_ticks: int
) -> UnknownForces:
    """The unknown forces of n ticks, by the least and the most force that was sent (k,).

    A device holds a force until it receives the next one: between two ticks with replies only
    forces that were sent can have acted. If many ticks are unknown, replies were late rather
    than lost, and all forces count as known.
    """
    unknown_shares = _interval_means(
        begin_instants, (~is_known).astype(float), np.arange(n_ticks + 1.0)
    )
    ticks = np.flatnonzero(unknown_shares > _UNKNOWN_SHARE_MIN)
    if ticks.size > LATE_SHARE_MAX * n_ticks:
        return _NO_UNKNOWN_FORCES
    last_known_index = np.maximum.accumulate(np.where(is_known, np.arange(is_known.size), 0))
    first_rows = last_known_index[
        np.maximum(np.searchsorted(begin_instants, ticks, side="right") - 1, 0)
    ]
    last_rows = np.minimum(
        np.searchsorted(begin_instants, ticks + 1, side="left"), begin_instants.size - 1
    )
    ranges = [slice(i, j + 1) for i, j in zip(first_rows, last_rows, strict=True)]
    lower = np.array([bounds[0][rows].min() for rows in ranges])
    upper = np.array([bounds[1][rows].max() for rows in ranges])
    is_uncertain = upper > lower
    return UnknownForces(ticks[is_uncertain], lower[is_uncertain], upper[is_uncertain])


def _interval_means(begin_instants: Floats, values: Floats, edges: Floats) -> Floats:
    """Means (n,) between edges (n + 1,) of values (k,), each of which holds from its begin on."""
    first_instant, last_instant = (
        min(begin_instants[0], edges[0]),
        max(begin_instants[-1], edges[-1]),
    )
    interval_edges = np.concatenate([[first_instant], begin_instants[1:], [last_instant]])
    cumulative_values = np.concatenate([[0.0], np.cumsum(values * np.diff(interval_edges))])
    return np.asarray(np.diff(np.interp(edges, interval_edges, cumulative_values)) / np.diff(edges))


def _reply_times(
    ticks: NDArray[np.int64], has_reply: NDArray[np.bool_], clocks: NDArray[np.uint32], rate: float
) -> Floats:
    """The instant of each reply (n,) [ticks] in the device's own time, the first near 0.

    This shows when the host was late. Without a clock: the host's own count of ticks.
    """
    ticks = ticks - ticks[0]
    clocked_rows = np.flatnonzero(has_reply & (clocks != 0))
    if clocked_rows.size < max(2, ticks.size // 2):
        return ticks.astype(float)
    device_ticks = np.concatenate(
        [[0], np.cumsum(np.diff(clocks[clocked_rows]).astype(np.int64))]
    )  # the counter wraps
    device_ticks = device_ticks * 1e-6 * rate
    # A clock that does not fit the count of ticks belongs to something else, or counts differently.
    if not np.all(np.abs(np.diff(device_ticks)) < 1000):
        return ticks.astype(float)
    phase = np.angle(np.mean(np.exp(2j * np.pi * device_ticks))) / (2 * np.pi)
    clock_instants = device_ticks - phase
    times = clock_instants - round(clock_instants[0]) + ticks[clocked_rows[0]]
    return np.asarray(np.interp(np.arange(ticks.size), clocked_rows, times))


def gesture_from_recording(
    recording: Recording, axis: int, *, loses_requests: bool = True, force_step: float = 0.0
) -> Gesture:
    """The gesture of one axis of a recording; a position repeated from the tick before does not
    count.

    If it `loses_requests`, a tick without a reply may be one whose request was lost: the device
    then held the force before. The force of a tick without a row is never known. `force_step` [N]
    is the step to which the motor rounds the forces of the wire; 0: it does not round. Raises
    MeasurementError if the recording is too short, lacks many ticks or holds no force.
    """
    forces = recording.sent()[:, axis].astype(float)
    force_max = float(np.abs(forces).max(initial=0.0))
    if force_step > 0.0:
        forces = np.round(forces / force_step) * force_step
        if force_max and not forces.any():
            raise MeasurementError(
                f"a motor with a step of {force_step * 1e3:.4g} mN makes no force of this take, "
                f"whose strongest is {force_max * 1e3:.4g} mN; give the step of this motor"
            )
    if not forces.any():
        raise MeasurementError(
            "this take has no force that was sent to the key, so the key cannot be measured by it; "
            "use a take of `ergon metrology DEVICE`"
        )
    ticks = recording.ticks()
    has_fresh_reply = recording.flags()[:, axis] & _FRESH_FLAG != 0
    # A tick without a row is also a tick without a reply.
    tick_numbers = np.arange(ticks[0], ticks[-1] + 1)
    if tick_numbers.size - ticks.size > LATE_SHARE_MAX * tick_numbers.size:
        raise MeasurementError(
            f"this take lacks {tick_numbers.size - ticks.size:,} of {tick_numbers.size:,} ticks, "
            "too many to find the forces that nobody knows"
        )
    reply_rows = np.searchsorted(ticks, tick_numbers, side="right") - 1
    has_row = ticks[reply_rows] == tick_numbers
    has_reply = (has_fresh_reply if has_fresh_reply.any() else np.ones_like(has_fresh_reply))[
        reply_rows
    ] & has_row
    return gesture_from_rows(
        tick_numbers,
        forces[reply_rows],
        recording.positions()[reply_rows, axis],
        has_reply,
        np.where(has_row, recording.clocks()[reply_rows, axis], 0).astype(np.uint32),
        recording.rate / recording.frames,
        has_reply if loses_requests else has_row,
        has_row,
    )


def sensor_noise(gestures: Sequence[Gesture]) -> float | None:
    """Standard deviation [m] of the sensor's noise; None where no gesture begins with rest.

    It is at least that of the sensor's rounding, which a still key does not show.
    """
    # Second differences suppress slow creep; for white noise their variance is 6 times that of the
    # noise.
    still_differences = [
        np.diff(g.position[: g.n_still], 2) for g in gestures if g.n_still >= _STILL_TICKS
    ]
    if not still_differences:
        return None
    rounding = (sensor_step(gestures) or 0.0) / np.sqrt(12)
    return max(float(np.sqrt(np.mean(np.concatenate(still_differences) ** 2) / 6)), float(rounding))


def sensor_step(gestures: Sequence[Gesture]) -> float | None:
    """Step [m] of the sensor: the grid on which positions lie; None if there is no grid."""
    positions_by_gesture = [
        g.position[g.is_compared] if g.readings is None else g.readings for g in gestures
    ]
    positions = np.unique(np.concatenate(positions_by_gesture))
    steps = np.diff(positions)
    steps = steps[steps > 1e-6 * np.ptp(positions)]  # else the same, but for rounding
    if not steps.size:
        return None
    step_numbers = np.round((positions - positions[0]) / steps.min())
    if np.abs((positions - positions[0]) / steps.min() - step_numbers).max() > _GRID_DEVIATION_MAX:
        return None
    return float((positions - positions[0]) @ step_numbers / (step_numbers @ step_numbers))
