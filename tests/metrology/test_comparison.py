"""Calibrations beside each other, and a gesture on a key beside its model."""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from measured_keys import KEY, QUANTUM, gesture, knocks, rain

from ergon.workshop.metrology.calibration_file import Calibration, read, text
from ergon.workshop.metrology.comparison import (
    chi_squared,
    differences,
    gains,
    replay,
    replay_difference,
)
from ergon.workshop.metrology.gesture import Gesture, MeasurementError, sensor_step
from ergon.workshop.metrology.output_error import Fit
from ergon.workshop.metrology.picture import picture
from ergon.workshop.metrology.stages import Measured

TEXT = """ergon: 1
M: 400.0g # ± 0.01
rest: -2.5mm # ± 1e-5
K: 60N/m # ± 0.001
Z: 1.2Ns/m # ± 0.0001
dry: 50mN # ± 0.005
delay: 0.997732ms # ± 0.002
modes:
  - {M: 20g, f: 180Hz, t60: 0.30540s}
noise: 0.00431mm
date: 2026-11-22
"""


def known(**figures: float) -> Calibration:
    usual = {"M": 0.4, "K": 60.0, "Z": 1.2, "rest": -2.5e-3, "dry": 0.05}
    deviations = {"M": 1e-5, "K": 1e-3, "Z": 1e-4, "rest": 1e-8, "dry": 5e-6}
    return Calibration({**usual, **figures}, deviations, (), "2026-11-22")


def test_calibration_file_equals_fitted_row():
    result = read(TEXT)
    assert np.allclose(result.parameters, KEY, rtol=1e-4)
    assert result.date == "2026-11-22"
    assert result.deviations["K"] == 1e-3


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("ergon: 1\nM: 400g\nK: 60N/m\n", "it lacks Z"),
        (TEXT.replace("400.0g", "0.4kg"), "M must be in g"),
    ],
)
def test_damaged_calibrations_are_refused(said: str, told: str):
    with pytest.raises(MeasurementError, match=told):
        read(said)


def test_replay_residual_at_sensor_noise():
    took = gesture(KEY, knocks(KEY), 5)
    result = replay(KEY, took)
    assert 3.5e-6 < result.rms < 4.6e-6
    heavier = KEY.copy()
    heavier[0] *= 1.01
    worse = replay(heavier, took)
    assert worse.rms > 3 * result.rms
    drawn = picture(result, "key", worse)
    root = ET.fromstring(drawn)
    shown = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    for label in ("asked", "real", "model", "residual", "position [mm]", "M K Z alone [um]"):
        assert label in shown
    assert len(drawn) < 400_000


def test_replay_difference_of_similar_keys():
    first = read(TEXT).parameters
    assert replay_difference(first, first) == 0
    stiffer, heavier = first.copy(), first.copy()
    stiffer[1] *= 1.001
    heavier[0] *= 1.01
    assert 1e-7 < replay_difference(first, stiffer) < replay_difference(first, heavier)
    # Where a key rests says nothing of how it moves.
    elsewhere = first.copy()
    elsewhere[3] *= 2
    assert replay_difference(first, elsewhere) < 1e-12


def test_chi_squared_of_calibrations_by_deviations():
    squared, n = chi_squared(known(), known(K=60.0 + 2e-3 * np.sqrt(2)))
    assert n == 5
    assert abs(squared - 4) < 1e-6


def test_gains_from_added_mass():
    """A device whose sensor reads 1.1 m for a metre, and whose motor gives 0.8 N for a newton."""
    reads, pushes, added = 1.1, 0.8, 0.017
    gain = reads * pushes

    def calibration(mass: float, sinks: float) -> Calibration:
        return known(M=mass / gain, K=60 / gain, Z=1.2 / gain, rest=-2.5e-3 - reads * sinks)

    plain, loaded = calibration(0.4, 0.0), calibration(0.4 + added, added * 9.80665 / 60)
    output = gains(plain, loaded, added)
    wanted = {"mass": gain, "position": reads, "force": pushes, "M": 0.4, "K": 60.0, "Z": 1.2}
    assert {name: one.value for name, one in output.items()} == pytest.approx(wanted, rel=1e-9)
    lying = calibration(0.4 + added, 0.0)
    assert gains(plain, lying, added).keys() == {"mass", "M", "K", "Z"}
    with pytest.raises(MeasurementError, match="no heavier"):
        gains(loaded, plain, added)


@pytest.mark.slow
def test_gains_deviations_against_drawn_pairs():
    """Against 20,000 pairs of files, drawn by deviations that are correlated."""
    names, added = ["M", "K", "Z", "rest"], 0.017
    chance = np.random.default_rng(4)
    mixed = chance.normal(size=(4, 4)) + np.eye(4)
    from_one = mixed @ mixed.T
    size = np.array([2e-5, 4e-3, 3e-4, 2e-7]) / np.sqrt(np.diag(from_one))
    covariance = from_one * np.outer(size, size)
    deviations = dict(zip(names, np.sqrt(np.diag(covariance)), strict=True))
    single = np.sqrt(np.diag(covariance))
    correlations = {
        (a, b): covariance[i, j] / (single[i] * single[j])
        for i, a in enumerate(names)
        for j, b in enumerate(names[:i])
    }
    centres = [
        np.array([0.4 + extra, 60.0, 1.2, -2.5e-3 - extra * 9.80665 / 60]) for extra in (0, added)
    ]

    def file(values: np.ndarray) -> Calibration:
        figures = dict(zip(names, map(float, values), strict=True))
        return Calibration(figures, deviations, (), "2026-11-22", correlations)

    output = gains(*map(file, centres), added)
    drawn = [chance.multivariate_normal(centre, covariance, 20_000) for centre in centres]
    each = [gains(file(a), file(b), added) for a, b in zip(*drawn, strict=True)]
    for name, item in output.items():
        spread = np.std([other[name].value for other in each])
        assert item.deviation == pytest.approx(spread, rel=0.03), name


