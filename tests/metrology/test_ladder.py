"""Ladders on keys of which nothing is known: no end of a travel is touched, the sign is found."""

import numpy as np
import pytest
from measured_keys import FORCE_STEP, KEY, QUANTUM, RATE, Floats, path

from ergon import _core
from ergon.workshop.metrology import excitation, ladder, takes
from ergon.workshop.metrology.ladder import Axis, Ladder, TakeEnded, climb
from ergon.workshop.metrology.parameters import INDEX, total_mass
from ergon.workshop.metrology.stages import measure


def plant(seed: int) -> tuple[Floats, int, float, _core.Device]:
    """A key, the sign of its motor, its travel and its device, all drawn."""
    chance = np.random.default_rng(seed)
    mass = np.exp(chance.uniform(np.log(0.02), np.log(0.8)))
    stiffness = chance.uniform(0, 200) * (chance.random() > 0.25)
    damping = chance.uniform(0.1, 2.5)
    dry = chance.uniform(0.005, 0.15) * (chance.random() > 0.5)
    travel = chance.uniform(0.03, 0.12)
    if stiffness > 5:
        weight = chance.uniform(-0.4, 0.4) * min(0.25 * stiffness * travel, 0.3)
        start = -weight / stiffness
    else:
        weight, start = 0.0, chance.uniform(-0.1, 0.1) * travel
    delay = chance.integers(4) / RATE
    row = [mass, stiffness, damping, weight, dry, start, delay, 0.0, 0.0, 0.0]
    if chance.random() < 0.3:
        row += [0.05 * mass, chance.uniform(60, 250), 0.02]
    sign = int(chance.choice([-1, 1]))
    force_max = float(np.exp(chance.uniform(np.log(1.0), np.log(20))))
    end = 0.5 * travel
    device = _core.emulated_device(
        "frame",
        np.array(row),
        rate=RATE,
        travel=travel,
        force_max=force_max,
        noise=2e-6 * chance.uniform(0, 4),
        resolution=float(chance.choice([0, 7e-6, 5e-5])),
        seed=seed,
        calibration=[_core.AxisCalibration(0, float(sign), 0.0, 1.0, (-end, end), force_max)],
    )
    return np.array(row), sign, travel, device


def climbed(seed: int, monkeypatch: pytest.MonkeyPatch, rain: bool = False) -> float:
    """How far a key went in all, as a part of half its travel."""
    row, sign, travel, device = plant(seed)
    farthest = 0.0

    class Watched:
        """The core, whose `excite` tells how far a key went."""

        EngineError = _core.EngineError

        @staticmethod
        def excite(*arguments: object, **options: object) -> _core.ExcitationRecord:
            nonlocal farthest
            excited = _core.excite(*arguments, **options)  # type: ignore[arg-type]
            went = np.abs(excited.positions()).max(initial=0.0)
            farthest = max(farthest, float(went) / (0.5 * travel))
            return excited

    monkeypatch.setattr(ladder, "_core", Watched)
    result = climb(Axis(device))
    assert result.axis.sign == sign, seed
    assert abs(result.rough_parameters[0] / total_mass(row) - 1) < 0.5, seed
    if rain:
        takes.record(result, "rain", 3.0, lambda kind, part: None)
        takes.record(result, "strikes", 3.0, lambda kind, part: None)
    return farthest


@pytest.mark.parametrize(
    "seeds", [range(4), pytest.param(range(4, 40), marks=pytest.mark.slow)], ids=["few", "more"]
)
def test_ladder_stays_within_travel(seeds: range, monkeypatch: pytest.MonkeyPatch):
    farthest = [climbed(seed, monkeypatch, rain=seed < 4) for seed in seeds]
    assert max(farthest) < 0.85, farthest


@pytest.mark.slow
def test_ladder_stays_within_travel_500_seeds(monkeypatch: pytest.MonkeyPatch):
    farthest = [climbed(seed, monkeypatch, rain=True) for seed in range(500)]
    assert max(farthest) < 0.95, farthest


