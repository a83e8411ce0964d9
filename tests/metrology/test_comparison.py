"""Calibrations beside each other, and a gesture on a key beside its model."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from measured_keys import KEY, gesture, knocks

from ergon.metrology.calibration_file import Calibration, read
from ergon.metrology.comparison import chi_squared, gains, replay, replay_difference
from ergon.metrology.gesture import MeasurementError
from ergon.metrology.picture import picture

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


def test_a_file_is_the_row_that_it_was_written_from():
    found = read(TEXT)
    assert np.allclose(found.row, KEY, rtol=1e-4)
    assert found.date == "2026-11-22"
    assert found.deviations["K"] == 1e-3


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("ergon: 1\nM: 400g\nK: 60N/m\n", "it lacks Z"),
        (TEXT.replace("400.0g", "0.4kg"), "M must be in g"),
    ],
)
def test_what_is_no_calibration_is_refused(said: str, told: str):
    with pytest.raises(MeasurementError, match=told):
        read(said)


def test_a_replay_leaves_the_sensor_s_noise():
    took = gesture(KEY, knocks(KEY), 5)
    found = replay(KEY, took)
    assert 3.5e-6 < found.rms < 4.6e-6
    heavier = KEY.copy()
    heavier[0] *= 1.01
    worse = replay(heavier, took)
    assert worse.rms > 3 * found.rms
    drawn = picture(found, "key", worse)
    root = ET.fromstring(drawn)
    shown = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    for label in ("asked", "real", "model", "residual", "position [mm]", "M K Z alone [um]"):
        assert label in shown
    assert len(drawn) < 400_000


def test_keys_that_are_alike_move_alike():
    one = read(TEXT).row
    assert replay_difference(one, one) == 0
    stiffer, heavier = one.copy(), one.copy()
    stiffer[1] *= 1.001
    heavier[0] *= 1.01
    assert 1e-7 < replay_difference(one, stiffer) < replay_difference(one, heavier)
    # Where a key rests says nothing of how it moves.
    elsewhere = one.copy()
    elsewhere[3] *= 2
    assert replay_difference(one, elsewhere) < 1e-12


def test_chi_squared_counts_deviations():
    squared, n = chi_squared(known(), known(K=60.0 + 2e-3 * np.sqrt(2)))
    assert n == 5
    assert abs(squared - 4) < 1e-6


def test_a_weighed_mass_tells_the_gains():
    """A device whose sensor reads 1.1 m for a metre, and whose motor gives 0.8 N for a newton."""
    reads, pushes, added = 1.1, 0.8, 0.017
    gain = reads * pushes

    def found(mass: float, sinks: float) -> Calibration:
        return known(M=mass / gain, K=60 / gain, Z=1.2 / gain, rest=-2.5e-3 - reads * sinks)

    plain, loaded = found(0.4, 0.0), found(0.4 + added, added * 9.80665 / 60)
    assert np.allclose(gains(plain, loaded, added), (gain, reads), rtol=1e-9)
    lying = found(0.4 + added, 0.0)
    assert gains(plain, lying, added)[1] is None
    with pytest.raises(MeasurementError, match="no heavier"):
        gains(loaded, plain, added)