FITTED = (0, 1, 2, 3, 4, 6, 10, 11, 12)  # of a key with dry friction, delay and a mode


def fitted(row: np.ndarray, covariance: np.ndarray) -> Measured:
    fit = Fit(row, FITTED, (0.0,), covariance, 4e-6, 10_000)
    return Measured((), fit, 4e-6, 4e-6)


def spread(seed: int) -> np.ndarray:
    """A covariance of all that is fitted, a ten-thousandth of each parameter, correlated."""
    chance = np.random.default_rng(seed)
    mixed = chance.normal(size=(9, 9)) + 2 * np.eye(9)
    size = 1e-4 * KEY[list(FITTED)]
    covariance = mixed @ mixed.T
    scale = size / np.sqrt(np.diag(covariance))
    return np.asarray(covariance * np.outer(scale, scale))


def test_calibration_covariance_against_drawn_keys():
    """Against 20,000 keys drawn by the covariance of the fit, each with its own figures."""
    covariance = spread(1)
    known = read(text(fitted(KEY, covariance), [], "2026-11-22"))
    names = list(known.deviations)
    assert names == ["M", "rest", "K", "Z", "dry", "delay", "mode1.M", "mode1.f", "mode1.t60"]
    drawn = np.random.default_rng(2).multivariate_normal(KEY[list(FITTED)], covariance, 20_000).T
    m, k, z, w, dry, delay, mode, f, ratio = drawn
    decay = 3 * np.log(10) / (2 * np.pi * f * ratio)
    figures = np.array([m + mode, -w / k, k, z, dry, delay, mode, f, decay])
    assert np.allclose([known.figures[name] for name in names], figures.mean(axis=1), rtol=2e-4)
    assert np.allclose([known.deviations[name] for name in names], figures.std(axis=1), rtol=0.03)
    size = np.array([known.deviations[name] for name in names])
    correlations = known.covariance(names) / np.outer(size, size)
    assert np.abs(correlations - np.corrcoef(figures)).max() < 0.03
    assert np.array_equal(correlations, correlations.T)


def test_chi_squared_mean_is_figure_count():
    """500 pairs of calibrations of one key, each drawn by its covariance and written to a file."""
    first, other = spread(3), spread(4)
    chance = np.random.default_rng(5)
    result = []
    for _ in range(500):
        pair = []
        for covariance in (first, other):
            row = KEY.copy()
            row[list(FITTED)] = chance.multivariate_normal(KEY[list(FITTED)], covariance)
            pair.append(read(text(fitted(row, covariance), [], "2026-11-22")))
        squared, n = chi_squared(pair[0], pair[1])
        assert n == 9
        result.append(squared)
    assert abs(np.mean(result) - 9) < 4 * np.sqrt(18 / 500)
    assert abs(np.var(result) - 18) < 6


def test_compare_modes_at_same_pitch():
    first = read(TEXT.replace("modes:\n", "modes:\n  - {M: 1g, f: 900Hz, t60: 1s} # ± 0.1 2 0.3\n"))
    other = read(TEXT.replace("180Hz, t60: 0.30540s}", "186Hz, t60: 0.3s} # ± 0.1 0.5 0.01"))
    rows = {each.names: each for each in differences(first, other)}
    assert ("mode2.f", "mode1.f") in rows
    assert rows["mode2.f", "mode1.f"].deviation is None
    alone = rows["mode1.f", "mode0.f"]
    assert (alone.first_value, alone.second_value, alone.deviation_ratio) == (900.0, None, None)
    again = {each.names: each for each in differences(other, other)}
    assert again["mode1.f", "mode1.f"].deviation == pytest.approx(0.5 * np.sqrt(2))


@pytest.mark.parametrize("row", ["  - K 7.0", "  - K -1.0000000 2", "  - K x", "correlations: 3"])
def test_damaged_correlations_stay_bounded(row: str):
    result = read(TEXT + f"correlations:\n  - M\n{row}\n")
    assert all(abs(x) <= 1 for x in result.correlations.values())
    assert np.isfinite(chi_squared(result, result)[0])


def test_sensor_step_of_positions():
    took = gesture(KEY, rain(KEY, 2.0), 5)
    assert sensor_step([took, gesture(KEY, knocks(KEY), 6)]) == pytest.approx(QUANTUM, rel=1e-9)
    smooth = took.position + 1e-6 * np.random.default_rng(1).normal(size=took.position.size)
    assert sensor_step([replaced(took, smooth)]) is None
    assert sensor_step([replaced(took, np.zeros(took.position.size))]) is None


def replaced(took: Gesture, position: np.ndarray) -> Gesture:
    return dataclasses.replace(took, position=position)
