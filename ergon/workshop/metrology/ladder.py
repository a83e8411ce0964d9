"""The search for forces that measure an unknown key without reaching an end of its travel.

First come jolts, as short and weak as possible, which show the direction of the motor and the
approximate mass. Then come rungs of two seconds, from a twentieth of the force on, each at most
twice as strong as the one before. A guide holds a key that has no spring in its place; a brake
acts near an end.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from . import excitation
from .first_guess import first_guess, signed_mass
from .gesture import MeasurementError, gesture_from_rows
from .output_error import fit
from .parameters import INDEX

if TYPE_CHECKING:
    from collections.abc import Callable

    from ergon._core import Device, ExcitationRecord

    from .gesture import Floats, Gesture

FRAMES, RATE = 44, 44100.0  # frames of a tick, and the audio rate
TICK_RATE = RATE / FRAMES
RUNG_DURATION = 2.0  # s
_FIRST_SHARE, _LAST_SHARE = 0.05, 0.9  # of the force
_RUNGS_MAX = 12
_EXCURSION_RATIO_MIN = 0.4  # excursion, over half the travel, of the last rung
_EXCURSION_RATIO_TARGET = 0.55  # target of the next rung, over half the travel
_BRAKED_RUNGS_MAX = 3  # rungs that were braked, until no further one is tried
_RAIN_SHARE = 0.3  # of the force of a rung
# The guide: the frequency of its pole [rad/s] and its damping ratio. It is stable with a delay of
# 10 ms.
_GUIDE_FREQUENCY, _GUIDE_DAMPING_RATIO = 12.0, 0.8
_BRAKE_STIFFNESS, _BRAKE_DAMPING = 3.0, 45.0  # of the guide's; 1/s of the mass
_STIFFNESS_PER_MASS_MAX = 40.0  # (rad/s)²: with a faster spring of its own a key needs no guide
_END_DISTANCE_MIN = 0.35  # of half the range: a key that rests nearer to an end has no room
# Jolts show the direction of the motor and the approximate mass.
_JOLT_DURATION = 0.6  # s
_FIRST_JOLT_SHARE, _JOLT_SHARE_MAX = 0.01, 0.8  # of the force
_JOLT_EXCURSION_RATIO = 0.2  # excursion, over half the travel, of the last jolt
_MASS_CERTAINTY_MIN = 15.0  # the mass over its deviation, from which on it is believed
_JOLT_LENGTH_RATIO_MAX = 6.0  # times the length of the first jolts, at most
_TIMELY_SHARE_MIN = 0.75  # smallest share of ticks with a reply in time
_SETTLING_DURATION_MAX = 3.0  # s at most, until a key rests

# Why a take ended, and what the user can do.
_END_MESSAGES = {
    "touched": "a hand touched the key, so its force is zero; let go of it and measure again",
    "gate closed": "the device lets no force through but while a hand touches the key, "
    "and nobody may touch it; measure with a firmware without that gate, and --no-gate",
    "not finite": "the device sent a position that is not a number, so its force is zero",
    "unplugged": "the device was unplugged, or its program ended",
    "silent": "the device no longer answers",
    "shared": "another program sends forces to the device",
    "stopped": "stopped; the force is zero",
    "late": "too few replies of the device came in time; close other programs on this machine",
    "tripped: not finite": "a position or force was not a number, so the force is zero",
    "tripped: speed": "the key went too fast, so its force is zero",
    "tripped: wrong way": "the motor pushes in the wrong direction, so its force is zero",
    "tripped: at stop": "the key was pushed into an end of its travel, so its force is zero",
    "tripped: frozen": "the sensor shows one position whatever the force is, so the force is zero",
    "tripped: unanswered": "the key does not answer its motor, so the force is zero",
    "tripped: late": "the force or the position comes too late, so the force is zero",
    "tripped: outside travel": "the position is outside the travel of the key, so the force is "
    "zero; find its ends by `ergon devices calibrate`",
    "tripped: jump": "the position jumped as no force could move the key, so the force is zero",
}


class TakeEnded(MeasurementError):
    """A take that ended early; the message says why and what to do."""

    def __init__(self, end_reason: str) -> None:
        """`end_reason` is that of `_core.ExcitationRecord`."""
        super().__init__(_END_MESSAGES.get(end_reason, end_reason))
        self.end_reason = end_reason


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis to measure, and the properties of its device.

    `sign` reverses forces if -1; `force_step` [N] is the motor's step if the protocol does not
    give it; `is_gated` is false for a device whose touch gate is ignored.
    """

    device: Device
    number: int = 0
    sign: int = 1
    force_step: float = 0.0
    tells_touch: bool = True
    is_gated: bool = True
    force_max: float | None = None

    @property
    def request_max(self) -> float:
        """The greatest force that is requested [N]."""
        force_limit = min(self.device.force_max, 1.2 * self.device.force_continuous)
        return force_limit if self.force_max is None else min(force_limit, self.force_max)


