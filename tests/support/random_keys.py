"""Keys with random parts behind an emulated device in lockstep, measured as a user measures one."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from measured_keys import RATE, Floats

from ergon import _core
from ergon.workshop.metrology import comparison, takes
from ergon.workshop.metrology.gesture import Gesture
from ergon.workshop.metrology.judging import Stage
from ergon.workshop.metrology.ladder import Axis, climb
from ergon.workshop.metrology.output_error import Fit
from ergon.workshop.metrology.parameters import INDEX, N_KEY, N_MODE, mode_indices, n_modes
from ergon.workshop.metrology.stages import Measured, measure

RESOLUTION, NOISE, FORCE_STEP, TRAVEL = 6e-6, 3e-6, 10e-3, 60e-3  # m, m, N, m
_CHOICES = ("dry", "Stribeck", "weight", "delay", "noise", "coarse force")
_ALIKE = 0.15  # of the logarithm of a pitch: a mode that was measured is this one


@dataclass(frozen=True)
class Key:
    """A key: the parts that it has, its parameters, and the greatest force of its motor [N]."""

    parts: frozenset[str]
    row: Floats
    force_max: float = 3.0

    @property
    def sensor_noise(self) -> float:
        """Rms of what the sensor adds to a position [m]: its noise, and its rounding."""
        return float(np.hypot(NOISE if "noise" in self.parts else 0.0, RESOLUTION / np.sqrt(12)))

    @property
    def force_step(self) -> float:
        """The step of the motor's force [N]."""
        return FORCE_STEP if "coarse force" in self.parts else 0.0


@dataclass(frozen=True)
class Outcome:
    """A measured key: its stages, the replay of another gesture over the sensor's noise, and the
    errors of its figures in their standard deviations.
    """

    measured: Measured
    replay: float
    errors: dict[str, float]


# Every subset of the parts with 0, 1 or 2 modes; Stribeck's friction is one of dry friction.
SUBSETS = [
    (modes, frozenset(name for name, is_in in zip(_CHOICES, flags, strict=True) if is_in))
    for flags in product((False, True), repeat=len(_CHOICES))
    for modes in range(3)
    if flags[0] or not flags[1]
]


def random_key(seed: int) -> Key:
    """A key with a random subset of the parts, of 80 to 600 g and 1 to 4 Hz."""
    chance = np.random.default_rng(seed)
    modes, parts = SUBSETS[int(chance.integers(len(SUBSETS)))]
    row = np.zeros(N_KEY + N_MODE * modes)
    mass = chance.uniform(0.08, 0.6)
    stiffness = mass * (2 * np.pi * chance.uniform(1.0, 4.0)) ** 2
    row[:3] = mass, stiffness, chance.uniform(0.3, 2.0)
    if "weight" in parts:
        row[INDEX["weight"]] = stiffness * chance.uniform(-4e-3, 4e-3)
        row[INDEX["start"]] = -row[INDEX["weight"]] / stiffness
    if "dry" in parts:
        row[INDEX["dry"]] = chance.uniform(10e-3, 60e-3)
    if "Stribeck" in parts:
        row[INDEX["static_dry"]] = chance.uniform(1.3, 2.0) * row[INDEX["dry"]]
        row[INDEX["static_speed"]] = chance.uniform(2e-3, 8e-3)
    if "delay" in parts:
        row[INDEX["delay"]] = chance.uniform(0.1e-3, 1.7e-3)
    for mode, (low, high) in zip(range(modes), ((60.0, 140.0), (160.0, 300.0)), strict=False):
        swinging = chance.uniform(0.03, 0.08) * mass
        row[mode_indices(mode)] = swinging, chance.uniform(low, high), chance.uniform(0.008, 0.03)
        row[0] -= swinging
    return Key(parts, row)


def outcome(key: Key, seed: int, *, is_step_known: bool = True) -> Outcome:
    """Measure a key by its device as `ergon metrology DEVICE` does, and replay a gesture on it."""
    step = key.force_step if is_step_known else 0.0
    *fitted, held_out = _recorded(key, seed, takes.KINDS, step)
    (other,) = _recorded(key, seed + 1_000_000, ("held-out",), step)
    measured = measure(fitted, held_out)
    replay = comparison.replay(measured.fit.parameters, other).rms / key.sensor_noise
    return Outcome(measured, replay, errors(measured.fit, key.row))


def _recorded(key: Key, seed: int, kinds: tuple[str, ...], force_step: float) -> list[Gesture]:
    """Takes of these kinds, of 10 s; of a held-out one the longest part."""
    device = _core.emulated_device(
        "frame",
        key.row,
        rate=RATE,
        travel=TRAVEL,
        force_max=key.force_max,
        resolution=RESOLUTION,
        noise=NOISE if "noise" in key.parts else 0.0,
        force_step=key.force_step,
        seed=seed,
    )
    ladder = climb(Axis(device, force_step=force_step), seed)
    gestures: list[Gesture] = []
    for kind in kinds:
        seconds = takes.HELD_OUT_DURATION if kind == "held-out" else 10.0
        each = takes.record(ladder, kind, seconds, lambda kind, part: None, seed)
        parts = [take.gesture for take in each]
        gestures += [max(parts, key=lambda part: part.force.size)] if kind == "held-out" else parts
    return gestures


def errors(fit: Fit, row: Floats) -> dict[str, float]:
    """Errors of the figures that a fit shares with a key, in their standard deviations."""
    pairs = {name: (index, index) for name, index in INDEX.items() if index in fit.fitted_indices}
    for mode in range(n_modes(row)):
        true_columns = mode_indices(mode)
        for fitted in map(mode_indices, range(n_modes(fit.parameters))):
            if abs(np.log(fit.parameters[fitted[1]] / row[true_columns[1]])) < _ALIKE:
                names = (f"mode {mode + 1} {what}" for what in ("mass", "frequency", "ratio"))
                pairs |= dict(zip(names, zip(fitted, true_columns, strict=True), strict=True))
    return {
        name: float(fit.parameters[measured] - row[true]) / fit.deviation(measured)
        for name, (measured, true) in pairs.items()
        if fit.deviation(measured) > 0.0
    }


def accepted_parts(stages: tuple[Stage, ...]) -> list[str]:
    """The names of the stages that were kept, removals too."""
    return [
        ("- " if stage.is_removal else "") + stage.name for stage in stages if stage.is_accepted
    ]
