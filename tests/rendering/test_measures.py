"""Figures of sounds whose figures are known from their formulas."""

import numpy as np
import pytest

from ergon.rendering.measures import Measures, measure_sound

RATE = 44_100.0
T = np.arange(int(2 * RATE)) / RATE


def ring(f: float, t60: float, amplitude: float = 1.0) -> np.ndarray:
    return amplitude * np.sin(2 * np.pi * f * T) * 10 ** (-3 * T / t60)


@pytest.mark.parametrize(("f", "t60"), [(110.0, 1.5), (441.3, 0.5), (1234.5, 0.8)])
def test_measures_of_decaying_tone_with_harmonic(f: float, t60: float):
    result = measure_sound((ring(f, t60) + ring(2 * f, t60, 0.3))[:, None], RATE)
    assert result.pitch == pytest.approx(f, rel=2e-3)
    assert result.partial == pytest.approx(f, rel=1e-4)
    assert result.t60 == pytest.approx(t60, rel=2e-3)
    # Powers 1 and 0.09 at f and 2f.
    assert result.centroid == pytest.approx(f * (1 + 2 * 0.09) / 1.09, rel=0.03)


def test_measures_of_two_channels_and_last_blow():
    twice = np.concatenate([ring(300.0, 0.4), ring(300.0, 0.9)])
    frames = np.stack([twice, 0.5 * twice], axis=1)
    assert measure_sound(frames, RATE).t60 == pytest.approx(0.9, rel=2e-3)


def test_measures_of_noise_have_no_pitch_and_t60():
    noise = np.random.default_rng(1).standard_normal((44_100, 2))
    result = measure_sound(noise, RATE)
    assert result.pitch is None
    assert result.t60 is None
    # White noise: the middle of 20 Hz and half the rate.
    assert result.centroid == pytest.approx(RATE / 4, rel=0.03)
    nothing = Measures(None, None, None, None)
    assert measure_sound(np.zeros((1000, 1)), RATE) == nothing
    assert measure_sound(np.zeros((0, 1)), RATE) == nothing
    cut = measure_sound(ring(200.0, 4.0)[:, None], RATE)  # it ends 30 dB below its beginning
    assert cut.t60 is None
    assert cut.pitch == pytest.approx(200.0, rel=2e-3)


def test_measures_of_short_sounds_without_pitch():
    for n in (1, 2, 3, 100, 1700):
        assert measure_sound(np.sin(np.arange(1.0, n + 1))[:, None], RATE).pitch is None
