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

_FRESH = 1  # bit in a recording's flags
TICKS_MIN = 500
LATE = 0.1  # largest share of late ticks whose forces can be found
_OFF_GRID = 0.2  # deviation, in steps, above which there is no grid
_JITTER_TICKS = 5e-3  # replies nearer to their tick than this count as on it [ticks]
_REPLY_DISTANCE_MAX = 0.75  # largest distance of a reply from its tick [ticks]
_UNKNOWN_SHARE_MAX = 0.01  # share of a tick with an unknown force that can be ignored
_STILL_TICKS = 50  # ticks of a still beginning by which the sensor's noise is known


class MeasurementError(ErgonError):
    """Takes from which no key can be measured; the message is a sentence."""


@dataclass(frozen=True, slots=True)
class Unknown:
    """Unknown forces (q,): their ticks, and their lower and upper bounds [N]."""

    ticks: NDArray[np.int64]
    least: Floats
    greatest: Floats

    @property
    def middle(self) -> Floats:
        """The forces midway between the bounds (q,) [N]."""
        return 0.5 * (self.least + self.greatest)

    @property
    def spread(self) -> Floats:
        """Distance of the bounds from the middle (q,) [N]."""
        return 0.5 * (self.greatest - self.least)


_NO_UNKNOWN = Unknown(np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Gesture:
    """Forces on a key and its positions, by ticks; sizes: n ticks.

    `force` (n,) [N] is held from each tick to the next; `position` (n,) [m] is read at each
    tick's beginning; `counts` (n,) says which positions are compared with a model's. `rate` [Hz]
    is that of the ticks. `unknown` are forces at ticks whose packets or rows were lost or late:
    there `force` is a guess, and a fit finds the value. `read` holds the sensor's readings if
    `position` was interpolated to other instants.
    """

    force: Floats
    position: Floats
    counts: NDArray[np.bool_]
    rate: float
    unknown: Unknown = _NO_UNKNOWN
    read: Floats | None = None

    def with_forces(self, forces: Floats) -> Gesture:
        """The gesture with other forces [N] at its unknown ticks."""
        force = self.force.copy()
        force[self.unknown.ticks] = forces
        return replace(self, force=force)

    @property
    def still(self) -> int:
        """The number of ticks, at least one, before the force changes for the first time.

        The force of the first tick does not count: it may stand for a speed.
        """
        changes = 1 + np.flatnonzero(self.force[1:] != self.force[1])
        changes = np.union1d(changes, self.unknown.ticks[self.unknown.ticks > 0])
        return int(changes[0]) if changes.size else self.force.size

    @property
    def start(self) -> float:
        """Mean position [m] before the force changes."""
        return float(self.position[: self.still].mean())

    def with_unknown_speed(self) -> Gesture:
        """The gesture of a key that need not begin at rest.

        The force of the first tick becomes unknown, up to the greatest force of the gesture: the
        push of one tick stands for the speed at which the key begins.
        """
        strongest = float(np.abs(self.force).max())
        ticks, least, greatest = self.unknown.ticks, self.unknown.least, self.unknown.greatest
        if strongest == 0.0 or 0 in ticks:
            return self
        unknown_with_first = Unknown(
            np.concatenate([[0], ticks]),
            np.concatenate([[self.force[0] - strongest], least]),
            np.concatenate([[self.force[0] + strongest], greatest]),
        )
        return replace(self, unknown=unknown_with_first)

    def parted(self, share: float) -> tuple[Gesture, Gesture]:
        """The gesture twice: in the first copy its first `share` counts, in the second the rest."""
        is_in_first_part = np.arange(self.force.size) < share * self.force.size
        return (
            replace(self, counts=self.counts & is_in_first_part),
            replace(self, counts=self.counts & ~is_in_first_part),
        )


def gesture_from_arrays(push_forces: Floats, key_positions: Floats, rate: float) -> Gesture:
    """A gesture from forces (n,) [N] and positions (n,) [m]. Raises MeasurementError."""
    push_forces, key_positions = (
        np.ascontiguousarray(x, float) for x in (push_forces, key_positions)
    )
    if push_forces.shape != key_positions.shape or push_forces.ndim != 1:
        raise MeasurementError("forces and positions must be arrays of the same length")
    if push_forces.size < TICKS_MIN:
        raise MeasurementError(f"a take must have at least {TICKS_MIN} ticks to measure a key by")
    if not (np.isfinite(push_forces).all() and np.isfinite(key_positions).all()):
        raise MeasurementError("forces and positions must be finite numbers")
    return Gesture(push_forces, key_positions, np.ones(push_forces.size, bool), rate)


def gesture_from_rows(
    ticks: NDArray[np.integer],
    sent: Floats,
    key_positions: Floats,
    fresh: NDArray[np.bool_],
    clock: NDArray[np.uint32],
    rate: float,
    is_known: NDArray[np.bool_] | None = None,
    is_force_known: NDArray[np.bool_] | None = None,
) -> Gesture:
    """A gesture from ticks (n,): forces [N], position [m], the device's clock [us] of each reply.

    `is_known` (n,) says at which ticks the force is certain; by default at those with a reply.
    `is_force_known` (n,) says at which ticks `sent` holds the force sent; by default at all.

    A force acts from the reply before its own on, because in lockstep a reply comes after the
    force has acted; otherwise the delay is a tick longer. A tick without a reply has no position
    that counts. If replies are not in step with the ticks of the device's clock, the force of a
    tick is the mean of the forces that acted in it, and its position is extrapolated from the
    nearest reply at the key's speed.
    Raises MeasurementError.
    """
    sent, fresh = np.asarray(sent, float), np.asarray(fresh)
    is_measured = np.asarray(fresh if is_known is None else is_known)
    exact_ticks = _instants(np.asarray(ticks, np.int64), fresh, np.asarray(clock), rate)
    # Of two replies within one tick of the device, the later one counts.
    tick_numbers = np.maximum.accumulate(np.round(exact_ticks).astype(np.int64))
    n = int(tick_numbers[-1]) + 1
    reply_indices = np.searchsorted(tick_numbers, np.arange(1, n + 1), side="right") - 1
    tick_forces, tick_positions = sent[reply_indices], np.zeros(n)
    tick_positions[tick_numbers], counts = key_positions, np.zeros(n, bool)
    counts[tick_numbers] = fresh
    last_read_tick = np.maximum.accumulate(
        np.where(np.isin(np.arange(n), tick_numbers), np.arange(n), 0)
    )
    gesture = replace(
        gesture_from_arrays(tick_forces, tick_positions[last_read_tick], rate), counts=counts
    )
    tick_offsets = (exact_ticks - tick_numbers)[fresh]
    if np.sqrt(np.mean(tick_offsets**2)) >= _JITTER_TICKS:
        tick_numbers = np.maximum.accumulate(exact_ticks)
        gesture = _retimed(gesture, tick_numbers, sent, np.asarray(key_positions), fresh)
    least, greatest = sent.copy(), sent.copy()
    if is_force_known is not None and is_force_known.any():
        least[~is_force_known], greatest[~is_force_known] = (
            sent[is_force_known].min(),
            sent[is_force_known].max(),
        )
    unknown = _unknown(tick_numbers - 1.0, (least, greatest), is_measured, n)
    return replace(gesture, unknown=unknown).with_forces(unknown.middle)


def _retimed(
    gesture: Gesture,
    reply_ticks: Floats,
    sent: Floats,
    reply_positions: Floats,
    fresh: NDArray[np.bool_],
) -> Gesture:
    """The gesture resampled from replies at instants `reply_ticks` (k,) [ticks] between its "
    "ticks."""
    n = gesture.force.size
    tick_edges = np.arange(n + 1.0)
    replies, positions = reply_ticks[fresh], reply_positions[fresh]
    # Two replies at the same instant give no speed.
    is_later = np.concatenate([[True], np.diff(replies) > 0])
    replies, positions = replies[is_later], positions[is_later]
    speed = np.gradient(positions, replies)
    nearest_replies = np.round(np.interp(tick_edges[:-1], replies, np.arange(replies.size))).astype(
        np.int64
    )
    reply_offsets = tick_edges[:-1] - replies[nearest_replies]
    return replace(
        gesture,
        force=_means(reply_ticks - 1.0, sent, tick_edges),
        position=positions[nearest_replies] + speed[nearest_replies] * reply_offsets,
        counts=gesture.counts & (np.abs(reply_offsets) < _REPLY_DISTANCE_MAX),
        read=positions,
    )


def _unknown(
    begins: Floats, sent: tuple[Floats, Floats], is_known: NDArray[np.bool_], n: int
) -> Unknown:
    """The unknown forces of n ticks, by the least and the most force that was sent (k,).

    A device holds a force until it receives the next one: between two ticks with replies only
    forces that were sent can have acted. If many ticks are unknown, replies were late rather
    than lost, and all forces count as known.
    """
    unknown_shares = _means(begins, (~is_known).astype(float), np.arange(n + 1.0))
    ticks = np.flatnonzero(unknown_shares > _UNKNOWN_SHARE_MAX)
    if ticks.size > LATE * n:
        return _NO_UNKNOWN
    last_known = np.maximum.accumulate(np.where(is_known, np.arange(is_known.size), 0))
    first_begin = last_known[np.maximum(np.searchsorted(begins, ticks, side="right") - 1, 0)]
    last_begin = np.minimum(np.searchsorted(begins, ticks + 1, side="left"), begins.size - 1)
    acting_rows = [slice(i, j + 1) for i, j in zip(first_begin, last_begin, strict=True)]
    least = np.array([sent[0][rows].min() for rows in acting_rows])
    greatest = np.array([sent[1][rows].max() for rows in acting_rows])
    is_uncertain = greatest > least
    return Unknown(ticks[is_uncertain], least[is_uncertain], greatest[is_uncertain])


def _means(begins: Floats, interval_values: Floats, edges: Floats) -> Floats:
    """Means (n,) between edges (n + 1,) of values (k,), each of which holds from its begin on."""
    first_instant, last_instant = min(begins[0], edges[0]), max(begins[-1], edges[-1])
    interval_edges = np.concatenate([[first_instant], begins[1:], [last_instant]])
    cumulative_values = np.concatenate(
        [[0.0], np.cumsum(interval_values * np.diff(interval_edges))]
    )
    return np.asarray(np.diff(np.interp(edges, interval_edges, cumulative_values)) / np.diff(edges))


def _instants(
    ticks: NDArray[np.int64], fresh: NDArray[np.bool_], clock: NDArray[np.uint32], rate: float
) -> Floats:
    """The instant of each reply (n,) [ticks] in the device's own time, the first near 0.

    This shows when the host was late. Without a clock: the host's own count of ticks.
    """
    ticks = ticks - ticks[0]
    clocked_rows = np.flatnonzero(fresh & (clock != 0))
    if clocked_rows.size < max(2, ticks.size // 2):
        return ticks.astype(float)
    ticks_passed = np.concatenate(
        [[0], np.cumsum(np.diff(clock[clocked_rows]).astype(np.int64))]
    )  # the counter wraps
    ticks_passed = ticks_passed * 1e-6 * rate
    # A clock that does not fit the count of ticks belongs to something else, or counts differently.
    if not np.all(np.abs(np.diff(ticks_passed)) < 1000):
        return ticks.astype(float)
    phase = np.angle(np.mean(np.exp(2j * np.pi * ticks_passed))) / (2 * np.pi)
    clock_instants = ticks_passed - phase
    clocked_instants = clock_instants - round(clock_instants[0]) + ticks[clocked_rows[0]]
    return np.asarray(np.interp(np.arange(ticks.size), clocked_rows, clocked_instants))


def gesture_from_recording(
    recording: Recording, device_axis: int, *, loses_requests: bool = True, force_step: float = 0.0
) -> Gesture:
    """The gesture of one axis of a recording; a position repeated from the tick before does not
    count.

    If it `loses_requests`, a tick without a reply may be one whose request was lost: the device
    then held the force before. The force of a tick without a row is never known. `force_step` [N]
    is the step to which the motor rounds the forces of the wire; 0: it does not round. Raises
    MeasurementError if the recording is too short, lacks many ticks or holds no force.
    """
    sent = recording.sent()[:, device_axis].astype(float)
    strongest = float(np.abs(sent).max(initial=0.0))
    if force_step > 0.0:
        sent = np.round(sent / force_step) * force_step
        if strongest and not sent.any():
            raise MeasurementError(
                f"a motor with a step of {force_step * 1e3:.4g} mN makes no force of this take, "
                f"whose strongest is {strongest * 1e3:.4g} mN; give the step of this motor"
            )
    if not sent.any():
        raise MeasurementError(
            "this take has no force that was sent to the key, so the key cannot be measured by it; "
            "use a take of `ergon metrology DEVICE`"
        )
    ticks = recording.ticks()
    fresh = recording.flags()[:, device_axis] & _FRESH != 0
    # A tick without a row is also a tick without a reply.
    all_ticks = np.arange(ticks[0], ticks[-1] + 1)
    if all_ticks.size - ticks.size > LATE * all_ticks.size:
        raise MeasurementError(
            f"this take lacks {all_ticks.size - ticks.size:,} of {all_ticks.size:,} ticks, too "
            "many to "
            "find the forces that nobody knows"
        )
    reply_rows = np.searchsorted(ticks, all_ticks, side="right") - 1
    has_row = ticks[reply_rows] == all_ticks
    replied = (fresh if fresh.any() else np.ones_like(fresh))[reply_rows] & has_row
    return gesture_from_rows(
        all_ticks,
        sent[reply_rows],
        recording.positions()[reply_rows, device_axis],
        replied,
        np.where(has_row, recording.clocks()[reply_rows, device_axis], 0).astype(np.uint32),
        recording.rate / recording.frames,
        replied if loses_requests else has_row,
        has_row,
    )


def sensor_noise(gestures: Sequence[Gesture]) -> float | None:
    """Standard deviation [m] of the sensor's noise; None where no gesture begins with rest.

    It is at least that of the sensor's rounding, which a still key does not show.
    """
    # Second differences suppress slow creep; for white noise their variance is 6 times that of the
    # noise.
    still_differences = [
        np.diff(g.position[: g.still], 2) for g in gestures if g.still >= _STILL_TICKS
    ]
    if not still_differences:
        return None
    rounding = (sensor_step(gestures) or 0.0) / np.sqrt(12)
    return max(float(np.sqrt(np.mean(np.concatenate(still_differences) ** 2) / 6)), float(rounding))


def sensor_step(gestures: Sequence[Gesture]) -> float | None:
    """Step [m] of the sensor: the grid on which positions lie; None if there is no grid."""
    positions_by_gesture = [g.position[g.counts] if g.read is None else g.read for g in gestures]
    positions = np.unique(np.concatenate(positions_by_gesture))
    steps = np.diff(positions)
    steps = steps[steps > 1e-6 * np.ptp(positions)]  # else the same, but for rounding
    if not steps.size:
        return None
    step_numbers = np.round((positions - positions[0]) / steps.min())
    if np.abs((positions - positions[0]) / steps.min() - step_numbers).max() > _OFF_GRID:
        return None
    return float((positions - positions[0]) @ step_numbers / (step_numbers @ step_numbers))