def emulated(row: Floats = KEY, **options: object) -> _core.Device:
    known = {"travel": 30e-3, "force_max": 1.56, "resolution": QUANTUM, "noise": 0.5 * QUANTUM}
    return _core.emulated_device("frame", row, rate=RATE, **{**known, **options})  # type: ignore[arg-type]


def taken(found: Ladder, seconds: float = 8.0) -> list[takes.Take]:
    each = takes.record(found, "rain", seconds, lambda kind, part: None)
    return each + takes.record(found, "held-out", 6.0, lambda kind, part: None)


@pytest.mark.slow
def test_ladder_takes_measure_emulated_key():
    """Through the safety stages and the wire the key is known as well as its sensor allows."""
    *fitted, apart = taken(climb(Axis(emulated(seed=3))))
    result = measure([take.gesture for take in fitted], apart.gesture).fit
    assert result.rms < 1.1 * np.hypot(0.5, 1 / np.sqrt(12)) * QUANTUM
    for index in (0, 1, 2, 3, 4, INDEX["delay"], 10, 11, 12):
        assert abs(result.parameters[index] - KEY[index]) < 4.5 * result.deviation(index), index
    force = apart.gesture.force
    truth = path(KEY, force, 176, 0.0)
    replay = path(result.parameters, force, None, 0.0)
    assert np.sqrt(np.mean((replay - truth) ** 2)) < 0.05 * QUANTUM


@pytest.mark.slow
def test_ladder_of_fader_without_spring_needs_guide():
    """A fader of eight bits both ways, as FireFader is one."""
    fader = np.array([0.05, 0.0, 1.0, 0.0, 0.1, 2e-3, 0.0, 0.0, 0.0, 0.0])
    device = _core.emulated_device("firefader", fader, rate=RATE, noise=1e-4)
    result = climb(Axis(device, is_gated=False))
    assert result.needs_guide
    *fitted, apart = taken(result)
    force = fitted[0].gesture.force
    assert np.abs(force / FORCE_STEP - np.round(force / FORCE_STEP)).max() < 1e-4
    fit = measure([take.gesture for take in fitted], apart.gesture).fit
    for index in (0, 2, 4):
        assert abs(fit.parameters[index] / fader[index] - 1) < 0.02, (index, fit.parameters)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"seconds": 4.0}, "the device was unplugged"),
        ({"path": np.zeros(100_000)}, "a hand touched the key"),
        ({"touch_gate": True}, "lets no force through"),
    ],
    ids=["unplugged", "hand", "gate"],
)
def test_ladder_ends_with_the_reason_of_a_failure(options: dict[str, object], told: str):
    with pytest.raises(TakeEnded, match=told):
        climb(Axis(emulated(**options)))


def test_ladder_refuses_key_resting_near_end():
    row = KEY.copy()
    row[3], row[5] = 0.8, -0.8 / 60
    with pytest.raises(ladder.MeasurementError, match="put it near the middle"):
        climb(Axis(emulated(row)))


def test_ladder_refuses_motor_without_power():
    row = KEY.copy()
    row[0], row[4] = 0.4, 20.0
    with pytest.raises(ladder.MeasurementError, match="check the power of its motor"):
        climb(Axis(emulated(row)))


def test_guide_forces_move_key_along_path():
    """The engine's key, without friction, goes where it is led, within its reach and force."""
    row = np.array([0.4, 60.0, 1.2, *[0.0] * 7])
    rate = 44100 / 44
    s = np.clip((np.arange(2000) - 200) / 600, 0, 1)
    path = 0.001 + 0.004 * s**3 * (10 - 15 * s + 6 * s * s)
    for reach, share in ((0.01, 1.0), (0.002, 0.5)):
        force = excitation.forces_along_path(path, row, rate, reach, 10.0)
        went = _core.key_path(row, force, rate, columns=())[0]
        assert np.abs(went - share * (path - path[0])).max() < 0.01 * share * 0.004
    assert np.abs(excitation.forces_along_path(path, row, rate, 0.01, 0.1)).max() == 0.1
