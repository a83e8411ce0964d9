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

    from ergon._core import Device, Excited

    from .gesture import Floats, Gesture

FRAMES, RATE = 44, 44100.0  # frames of a tick, and the audio rate
TICK_RATE = RATE / FRAMES
RUNG = 2.0  # s
_FIRST_SHARE, _LAST_SHARE = 0.05, 0.9  # of the force
_RUNGS_MAX = 12
_ENOUGH = 0.4  # excursion, over half the travel, of the last rung
_TARGET = 0.55  # target of the next rung, over half the travel
_BRAKED = 3  # rungs that were braked, until no further one is tried
_RAIN = 0.3  # of the force of a rung
# The guide: the frequency of its pole [rad/s] and its damping ratio. It is stable with a delay of
# 10 ms.
_GUIDE, _GUIDE_RATIO = 12.0, 0.8
_BRAKE_STIFFNESS, _BRAKE_DAMPING = 3.0, 45.0  # of the guide's; 1/s of the mass
_SPRING = 40.0  # (rad/s)²: with a faster spring of its own a key needs no guide
_END_DISTANCE_MIN = 0.35  # of half the range: a key that rests nearer to an end has no room
# Jolts show the direction of the motor and the approximate mass.
_JOLTS = 0.6  # s
_FIRST_JOLT, _JOLT_MAX = 0.01, 0.8  # of the force
_JOLTED = 0.2  # excursion, over half the travel, of the last jolt
_MASS_CERTAINTY_MIN = 15.0  # the mass over its deviation, from which on it is believed
_JOLT_LENGTH_RATIO_MAX = 6.0  # times the length of the first jolts, at most
_IN_TIME = 0.75  # smallest share of ticks with a reply in time
_RESTS = 3.0  # s at most, until a key rests

