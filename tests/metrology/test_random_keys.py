"""Keys with any of the parts that a key may have: the search ends with a model that is right."""

import numpy as np
import pytest
from random_keys import Key, Outcome, outcome, random_key

from ergon.workshop.metrology.judging import Stage
from ergon.workshop.metrology.output_error import Fit
from ergon.workshop.metrology.parameters import INDEX, N_KEY, merge_nearest_modes

WITHIN = 1.3  # times the sensor's noise: a replay that is right
# Dry friction, Stribeck and one mode: Stribeck's friction is refused before the mode is known.
HIDDEN = Key(
    frozenset({"dry", "Stribeck", "weight", "delay", "noise", "coarse force"}),
    np.array(
        [0.287, 43.0, 0.83, 0.21, 0.037, -0.21 / 43, 0.7e-3, 0, 0.055, 2.5e-3, 0.031, 143, 0.013]
    ),
    force_max=20.0,
)


# Two modes and Stribeck's friction: while one is missing, the values of the others are unsure.
BOTH_HIDDEN = Key(
    frozenset({"dry", "Stribeck", "weight", "delay", "noise", "coarse force"}),
    np.array(
        [0.412, 71.0, 1.3, 0.35, 0.022, -0.35 / 71, 1.1e-3, 0, 0.041, 4.2e-3,
         0.024, 118, 0.02, 0.015, 261, 0.01]
    ),
    force_max=25.0,
)  # fmt: skip


@pytest.mark.slow  # a search with thirteen parameters
def test_metrology_continues_after_unsure_part():
    """The search ended at five times the noise: neither part was known without the other."""
    measured_key = outcome(BOTH_HIDDEN, 29)
    assert measured_key.replay < WITHIN
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


@pytest.mark.slow  # a search with ten parameters
def test_metrology_retries_refused_terms():
    measured_key = outcome(HIDDEN, 11)
    stages = measured_key.measured.stages
    tries = [
        stage.is_accepted for stage in stages if stage.name == "Stribeck" and not stage.is_removal
    ]
    assert tries == [False, True]
    assert measured_key.replay < WITHIN
    fit = measured_key.measured.fit
    assert INDEX["static_dry"] in fit.columns
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


@pytest.mark.slow
@pytest.mark.parametrize("seed", [12, 23])
def test_metrology_keeps_mode_hidden_in_replay(seed: int):
    """A mode counted to the mass: 190 and 59 deviations."""
    measured_key = outcome(random_key(seed), seed)
    assert measured_key.replay < WITHIN
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


@pytest.mark.parametrize(
    ("rms", "replay", "is_worth", "is_sure"),
    [
        (0.99, 1.0005, True, True),  # surely in the takes, not shown
        (0.4, 1.03, True, True),  # a key of the wrong mass follows the takes much worse
        (0.99, 1.002, True, False),  # the gesture speaks against it
        (0.9999, 1.000001, True, False),  # not surely in the takes
        (0.99, 1.0005, False, False),  # its values are not known
    ],
)
def test_stage_is_sure_despite_replay(rms: float, replay: float, is_worth: bool, is_sure: bool):
    def stage(rms: float, replay: float, is_worth: bool) -> Stage:
        fit = Fit(np.zeros(10), (), (0.0,), np.zeros((0, 0)), rms, 20_000)
        return Stage("mode", fit, replay, False, is_significant=is_worth)

    assert stage(rms, replay, is_worth).is_sure_despite_replay(stage(1.0, 1.0, True)) == is_sure


def share_within(outcomes: list[Outcome]) -> float:
    return float(np.mean([each.replay <= WITHIN for each in outcomes]))


@pytest.mark.slow
def test_random_keys_measured_within_deviations():
    """Of 95 % intervals 90 to 98 % hold the truth; 12 keys have about 110 figures."""
    outcomes = [outcome(random_key(seed), seed) for seed in range(12)]
    assert share_within(outcomes) >= 0.95
    errors = np.concatenate([list(each.errors.values()) for each in outcomes])
    assert 0.88 <= np.mean(np.abs(errors) < 1.96) <= 1.0


@pytest.mark.slow  # a search with three modes
def test_metrology_joins_mode_in_two_parts():
    """The first of two modes stayed at half of its mass: a mass was wrong by 47 deviations."""
    measured_key = outcome(random_key(63), 63)
    assert measured_key.replay < 1.01
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


@pytest.mark.slow
def test_metrology_leaves_dents_along_delay():
    """The fit ended in a dent along the delay: five deviations, and four of the mass."""
    measured_key = outcome(random_key(66), 66)
    assert abs(measured_key.errors["delay"]) < 2
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


@pytest.mark.slow  # a search with eight parameters
def test_metrology_bounds_speed_of_static_friction():
    """Static friction ended at 6 µm/s beside the right mode, which was then refused: 74 times."""
    measured_key = outcome(random_key(122), 122)
    assert measured_key.replay < WITHIN
    assert max(map(abs, measured_key.errors.values())) < 4, measured_key.errors


def test_modes_of_one_pitch_are_joined():
    key = np.arange(N_KEY, dtype=float)
    modes = [0.004, 83.6, 0.02], [0.05, 229.0, 0.02], [0.028, 83.0, 0.016]
    joined = merge_nearest_modes(np.concatenate([key, *modes]))
    assert joined is not None
    np.testing.assert_array_equal(joined[:N_KEY], key)
    first = [0.032, 83.0 + 0.6 / 8, 0.016 + 0.004 / 8]
    np.testing.assert_allclose(joined[N_KEY:], [*first, *modes[1]])
    assert merge_nearest_modes(joined) is None
    assert merge_nearest_modes(key) is None
