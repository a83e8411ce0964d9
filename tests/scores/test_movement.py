"""Figures of movements against closed forms: the minimum-jerk movement, a sinusoid, a bounce."""

import numpy as np
import pytest
from scipy.integrate import quad

from ergon.scores.gesture.movement import movement_stats, spectral_arc_length

A, T = 0.12, 0.8  # of a movement: m, s
RATE = 1000.0


def minimum_jerk(t):
    s = np.clip(t / T, 0, 1)
    return A * s**3 * (10 - 15 * s + 6 * s * s)


def speed(t):
    s = t / T
    return 30 * A / T * s * s * (1 - s) ** 2


def test_movement_stats_of_minimum_jerk():
    """Flash & Hogan 1985: peak speed 15/8, peak acceleration 10/√3, means by the polynomials."""
    t = np.arange(round(T * RATE) + 1) / RATE
    result = movement_stats(t, minimum_jerk(t), cutoff=100.0)
    assert result.duration == pytest.approx(T)
    assert (result.low, result.high) == pytest.approx((0, A))
    assert result.path == pytest.approx(A, rel=1e-4)
    assert result.speed_peak == pytest.approx(15 / 8 * A / T, rel=1e-4)
    assert result.speed_rms == pytest.approx(np.sqrt(10 / 7) * A / T, rel=1e-3)
    assert result.acceleration_peak == pytest.approx(10 / np.sqrt(3) * A / T**2, rel=1e-3)
    assert result.acceleration_rms == pytest.approx(np.sqrt(120 / 7) * A / T**2, rel=2e-3)
    assert result.reversals.size == result.strikes.size == 0
    # The arc length by quadrature of the Fourier integral of the speed.
    assert result.smoothness == pytest.approx(-arc_length(), rel=2e-3)


def arc_length() -> float:
    """Balasubramanian & others 2012, of the minimum-jerk speed, by quadrature."""
    limit = 40 * np.pi
    omega = np.linspace(0, limit, 2001)

    def size(w: float) -> float:
        # About its middle the speed is even, so its transform is a cosine's.
        return abs(quad(lambda t: speed(t) * np.cos(w * (t - T / 2)), 0, T, limit=400)[0]) / A

    height = np.array([size(w) for w in omega])
    return float(np.hypot(np.diff(height), np.diff(omega) / limit).sum())


def test_smoothness_independent_of_size_rest_and_rate():
    t = np.arange(round(T * RATE) + 1) / RATE
    v = speed(t)
    first = spectral_arc_length(v, RATE)
    assert spectral_arc_length(7 * v, RATE) == pytest.approx(first, rel=1e-12)
    rested = np.concatenate([np.zeros(400), v, np.zeros(300)])
    assert spectral_arc_length(rested, RATE) == pytest.approx(first, rel=1e-3)
    assert spectral_arc_length(speed(t[::2]), RATE / 2) == pytest.approx(first, rel=1e-3)
    # Two movements in a row are less smooth than one.
    assert spectral_arc_length(np.concatenate([v, v]), RATE) < first - 0.1


@pytest.mark.parametrize("single_rate", [1002.27, 120.0])
def test_movement_stats_of_sinusoid(single_rate):
    f, size, seconds = 3.0, 4e-3, 10.0
    t = np.arange(int(seconds * single_rate) + 1) / single_rate
    result = movement_stats(t, size * np.sin(2 * np.pi * f * t))
    w = 2 * np.pi * f
    assert result.rms == pytest.approx(size / np.sqrt(2), rel=1e-3)
    assert result.speed_peak == pytest.approx(size * w, rel=1e-3)
    assert result.speed_rms == pytest.approx(size * w / np.sqrt(2), rel=1e-3)
    assert result.acceleration_rms == pytest.approx(size * w * w / np.sqrt(2), rel=5e-3)
    assert result.path == pytest.approx(4 * size * f * seconds, rel=1e-3)
    assert result.centre == pytest.approx(f, rel=1e-3)
    # That of the Hann window itself: 1/(√3 T).
    assert result.bandwidth == pytest.approx(1 / np.sqrt(3) / seconds, rel=0.02)
    quarter = (1 + 2 * np.arange(60)) / 4 / f
    assert np.abs(result.reversals - quarter).max() < 2e-3
    assert result.strikes.size == 0


def test_movement_stats_strikes_and_reversals_of_bounces():
    """A ball that falls 20 mm, five times: it turns above for long, and below at once."""
    g, height = 9.81, 0.02
    up = np.sqrt(2 * height / g)
    t = np.arange(round(10 * up * RATE)) / RATE
    phase = np.mod(t, 2 * up) - up
    x = height - g * phase**2 / 2
    result = movement_stats(t, x, cutoff=100.0)
    below = 2 * up * np.arange(1, 5)
    assert np.abs(result.strikes - below).max() < 2e-3
    assert result.reversals.size == 9


def test_movement_stats_ignores_small_reversals():
    t = np.arange(2000) / RATE
    x = 0.01 * np.sin(np.pi * t) + 0.0004 * np.sin(2 * np.pi * 9 * t)
    assert movement_stats(t, x).reversals.size == 3 - 1


def test_movement_stats_of_resting_hand():
    t = np.arange(100) / 100
    result = movement_stats(t, np.full(100, 0.003))
    assert (result.low, result.high, result.speed_peak) == pytest.approx(
        (0.003, 0.003, 0), abs=1e-12
    )
    assert result.reversals.size == 0
    two = movement_stats(np.array([0.0, 1e-3]), np.array([0.0, 1e-3]))
    assert (two.low, two.high, two.reversals.size) == (0.0, 1e-3, 0)
