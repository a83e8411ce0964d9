"""How far one sound is from another: waveform, spectrum, bands.

Sounds are arrays (n_frames,) or (n_frames, n_channels); the second one is always the reference.
Nothing here ever becomes a sample.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ergon import _core

Floats = NDArray[np.float64]

EARLY_DURATION = 0.1  # [s] of sound before small errors of pitch dominate a difference of waveforms
_ONSET_RATIO = 1e-3  # of the peak: -60 dB
_ROUNDING_RATIO = 1e-13  # differences below this share of the sound are rounding
WINDOW_FRAMES = (512, 2048, 8192)  # frames: strokes, notes, partials
_COMPARED_DB = -60.0  # below a frame's strongest bin nothing is compared
_SILENT_DB = -120.0  # frames so far below the loudest one are silence
_DIFFERENCE_DB_MAX = 100.0  # a bin that is missing altogether differs by this


def waveform_db(y: Floats, x: Floats) -> float:
    """20·log10(‖y - x‖/‖x - mean‖) of the worst channel, by the measure of plans.

    -inf if the sounds are equal within rounding, inf if only x is silent. A channel that is silent
    beside the others, within rounding, is not counted.
    """
    y_columns, x_columns = _columns(y), _columns(x)
    rounding = _ROUNDING_RATIO * np.linalg.norm(x_columns)
    is_counted = np.linalg.norm(y_columns - x_columns, axis=0) > rounding
    if not is_counted.any():
        return -inf
    y_columns, x_columns = (
        np.ascontiguousarray(sound[:, is_counted]) for sound in (y_columns, x_columns)
    )
    return _core.waveform_errors(y_columns, x_columns, [len(x_columns)])[0]


def onset_frame(x: Floats) -> int | None:
    """The first frame within 60 dB of the peak; None for silence."""
    amplitudes = np.abs(_columns(x)).max(axis=1, initial=0.0)
    peak = amplitudes.max(initial=0.0)
    return int(np.argmax(amplitudes >= _ONSET_RATIO * peak)) if peak > 0.0 else None


def early_db(y: Floats, x: Floats, rate: float, duration: float = EARLY_DURATION) -> float:
    """`waveform_db` over the first `duration` [s] of sound, by default 0.1 s."""
    first_frame = onset_frame(x) or 0
    span = slice(first_frame, first_frame + max(1, round(duration * rate)))
    return waveform_db(y[span], x[span])


@dataclass(frozen=True, slots=True)
class Spectral:
    """Means over three resolutions: `difference` of levels [dB], `convergence` of magnitudes."""

    difference: float
    convergence: float


def spectral_difference(y: Floats, x: Floats) -> Spectral:
    """Multi-resolution difference of short-time spectra, which ignores phases.

    `difference` is the mean |ΔdB| over bins within 60 dB of their frame's strongest;
    `convergence` is ‖|Y| - |X|‖/‖|X|‖. Zero for silence.
    """
    differences = [_spectral_difference(y, x, size) for size in WINDOW_FRAMES]
    return Spectral(*(float(np.mean(column)) for column in zip(*differences, strict=True)))


def _spectral_difference(y: Floats, x: Floats, window_size: int) -> tuple[float, float]:
    """(mean |ΔdB|, convergence) with windows of `window_size` frames."""
    total_db, n_bins, error_energy, energy = 0.0, 0, 0.0, 0.0
    for y_column, x_column in zip(_columns(y).T, _columns(x).T, strict=True):
        magnitudes, reference_magnitudes = (
            _magnitudes(y_column, window_size),
            _magnitudes(x_column, window_size),
        )
        error_energy += float(np.sum((magnitudes - reference_magnitudes) ** 2))
        energy += float(np.sum(reference_magnitudes**2))
        frame_peaks = reference_magnitudes.max(axis=1, keepdims=True)
        is_loud = frame_peaks > 10.0 ** (_SILENT_DB / 20.0) * frame_peaks.max()
        is_audible = is_loud & (reference_magnitudes > 10.0 ** (_COMPARED_DB / 20.0) * frame_peaks)
        ratio_min = 10.0 ** (-_DIFFERENCE_DB_MAX / 20.0)
        magnitude_ratios = np.maximum(
            magnitudes[is_audible] / reference_magnitudes[is_audible], ratio_min
        )
        total_db += float(np.sum(np.abs(20.0 * np.log10(magnitude_ratios))))
        n_bins += int(np.count_nonzero(is_audible))
    if n_bins == 0:
        return 0.0, 0.0 if error_energy == 0.0 else inf
    return total_db / n_bins, float(np.sqrt(error_energy / energy))


def _magnitudes(x: Floats, window_size: int) -> Floats:
    """Short-time magnitudes (n_windows, n_bins) by Hann windows a quarter apart."""
    padded = np.pad(x, (0, max(0, window_size - len(x))))
    window = np.hanning(window_size + 1)[:-1]
    return np.abs(
        np.fft.rfft(sliding_window_view(padded, window_size)[:: window_size // 4] * window, axis=1)
    )


def third_octaves(x: Floats, rate: float) -> tuple[Floats, Floats]:
    """Centres [Hz] and rms levels [dB re 1] of the third octaves from 25 Hz to 0.45·rate."""
    columns = _columns(x)
    power = np.sum(np.abs(np.fft.rfft(columns, axis=0)) ** 2, axis=1) / len(columns) ** 2
    power[1:] *= 2.0  # negative frequencies
    frequency = np.fft.rfftfreq(len(columns), 1.0 / rate)
    centres = np.array(list(_band_centres(min(20e3, 0.45 * rate))))
    first_bins, end_bins = (
        np.searchsorted(frequency, centres * 2.0**step) for step in (-1 / 6, 1 / 6)
    )
    cumulative_power = np.concatenate([[0.0], np.cumsum(power)])
    band_powers = cumulative_power[end_bins] - cumulative_power[first_bins]
    return centres, 10.0 * np.log10(np.maximum(band_powers, 1e-300))


def bands_db(y: Floats, x: Floats, rate: float) -> float:
    """Mean difference of third octaves [dB], over those within 60 dB of the reference's strongest.

    It still compares sounds whose waveforms have diverged for good, such as a gong, a bow or a
    rattle.
    """
    y_levels, x_levels = (third_octaves(sound, rate)[1] for sound in (y, x))
    is_audible = x_levels > x_levels.max() + _COMPARED_DB
    return float(np.mean(np.minimum(np.abs(y_levels - x_levels)[is_audible], _DIFFERENCE_DB_MAX)))


def _band_centres(frequency_max: float) -> Iterator[float]:
    """1000·2^(i/3) Hz, up to the highest band."""
    i = -16  # 25 Hz
    while (centre := 1000.0 * 2.0 ** (i / 3)) <= frequency_max:
        yield centre
        i += 1


def _columns(x: Floats) -> Floats:
    return x[:, None] if x.ndim == 1 else x
