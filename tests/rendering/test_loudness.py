"""Loudness and true peak, beside the formulas of BS.1770-4 and a polyphase resampler."""

import math

import numpy as np
import pytest
from bs1770 import RATE, integrated
from scipy.signal import resample_poly, upfirdn

from ergon import _core
from ergon.rendering.level import Level
from ergon.rendering.loudness import GatedLoudness
from ergon.rendering.measured_level import MeasuredLevel

# Phases 0 and 1 of four of BS.1770-4, Annex 2; 3 and 2 are these reversed.
_PHASES = np.array(
    [
        *(0.001708984375, 0.010986328125, -0.0196533203125, 0.033203125),
        *(-0.0594482421875, 0.1373291015625, 0.97216796875, -0.102294921875),
        *(0.047607421875, -0.026611328125, 0.014892578125, -0.00830078125),
        *(-0.0291748046875, 0.029296875, -0.0517578125, 0.089111328125),
        *(-0.16650390625, 0.465087890625, 0.77978515625, -0.2003173828125),
        *(0.1015625, -0.0582275390625, 0.0330810546875, -0.0189208984375),
    ]
).reshape(2, 12)


def sound(seconds: float = 6.0) -> np.ndarray:
    """Noise of two channels that rises by 40 dB, and a tone."""
    n_frames = int(seconds * RATE)
    t = np.arange(n_frames)[:, None] / RATE
    noise = np.random.default_rng(3).normal(size=(n_frames, 2)) * 10 ** (2 * t / seconds - 4)
    return noise + 0.01 * np.sin(2 * np.pi * 1000 * t)


@pytest.mark.parametrize("block", [999, 4096])
def test_loudness_at_any_gain(block):
    frames = sound()
    measured = GatedLoudness(RATE, 2)
    for n in range(0, len(frames), block):
        measured.take(frames[n : n + block])
    for gain in (0.02, 1.0, 25.0):
        assert measured.loudness(gain) == pytest.approx(integrated(gain * frames), abs=0.02)


@pytest.mark.parametrize(("asked", "limit"), [(-30.0, None), (-14.0, 0.8), (-45.0, None)])
def test_measured_gain_reaches_loudness(asked, limit):
    frames = 1e-3 * sound()
    measured = MeasuredLevel(Level(loudness=asked, limit=limit), RATE, 2)
    measured.take(frames)
    assert integrated(measured.gain() * frames) == pytest.approx(asked, abs=0.02)


def test_measured_gain_limited_by_peaks():
    frames = 1e-3 * sound()
    frames[RATE] = 0.5
    measured = MeasuredLevel(Level(loudness=-14.0), RATE, 2)
    measured.take(frames)
    peak = np.abs(resample_poly(measured.gain() * frames, 8, 1, axis=0)).max()
    assert 20 * math.log10(peak) == pytest.approx(-1.0, abs=0.3)


def test_measured_gain_of_short_sound_and_silence():
    short, silent = (MeasuredLevel(Level(loudness=-20.0), RATE, 1) for _ in range(2))
    tone = 0.1 * np.sin(2 * np.pi * 440 * np.arange(RATE // 5) / RATE)[:, None]
    short.take(tone)
    silent.take(np.zeros((RATE, 1)))
    assert np.abs(short.gain() * tone).max() == pytest.approx(10 ** (-1 / 20), rel=0.01)
    assert silent.gain() == 1.0


def test_true_peak_of_tone_between_samples():
    """At a quarter of the rate and 45 degrees samples are 3.01 dB below the crest."""
    tone = np.sin(np.pi / 2 * np.arange(4000) + np.pi / 4) * np.hanning(4000)
    for block in (64, 4000):
        meter = _core.TruePeak(1)
        for n in range(0, len(tone), block):
            meter.process(np.ascontiguousarray(tone[n : n + block, None]))
        assert np.abs(tone).max() == pytest.approx(math.sqrt(0.5), rel=1e-3)
        assert 20 * math.log10(meter.peak) == pytest.approx(0.0, abs=0.2)


def test_true_peak_of_noise():
    frames = sound(1.0)
    meter = _core.TruePeak(2)
    for n in range(0, len(frames), 777):
        meter.process(frames[n : n + 777])
    wanted = np.abs(resample_poly(frames, 16, 1, axis=0)).max()
    assert 20 * math.log10(meter.peak / wanted) == pytest.approx(0.0, abs=0.6)


def test_true_peak_where_few_samples_are_loud():
    """Equal to all values of the interpolation, however the sound is cut."""
    frames = sound(0.5) * 1e-3
    draws = np.random.default_rng(3)
    for n in (0, 63, 64, 700, 5000, len(frames) - 1):
        frames[n] += draws.normal(size=2)
    taps = np.concatenate([_PHASES, _PHASES[::-1, ::-1]]).T.reshape(-1)
    between = np.abs(upfirdn(taps, frames, 4, axis=0))[: 4 * len(frames)]
    wanted = max(float(between.max()), float(np.abs(frames).max()))
    for block in (1, 10, 64, 777, len(frames)):
        meter = _core.TruePeak(2)
        for n in range(0, len(frames), block):
            meter.process(frames[n : n + block])
        assert meter.peak == pytest.approx(wanted, rel=1e-12)