# Why a take ended, and what the user can do.
_ENDS = {
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

    def __init__(self, end: str) -> None:
        """`end` is that of `_core.Excited`."""
        super().__init__(_ENDS.get(end, end))
        self.end = end


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
    half: float
    guide: tuple[float, float]
    brake: tuple[float, float]
    deceleration: float

    def for_core(self) -> tuple[float, float, tuple[float, float], tuple[float, float], float]:
        """The guide as arguments of `_core.excite`."""
        return self.centre, self.half, self.guide, self.brake, self.deceleration

    @property
    def off(self) -> Guide:
        """The brake alone."""
        return replace(self, guide=(0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Rung:
    """A rung of the ladder: its force [N], the excursion of the key [m], and whether it was
    braked.
    """

    force: float
    excursion: float
    braked: bool


@dataclass(slots=True)
class Ladder:
    """The result of the ladder: the axis with the motor's sign, the guide, a rough key, the
    rungs.
    """

    axis: Axis
    guide: Guide
    needs_guide: bool
    rough: Floats
    rungs: list[Rung] = field(default_factory=list)

    @property
    def force(self) -> float:
        """The force of the strongest rung that was not braked, or of the weakest [N]."""
        free = [rung.force for rung in self.rungs if not rung.braked]
        return max(free) if free else min(rung.force for rung in self.rungs)


# Safety stages compare force and motion for keys that are played. Under rain a key in good order
# may fail them.
DOUBTS = (
    "tripped: wrong way",
    "tripped: unanswered",
    "tripped: late",
    "tripped: frozen",
    "tripped: at stop",
    "tripped: speed",
)


def push(
    device_axis: Axis,
    push_forces: Floats,
    guide: Guide,
    still: int = 0,
    record: _core.RecordTarget | None = None,
    *,
    forgiven: bool = False,
) -> Excited:
    """Push a key by forces (n,) [N]. Raises TakeEnded if that ends early.

    With `forgiven` it does not raise if a safety stage stopped the axis because force and motion
    disagreed.
    """
    excited = _core.excite(
        device_axis.device,
        device_axis.number,
        np.ascontiguousarray(push_forces, float),
        RATE,
        FRAMES,
        guide.for_core(),
        sign=device_axis.sign,
        still=still,
        force_step=device_axis.force_step,
        tells_touch=device_axis.tells_touch,
        is_gated=device_axis.is_gated,
        record=record,
    )
    if excited.end != "done" and not (forgiven and excited.end in DOUBTS):
        raise TakeEnded(excited.end)
    if excited.fresh().size >= TICK_RATE / 4 and excited.fresh().mean() < _IN_TIME:
        raise TakeEnded("late")
    return excited


def settle(device_axis: Axis, guide: Guide) -> None:
    """Let the guide bring the key to rest. Raises TakeEnded."""
    n = round(0.3 * TICK_RATE)
    motion_max = max(4 * device_axis.device.resolution, 1e-2 * guide.half)
    for _ in range(round(_RESTS / 0.3)):
        positions = push(device_axis, np.zeros(n), guide, forgiven=True).positions()
        if positions.size == n and np.ptp(positions[n // 2 :]) <= motion_max:
            break
    push(device_axis, np.zeros(n // 3), guide, n, forgiven=True)


def gesture(excited: Excited) -> Gesture:
    """A take as a gesture for the fit."""
    n = excited.sent().size
    return gesture_from_rows(
        np.arange(n),
        excited.sent(),
        excited.positions(),
        excited.fresh(),
        excited.clocks(),
        TICK_RATE,
    )


def climb(
    device_axis: Axis, seed: int = 0, tell: Callable[[Rung], object] = lambda rung: None
) -> Ladder:
    """Find the motor's direction and the greatest force that keeps a key away from its ends.

    Raises TakeEnded, or MeasurementError if the key does not move or has no room.
    """
    chance = np.random.default_rng(seed)
    key_place = _Place(device_axis, chance)
    sign, moving_mass = key_place.pushed()
    device_axis, greatest = (
        replace(device_axis, sign=device_axis.sign * sign),
        device_axis.request_max,
    )
    guide = key_place.guide(moving_mass)
    settle(device_axis, guide)
    force, gestures = _FIRST_SHARE * greatest, []
    rungs: list[Rung] = []
    while len(rungs) < _RUNGS_MAX:
        n = round(RUNG * TICK_RATE)
        relative_forces = excitation.mixed(n, TICK_RATE, chance, excitation.rain(n, chance), _RAIN)
        framed_forces, still_ticks = excitation.framed(force * relative_forces, TICK_RATE)
        excited = push(device_axis, framed_forces, guide, still_ticks, forgiven=True)
        settle(device_axis, guide)
        excursion = float(np.abs(excited.positions() - guide.centre).max())
        braked = excited.end != "done" or bool(excited.braked().any())
        rungs.append(Rung(force, excursion, braked))
        tell(rungs[-1])
        if excited.end == "done":
            gestures.append(gesture(excited))
        excursion_share = excursion / guide.half
        if not braked:
            moving_mass = key_place.better(moving_mass, gestures[-1])
            guide = key_place.guide(moving_mass)
            if excursion_share >= _ENOUGH or force >= _LAST_SHARE * greatest:
                break
        elif sum(rung.braked for rung in rungs) >= _BRAKED:
            break
        force_factor = 0.7 if braked else min(2.0, _TARGET / max(excursion_share, 1e-6))
        force = min(_LAST_SHARE * greatest, force * force_factor)
    if not gestures:
        raise TakeEnded(excited.end)
    rough = _rough(gestures[-2:])
    needs_guide = bool(rough[INDEX["stiffness"]] <= _SPRING * rough[0])
    return Ladder(device_axis, guide, needs_guide, rough, rungs)


def _rough(gestures: list[Gesture]) -> Floats:
    """A rough key fitted to takes: mass, spring, damper, weight and dry friction."""
    guessed_row = first_guess(gestures)
    columns = [INDEX[name] for name in ("mass", "stiffness", "damping", "weight", "dry")]
    try:
        return fit(gestures, guessed_row, columns, iterations=8).row
    except _core.EngineError:
        return guessed_row


class _Place:
    """The position where a key rests, its sensor's noise, and its response to a push."""

    def __init__(self, device_axis: Axis, chance: np.random.Generator) -> None:
        self.axis, self.chance = device_axis, chance
        low_end, high_end = device_axis.device.range
        free = Guide(0.5 * (low_end + high_end), high_end - low_end, (0.0, 0.0), (0.0, 0.0), 1.0)
        read_positions = push(device_axis, np.zeros(round(0.2 * TICK_RATE)), free).positions()
        self.centre = float(np.median(read_positions))
        self.half = min(self.centre - low_end, high_end - self.centre)
        if self.half < _END_DISTANCE_MIN * 0.5 * (high_end - low_end):
            raise MeasurementError(
                f"the key rests at {self.centre * 1e3:.3g} mm, {max(self.half, 0.0) * 1e3:.2g} mm "
                f"from an end of its travel ({low_end * 1e3:.3g} to {high_end * 1e3:.3g} mm), and "
                "has no "
                "room to be pushed; put it near the middle"
            )
        trembles = float(np.std(np.diff(read_positions))) / np.sqrt(2)
        self.visible_motion = max(
            8 * trembles, 3 * device_axis.device.resolution, 2e-4 * (high_end - low_end)
        )
        self.free = Guide(self.centre, self.half, (0.0, 0.0), (0.0, 0.0), 1.0)

    def pushed(self) -> tuple[int, float]:
        """The direction of the motor, 1 or -1, and the approximate moving mass [kg].

        Raises MeasurementError if the key does not move.
        """
        force_max, jolt_force, length_ratio = (
            self.axis.request_max,
            _FIRST_JOLT * self.axis.request_max,
            1.0,
        )
        while length_ratio < _JOLT_LENGTH_RATIO_MAX:
            n = round(_JOLTS * TICK_RATE)
            forces = jolt_force * excitation.jolts(n, TICK_RATE, self.chance, length_ratio)
            framed_forces, still_ticks = excitation.framed(forces, TICK_RATE)
            excited = push(self.axis, framed_forces, self.free, still_ticks)
            jolt_gesture = gesture(excited)
            excursion = float(np.abs(jolt_gesture.position - jolt_gesture.start).max())
            mass, certainty = signed_mass(jolt_gesture)
            if excursion > self.visible_motion and certainty > _MASS_CERTAINTY_MIN:
                return (1 if mass > 0 else -1), abs(mass)
            if excursion > _JOLTED * self.half:
                break
            if jolt_force < _JOLT_MAX * force_max:
                jolt_force = min(1.5 * jolt_force, _JOLT_MAX * force_max)
            else:
                length_ratio *= 1.5
        raise MeasurementError(
            f"the motion of the key could not be measured under {jolt_force:.2g} "
            "N: check the power of its "
            "motor, and let go of the key"
        )

    def better(self, guessed_mass: float, gesture: Gesture) -> float:
        """The mass estimated from a rung, limited to 0.2 to 1.5 times `guessed_mass`;
        `guessed_mass` itself if the key hardly moved.
        """
        if np.ptp(gesture.position) < 10 * self.visible_motion:
            return guessed_mass
        return float(np.clip(first_guess([gesture])[0], 0.2 * guessed_mass, 1.5 * guessed_mass))

    def guide(self, mass: float) -> Guide:
        """The guide and the brake of a key of about this mass."""
        stiffness = mass * _GUIDE**2
        return Guide(
            self.centre,
            self.half,
            (stiffness, 2 * _GUIDE_RATIO * _GUIDE * mass),
            (_BRAKE_STIFFNESS * stiffness, _BRAKE_DAMPING * mass),
            0.5 * self.axis.request_max / mass,
        )
