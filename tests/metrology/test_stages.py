"""Keys that are known, measured from what a sensor reads of them."""

import numpy as np
import pytest
from measured_keys import KEY, PLAIN, QUANTUM, Floats, gesture, knocks, path, rain, wire

from ergon.workshop.metrology.gesture import MeasurementError, gesture_from_arrays
from ergon.workshop.metrology.parameters import INDEX, N_KEY
from ergon.workshop.metrology.stages import Measured, measure

START = 0.4e-3  # from where a key rests to where the held-out gesture begins [m]


def measured(row: Floats, seed: int) -> tuple[Measured, float]:
    """A key measured by 10 s of rain; rms of its replay of knocks from their true path [m]."""
    force, other = rain(KEY), knocks(KEY)
    begin = row[5] + START
    apart = gesture(row, other, seed + 1000, begin)
    result = measure([gesture(row, force, seed)], apart)
    truth = path(row, other, 176, begin)
    replay = path(result.fit.parameters, other, None, apart.start)
    return result, float(np.sqrt(np.mean((replay - truth) ** 2)))


def accepted_stages(found: Measured) -> list[str]:
    return [stage.name for stage in found.stages if stage.is_accepted]


def deviations(outcome: Measured, row: Floats) -> dict[int, float]:
    """Errors of the parameters, in their standard deviations."""
    fit = outcome.fit
    return {i: (fit.parameters[i] - row[i]) / fit.deviation(i) for i in fit.fitted_indices}


def errors_of(seeds: range) -> Floats:
    """Errors of all parameters in their deviations, (seeds, 9): the modes' are the last three."""
    errors = []
    for seed in seeds:
        result, replay = measured(KEY, seed)
        assert accepted_stages(result)[:2] == ["M K Z", "dry"]
        assert accepted_stages(result)[-1] == "mode"
        assert replay <= min(0.25e-6, 0.05 * QUANTUM), f"seed {seed}: {replay}"
        each = deviations(result, KEY)
        errors.append([each[i] for i in (*range(5), INDEX["delay"], *range(10, 13))])
    return np.array(errors)


@pytest.mark.slow  # of the same key test_metrology_fit_and_score_using_calibration is quick
def test_measure_known_key_single_seed():
    errors = errors_of(range(1))
    assert (np.abs(errors) < 4).all(), errors


@pytest.mark.slow
def test_measure_known_key_near_cramer_rao_bound():
    """Within 1.4 of the bound of Cramér and Rao, 1.7 for a mode; without bias."""
    errors = errors_of(range(50))
    spread = errors.std(axis=0, ddof=1)
    assert (spread[:6] <= 1.4).all(), spread
    assert (spread[6:] <= 1.7).all(), spread
    assert (np.abs(errors.mean(axis=0)) <= 0.5 * spread).all(), errors.mean(axis=0)


@pytest.mark.slow
def test_plain_key_has_no_accepted_mode_stage():
    result, replay = measured(PLAIN, 7)
    assert "mode" not in accepted_stages(result)
    assert replay <= 0.25e-6
    assert max(map(abs, deviations(result, PLAIN).values())) < 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "part", "bound"),
    [
        ({"presliding": 5000.0}, "presliding", 4e-6),
        ({"static_dry": 0.08, "static_speed": 4e-3}, "Stribeck", 1e-6),
    ],
    ids=["presliding", "Stribeck"],
)
def test_measure_friction_stage_by_kind(changed: dict[str, float], part: str, bound: float):
    row = KEY.copy()
    for name, value in changed.items():
        row[INDEX[name]] = value
    result, replay = measured(row, 3)
    friction = [name for name in accepted_stages(result) if name in ("presliding", "Stribeck")]
    assert friction == [part]
    assert accepted_stages(result)[-1] == "mode"
    assert replay < bound
    for name, value in changed.items():
        assert abs(result.fit.parameters[INDEX[name]] / value - 1) < 0.05


def test_measure_removes_mistaken_friction_stage():
    """Rigid friction behind a late motor: at first a contact that gives way explains it best."""
    row = np.array([0.5089, 23.72, 0.8654, 0.1923, 0.03806, -8.1e-3, 1.7e-3, 0, 0, 0])
    chance, n = np.random.default_rng(4), 4000
    ticks = chance.choice([-1.0, 1.0], n)
    strokes = np.repeat(chance.uniform(-1.0, 1.0, n // 250), 250)
    force = wire(0.18 * ticks + 0.42 * strokes)
    result = measure([gesture(row, force, 4)])
    added = [stage.name for stage in result.stages if stage.is_accepted and not stage.is_removal]
    removed = [stage.name for stage in result.stages if stage.is_accepted and stage.is_removal]
    assert added[:4] == ["M K Z", "dry", "presliding", "delay"]
    assert removed[-1] == "presliding"
    assert not result.fit.parameters[INDEX["presliding"] :].any()
    errors = deviations(result, row)
    assert max(map(abs, errors.values())) < 4, errors


@pytest.mark.slow
def test_measure_without_test_take_uses_last_quarter():
    found = measure([gesture(KEY, rain(KEY, 6.0), 5)])
    assert {"dry", "mode"} <= set(accepted_stages(found))


@pytest.mark.slow
def test_measure_key_without_spring():
    fader = np.array([0.4, 0.0, 1.2, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    force = rain(KEY, 6.0)
    force = force - force.mean()
    result = measure([gesture(fader, force, 5)])
    errors = deviations(result, fader)
    assert abs(result.fit.parameters[INDEX["stiffness"]]) < 0.05
    assert len(result.fit.parameters) == N_KEY
    assert abs(errors[INDEX["mass"]]) < 4


@pytest.mark.parametrize(
    ("force", "position", "told"),
    [
        (np.zeros(5), np.zeros(6), "the same length"),
        (np.zeros(50), np.zeros(50), "at least 500 ticks"),
        (np.zeros(600), np.full(600, np.nan), "finite"),
    ],
)
def test_unsuitable_gesture_arrays_are_refused(force: Floats, position: Floats, told: str):
    with pytest.raises(MeasurementError, match=told):
        gesture_from_arrays(force, position, 1000.0)
