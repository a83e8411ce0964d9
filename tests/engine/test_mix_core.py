"""Mixer, limiter, meter and integer samples against scipy, numpy and their own promises."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from ergon._core import Limiter, Meter, Mixer, pcm, single

RATE = 44100.0


def noise(n_frames: int, n: int, level: float = 0.3) -> np.ndarray:
    return level * np.random.default_rng(n).standard_normal((n_frames, n))


@pytest.mark.parametrize("cutoff", [8.0, 120.0, 9000.0])
def test_highpass_equals_scipy(cutoff: float) -> None:
    frames, mixed = noise(20000, 1) + 0.5, np.empty((20000, 1))
    mixer = Mixer(RATE, 1, 1)
    mixer.route(0, 0, 0.7, highpass=cutoff)
    mixer.process(frames, mixed)
    sos = butter(2, cutoff, "highpass", fs=RATE, output="sos")
    # scipy's direct form loses (rate / cutoff)² of the last bit at 8 Hz: 2e-12.
    assert np.abs(mixed - 0.7 * sosfilt(sos, frames, axis=0)).max() < 1e-11


def test_mixer_routes_equal_matrix_product() -> None:
    frames, mixed = noise(500, 3), np.full((500, 4), np.nan)
    gains = np.array([[1.0, 0.0, 0.5], [0.0, -2.0, 0.0], [0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
    mixer = Mixer(RATE, 3, 4)
    for channel, out in np.argwhere(gains):
        mixer.route(int(out), int(channel), float(gains[channel, out]))
    mixer.process(frames, mixed)
    assert np.abs(mixed - frames @ gains.T).max() < 1e-15


def test_limiter_ceiling_and_unchanged_quiet_parts() -> None:
    frames = noise(60000, 3, 0.05)
    frames[20000:21000] *= 60.0
    before = frames.copy()
    limiter = Limiter(RATE, 3, 0.891)
    for block in np.split(frames, [64, 128, 5000, 33333]):
        limiter.process(block)
    late = limiter.latency
    assert late == 221
    assert np.abs(frames).max() <= 0.891
    assert np.abs(frames).max() > 0.88, "as loud as it may"
    assert np.array_equal(frames[late:20000], before[: 20000 - late])
    # Two seconds later the gain is exactly one again.
    quiet = np.zeros((2 * 44100, 3)) + 0.01
    limiter.process(quiet)
    assert np.array_equal(quiet[-100:], np.full((100, 3), 0.01))


def test_meter_loudness_and_peak_of_tone() -> None:
    t = np.arange(4 * 48000) / 48000
    tone = 0.1 * np.sin(2 * np.pi * 997 * t)
    meter = Meter(48000.0, 2)
    assert meter.loudness == -np.inf
    meter.process(np.column_stack([tone, tone]))
    assert meter.loudness == pytest.approx(-20.0, abs=0.02)
    assert meter.peak == np.abs(tone).max()


@pytest.mark.parametrize("bits", [16, 24])
def test_pcm_equals_numpy_rint(bits: int) -> None:
    frames = noise(5000, 2, 0.6)
    frames[:64, 0] = (np.arange(64) - 32 + 0.5) / 2 ** (bits - 1)
    full = 2 ** (bits - 1)
    codes = pcm(frames, 0.5, bits)  # type: ignore[arg-type]
    wanted = np.clip(np.rint(frames * 0.5 * full), -full, full - 1).astype(np.int64)
    assert codes.dtype == np.int32
    assert np.array_equal(codes.astype(np.int64), wanted << (32 - bits))
    assert np.array_equal(pcm(np.array([[np.nan]]), 1.0, bits), [[0]])  # type: ignore[arg-type]


def test_single_equals_numpy_cast() -> None:
    frames = noise(100, 2)
    result = single(frames, 0.3)
    assert result.dtype == np.float32
    assert np.array_equal(result, (frames * 0.3).astype(np.float32))


def test_mixer_shape_and_layout_errors() -> None:
    mixer = Mixer(RATE, 2, 1)
    with pytest.raises(ValueError, match=r"frames must be \(n_frames, 2\)"):
        mixer.process(np.zeros((5, 3)), np.zeros((5, 1)))
    with pytest.raises(ValueError, match="`frames` has 5 frames and `mixed` has 6"):
        mixer.process(np.zeros((5, 2)), np.zeros((6, 1)))
    with pytest.raises(ValueError, match="C-contiguous"):
        Limiter(RATE, 2, 1.0).process(np.zeros((2, 5)).T)
    with pytest.raises(ValueError, match="C-contiguous"):
        pcm(np.zeros((2, 5)).T, 1.0, 16)
    with pytest.raises(ValueError, match="16 or 24"):
        pcm(np.zeros((2, 5)), 1.0, 32)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no output 2"):
        mixer.route(2, 0)
    with pytest.raises(ValueError, match="highpass"):
        mixer.route(0, 0, highpass=RATE / 2)
    with pytest.raises(ValueError, match="ceiling"):
        Limiter(RATE, 2, 0.0)
    with pytest.raises(ValueError, match="64 channels"):
        Meter(RATE, 65)
