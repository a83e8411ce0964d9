"""An even path from positions that arrive unevenly, in virtual time."""

import math
from pathlib import Path

import numpy as np
import pytest

from docs.generators.hand_paths import DELAY, JITTERS, RATES, hand, path_error, with_table
from ergon import _core


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("jitter", JITTERS)
def test_led_path_error_of_stamped_positions(rate: float, jitter: float):
    """The error of a line between positions is at most a·gap²/8, wherever they came from."""
    error = path_error(rate, jitter, are_stamped=True)
    t = np.arange(0.0, 2.0, 1e-5)
    acceleration = np.max(np.abs(np.diff(hand(t), 2))) / 1e-10
    on_the_way = 1.0 / rate + jitter
    if on_the_way < DELAY:
        assert error.late == 0
        assert error.greatest <= 1.05 * acceleration / rate**2 / 8.0
    else:
        assert error.late > 0


@pytest.mark.parametrize("jitter", JITTERS[1:])
def test_led_path_error_of_unstamped_positions(jitter: float):
    stamped = path_error(250.0, jitter, are_stamped=True)
    arrived = path_error(250.0, jitter, are_stamped=False)
    assert arrived.rms > 2.0 * stamped.rms
    speed = np.max(np.abs(np.diff(hand(np.arange(0.0, 2.0, 1e-5))))) / 1e-5
    # A position is at most half the jitter from its place in the mean latency.
    assert arrived.greatest < speed * 0.5 * jitter + stamped.greatest + 1e-4


def test_led_path_before_first_position():
    instant = np.array([1.0])
    times = np.array([0.5, 1.0, 1.019, 1.021])
    path, late = _core.even_path(instant, instant, np.array([0.01]), times, 0.02)
    assert [math.isnan(x) for x in path] == [True, True, True, False]
    assert path[-1] == 0.01
    assert late == 0


def test_hands_page_table_of_path_errors():
    page = (Path(__file__).parents[2] / "docs/howto/hands.md").read_text()
    assert "| 125 Hz | 2 ms | 20 ms | 0.031 mm" in page
    assert with_table(page) == page