@dataclass(frozen=True, slots=True)
class Guide:
    """The centre at which a key is kept, half its travel there [m], and the springs and dampers of
    guide and brake.
    """

    centre: float
    half_travel: float
    guide_spring_damper: tuple[float, float]
    brake_spring_damper: tuple[float, float]
    deceleration: float

    def core_arguments(
        self,
    ) -> tuple[float, float, tuple[float, float], tuple[float, float], float]:
        """The guide as arguments of `_core.excite`."""
        return (
            self.centre,
            self.half_travel,
            self.guide_spring_damper,
            self.brake_spring_damper,
            self.deceleration,
        )

    @property
    def without_guide(self) -> Guide:
        """The brake alone."""
        return replace(self, guide_spring_damper=(0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Rung:
    """A rung of the ladder: its force [N], the excursion of the key [m], and whether it was
    braked.
    """

    force: float
    excursion: float
    is_braked: bool


@dataclass(slots=True)
class Ladder:
    """The result of the ladder: the axis with the motor's sign, the guide, a rough key, the
    rungs.
    """

    axis: Axis
    guide: Guide
    needs_guide: bool
    rough_parameters: Floats
    rungs: list[Rung] = field(default_factory=list)

    @property
    def force(self) -> float:
        """The force of the strongest rung that was not braked, or of the weakest [N]."""
        unbraked_forces = [rung.force for rung in self.rungs if not rung.is_braked]
        return max(unbraked_forces) if unbraked_forces else min(rung.force for rung in self.rungs)


# Safety stages compare force and motion for keys that are played. Under rain a key in good order
# may fail them.
SAFETY_ENDS = (
    "tripped: wrong way",
    "tripped: unanswered",
    "tripped: late",
    "tripped: frozen",
    "tripped: at stop",
    "tripped: speed",
)


def push(
    axis: Axis,
    forces: Floats,
    guide: Guide,
    n_still: int = 0,
    record: _core.RecordTarget | None = None,
    *,
    accepts_safety_ends: bool = False,
) -> ExcitationRecord:
    """Push a key by forces (n,) [N]. Raises TakeEnded if that ends early.

    With `accepts_safety_ends` it does not raise if a safety stage stopped the axis because force
    and motion disagreed.
    """
    excited = _core.excite(
        axis.device,
        axis.number,
        np.ascontiguousarray(forces, float),
        RATE,
        FRAMES,
        guide.core_arguments(),
        sign=axis.sign,
        unguided_ticks=n_still,
        force_step=axis.force_step,
        tells_touch=axis.tells_touch,
        is_gated=axis.is_gated,
        record=record,
    )
    if excited.end != "done" and not (accepts_safety_ends and excited.end in SAFETY_ENDS):
        raise TakeEnded(excited.end)
    if excited.are_fresh().size >= TICK_RATE / 4 and excited.are_fresh().mean() < _TIMELY_SHARE_MIN:
        raise TakeEnded("late")
    return excited


def settle(axis: Axis, guide: Guide) -> None:
    """Let the guide bring the key to rest. Raises TakeEnded."""
    n_ticks = round(0.3 * TICK_RATE)
    motion_max = max(4 * axis.device.resolution, 1e-2 * guide.half_travel)
    for _ in range(round(_SETTLING_DURATION_MAX / 0.3)):
        positions = push(axis, np.zeros(n_ticks), guide, accepts_safety_ends=True).positions()
        if positions.size == n_ticks and np.ptp(positions[n_ticks // 2 :]) <= motion_max:
            break
    push(axis, np.zeros(n_ticks // 3), guide, n_ticks, accepts_safety_ends=True)


def gesture_of_take(excited: ExcitationRecord) -> Gesture:
    """A take as a gesture for the fit."""
    n_ticks = excited.sent().size
    return gesture_from_rows(
        np.arange(n_ticks),
        excited.sent(),
        excited.positions(),
        excited.are_fresh(),
        excited.clocks(),
        TICK_RATE,
    )


def climb(
    axis: Axis, seed: int = 0, report_rung: Callable[[Rung], object] = lambda rung: None
) -> Ladder:
    """Find the motor's direction and the greatest force that keeps a key away from its ends.

    Raises TakeEnded, or MeasurementError if the key does not move or has no room.
    """
    rng = np.random.default_rng(seed)
    key = _RestingKey(axis, rng)
    sign, moving_mass = key.find_direction_and_mass()
    axis, force_max = (replace(axis, sign=axis.sign * sign), axis.request_max)
    guide = key.guide_for_mass(moving_mass)
    settle(axis, guide)
    force, gestures = _FIRST_SHARE * force_max, []
    rungs: list[Rung] = []
    while len(rungs) < _RUNGS_MAX:
        n_ticks = round(RUNG_DURATION * TICK_RATE)
        relative_forces = excitation.mix_with_strokes(
            n_ticks, TICK_RATE, rng, excitation.rain(n_ticks, rng), _RAIN_SHARE
        )
        forces, n_still = excitation.with_still_beginning(force * relative_forces, TICK_RATE)
        excited = push(axis, forces, guide, n_still, accepts_safety_ends=True)
        settle(axis, guide)
        excursion = float(np.abs(excited.positions() - guide.centre).max())
        is_braked = excited.end != "done" or bool(excited.braked().any())
        rungs.append(Rung(force, excursion, is_braked))
        report_rung(rungs[-1])
        if excited.end == "done":
            gestures.append(gesture_of_take(excited))
        excursion_ratio = excursion / guide.half_travel
        if not is_braked:
            moving_mass = key.refine_mass(moving_mass, gestures[-1])
            guide = key.guide_for_mass(moving_mass)
            if excursion_ratio >= _EXCURSION_RATIO_MIN or force >= _LAST_SHARE * force_max:
                break
        elif sum(rung.is_braked for rung in rungs) >= _BRAKED_RUNGS_MAX:
            break
        force_factor = (
            0.7 if is_braked else min(2.0, _EXCURSION_RATIO_TARGET / max(excursion_ratio, 1e-6))
        )
        force = min(_LAST_SHARE * force_max, force * force_factor)
    if not gestures:
        raise TakeEnded(excited.end)
    parameters = _rough_parameters(gestures[-2:])
    needs_guide = bool(parameters[INDEX["stiffness"]] <= _STIFFNESS_PER_MASS_MAX * parameters[0])
    return Ladder(axis, guide, needs_guide, parameters, rungs)


def _rough_parameters(gestures: list[Gesture]) -> Floats:
    """A rough key fitted to takes: mass, spring, damper, weight and dry friction."""
    guess = first_guess(gestures)
    fitted_indices = [INDEX[name] for name in ("mass", "stiffness", "damping", "weight", "dry")]
    try:
        return fit(gestures, guess, fitted_indices, iterations=8).parameters
    except _core.EngineError:
        return guess


class _RestingKey:
    """The position where a key rests, its sensor's noise, and its response to a push."""

    def __init__(self, axis: Axis, rng: np.random.Generator) -> None:
        self.axis, self.random_generator = axis, rng
        end_min, end_max = axis.device.range
        free_guide = Guide(
            0.5 * (end_min + end_max), end_max - end_min, (0.0, 0.0), (0.0, 0.0), 1.0
        )
        positions = push(axis, np.zeros(round(0.2 * TICK_RATE)), free_guide).positions()
        self.centre = float(np.median(positions))
        self.half_travel = min(self.centre - end_min, end_max - self.centre)
        if self.half_travel < _END_DISTANCE_MIN * 0.5 * (end_max - end_min):
            raise MeasurementError(
                f"the key rests at {self.centre * 1e3:.3g} mm, "
                f"{max(self.half_travel, 0.0) * 1e3:.2g} mm from an end of its travel "
                f"({end_min * 1e3:.3g} to {end_max * 1e3:.3g} mm), and has no room to be pushed; "
                "put it near the middle"
            )
        noise = float(np.std(np.diff(positions))) / np.sqrt(2)
        self.motion_min = max(8 * noise, 3 * axis.device.resolution, 2e-4 * (end_max - end_min))
        self.free_guide = Guide(self.centre, self.half_travel, (0.0, 0.0), (0.0, 0.0), 1.0)

    def find_direction_and_mass(self) -> tuple[int, float]:
        """The direction of the motor, 1 or -1, and the approximate moving mass [kg].

        Raises MeasurementError if the key does not move.
        """
        force_max, jolt_force, length_ratio = (
            self.axis.request_max,
            _FIRST_JOLT_SHARE * self.axis.request_max,
            1.0,
        )
        while length_ratio < _JOLT_LENGTH_RATIO_MAX:
            n_ticks = round(_JOLT_DURATION * TICK_RATE)
            forces = jolt_force * excitation.jolts(
                n_ticks, TICK_RATE, self.random_generator, length_ratio
            )
            forces_sent, n_still = excitation.with_still_beginning(forces, TICK_RATE)
            excited = push(self.axis, forces_sent, self.free_guide, n_still)
            jolt_gesture = gesture_of_take(excited)
            excursion = float(np.abs(jolt_gesture.position - jolt_gesture.start).max())
            mass, certainty = signed_mass(jolt_gesture)
            if excursion > self.motion_min and certainty > _MASS_CERTAINTY_MIN:
                return (1 if mass > 0 else -1), abs(mass)
            if excursion > _JOLT_EXCURSION_RATIO * self.half_travel:
                break
            if jolt_force < _JOLT_SHARE_MAX * force_max:
                jolt_force = min(1.5 * jolt_force, _JOLT_SHARE_MAX * force_max)
            else:
                length_ratio *= 1.5
        raise MeasurementError(
            f"the motion of the key could not be measured under {jolt_force:.2g} "
            "N: check the power of its "
            "motor, and let go of the key"
        )

    def refine_mass(self, mass: float, gesture: Gesture) -> float:
        """The mass estimated from a rung, limited to 0.2 to 1.5 times `mass`;
        `mass` itself if the key hardly moved.
        """
        if np.ptp(gesture.position) < 10 * self.motion_min:
            return mass
        return float(np.clip(first_guess([gesture])[0], 0.2 * mass, 1.5 * mass))

    def guide_for_mass(self, mass: float) -> Guide:
        """The guide and the brake of a key of about this mass."""
        stiffness = mass * _GUIDE_FREQUENCY**2
        return Guide(
            self.centre,
            self.half_travel,
            (stiffness, 2 * _GUIDE_DAMPING_RATIO * _GUIDE_FREQUENCY * mass),
            (_BRAKE_STIFFNESS * stiffness, _BRAKE_DAMPING * mass),
            0.5 * self.axis.request_max / mass,
        )
