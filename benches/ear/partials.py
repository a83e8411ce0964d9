"""Figures of the partials of a sound: how many, how even, how they fall and beat."""

from __future__ import annotations

import math

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from benches.ear.features import FEATURES, NAMES, OCTAVES
from benches.ear.sound import (
    RATE,
    Figures,
    Samples,
    attack,
    decay_time,
    decays,
    decibels,
    from_onset,
    slope,
    spectra,
)

_STRONGEST = 12  # partials that are followed in time
_REGIONS = {"lo": (40, 1000), "mid": (1000, 4000), "hi": (4000, 12_000)}  # [Hz]


def measure(x: Samples, rate: float) -> Samples:
    """All features of a sound, in the order of `NAMES`; nan where there is nothing to measure.

    Raises ValueError for silence.
    """
    y = from_onset(x, rate)
    if y is None:
        raise ValueError("the sound is silent")
    figures = {**attack(y), **spectra(y), **decays(y), **_partials(y)}
    for centre in OCTAVES[1:8]:  # a decay is judged where there is sound
        if figures[f"b_{centre}"] < -45:
            figures[f"t60_{centre}"] = math.nan
    return np.array([bounded(name, figures[name]) for name in NAMES])


def bounded(name: str, value: float) -> float:
    """A figure within the bounds beyond which nobody hears a difference."""
    feature = FEATURES[name]
    if math.isnan(value):
        return value
    if feature.low is not None:
        value = max(value, feature.low)
    return value if feature.high is None else min(value, feature.high)


def _partials(y: Samples) -> Figures:
    part = y[2205 : 2205 + RATE // 2] * np.hanning(RATE // 2)
    n = 1 << 16
    power, f = np.abs(np.fft.rfft(part, n)) ** 2, np.fft.rfftfreq(n, 1 / RATE)
    level = decibels(power / power.max())
    tops = _tops(f, level)
    pitches, strengths = f[tops], level[tops]
    figures = _counts(pitches, strengths)
    order = np.argsort(-strengths)[:_STRONGEST]
    strongest = pitches[order]
    figures["fmax"] = math.log2(strongest[0]) if len(strongest) else math.nan
    figures["ratio2"] = math.nan
    if len(strongest) > 1:
        figures["ratio2"] = float(np.clip(math.log2(strongest[1] / strongest[0]), -4, 4))
    figures |= _noise(f, power, level, tops)
    figures["hnr"] = _periodicity(y)
    figures |= _falls(y, strongest)
    figures |= _steadiness(y, strongest[0]) if len(strongest) else _UNSTEADY
    return figures


_UNSTEADY = {"jitter": math.nan, "chirp": math.nan}


def _tops(f: Samples, level: Samples) -> NDArray[np.intp]:
    """Peaks, the highest within 20 Hz and 9 dB above what lies around them."""
    width = int(20 / f[1])
    padded = np.pad(level, (width, width), constant_values=-300.0)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).max(axis=1)
    tops = np.flatnonzero((level >= around) & (level > -70) & (f > 30) & (f < 18_000))
    floor = np.array([np.median(level[max(0, i - 160) : i + 161]) for i in tops])
    return tops[level[tops] > floor + 9] if len(tops) else tops


def _counts(pitches: Samples, strengths: Samples) -> Figures:
    def count(inside: NDArray[np.bool_]) -> float:
        return math.log2(1 + int(np.sum(inside)))

    def crowded(low: float, high: float) -> float:
        inside = (pitches > low) & (pitches < high)
        return count(inside & (strengths > np.max(strengths[inside], initial=-300.0) - 40))

    strong = pitches[strengths > -60]
    return {
        "n60": count(strengths > -60),
        "n40": count(strengths > -40),
        "dens24": crowded(2000, 4000),
        "dens48": crowded(4000, 8000),
        "top": math.log2(strong.max()) if len(strong) else math.nan,
    }


def _noise(f: Samples, power: Samples, level: Samples, tops: NDArray[np.intp]) -> Figures:
    """Partials over what lies between them."""
    tonal = np.zeros(len(f), bool)
    for i in tops:
        tonal[max(0, i - 9) : i + 10] = True
    figures: Figures = {}
    for r, (low, high) in _REGIONS.items():
        inside = (f > low) & (f < high)
        figures |= {f"tnr_{r}": math.nan, f"gap_{r}": math.nan}
        if power[inside].sum() / power.sum() > 1e-8:
            ratio = power[inside & tonal].sum() / (power[inside & ~tonal].sum() + 1e-20)
            figures[f"tnr_{r}"] = float(np.clip(decibels(ratio), -30, 50))
            gap = np.median(level[inside]) - level[inside].max()
            figures[f"gap_{r}"] = float(np.clip(gap, -90, 0))
    return figures


def _periodicity(y: Samples) -> float:
    """Harmonics over noise [dB], by the autocorrelation (Boersma, 1993)."""
    window = np.hanning(int(0.2 * RATE))

    def correlation(x: Samples) -> Samples:
        return np.fft.irfft(np.abs(np.fft.rfft(x, 1 << 15)) ** 2)

    lags = slice(RATE // 2000, RATE // 40)
    signal = correlation(y[2205 : 2205 + len(window)] * window)
    weights = correlation(window)
    periods = (signal[lags] / (signal[0] + 1e-30)) / (weights[lags] / weights[0])
    fallen = periods < 0.5 * periods.max()
    begin = int(np.argmax(fallen)) if np.any(fallen) else 0
    highest = float(np.clip(periods[begin:].max(), 0.01, 0.9999))
    return 10 * math.log10(highest / (1 - highest))


def _falls(y: Samples, pitches: Samples) -> Figures:
    """How the strongest partials fall and beat."""
    n = int(0.06 * RATE)
    starts = np.arange(int(0.03 * RATE), len(y) - n, n // 4)
    t, window = starts / RATE, np.hanning(n)
    times, beats, changes, octaves = [], [], [], []
    for f in pitches:
        wave = np.exp(-2j * np.pi * f * np.arange(len(y)) / RATE) * y
        level = 2 * decibels(np.array([abs(np.dot(wave[i : i + n], window)) for i in starts]))
        level = level - level[:6].max()
        fallen = np.flatnonzero(level < -40)
        end = int(fallen[0]) if len(fallen) else len(level)
        if end < 8:
            continue
        steep, start = np.polyfit(t[:end], level[:end], 1)
        times.append(decay_time(float(steep)))
        octaves.append(math.log2(f))
        smooth = steep * t[:end] + start
        if end > 12:
            smooth = scipy.signal.savgol_filter(level[:end], min(31, (end // 2) * 2 - 1), 2)
        beats.append(float(np.std(level[:end] - smooth)))
        first = (t > 0.03) & (t < 0.3)
        then = (t > 0.6) & (t < 1.6) & (np.arange(len(t)) < end)
        if then.sum() > 10:
            early, late = slope(t[first], level[first]), slope(t[then], level[then])
            change = math.log2(max(-early, 1.0) / max(-late, 1.0))
            changes.append(float(np.clip(change, -4, 4)))
    figures = {
        "t60_med": float(np.median(times)) if times else math.nan,
        "beat": float(np.median(beats)) if beats else math.nan,
        "slopes_p": float(np.median(changes)) if changes else math.nan,
        "t60_slope": math.nan,
        "t60_scatter": math.nan,
    }
    if len(times) > 3 and np.ptp(octaves) > 0.5:
        line = np.polyfit(octaves, times, 1)
        octaves_of_time = math.log2(10)
        figures["t60_slope"] = float(np.clip(line[0] * octaves_of_time, -3, 3))
        away = np.array(times) - np.polyval(line, octaves)
        figures["t60_scatter"] = float(np.std(away) * octaves_of_time)
    return figures


def _steadiness(y: Samples, f: float) -> Figures:
    """How the pitch of a partial moves, by its analytic signal."""
    transform, frequencies = np.fft.rfft(y), np.fft.rfftfreq(len(y), 1 / RATE)
    band = np.clip(1.5 - np.abs(frequencies - f) / max(0.03 * f, 12), 0, 1) * 2
    analytic = np.fft.ifft(np.pad(transform * band, (0, len(y) - len(transform))))
    turning = np.diff(np.unwrap(np.angle(analytic))) * RATE / 2 / np.pi
    pitch = scipy.signal.oaconvolve(turning, np.ones(882) / 882, "same")
    figures = dict(_UNSTEADY)
    late = slice(int(0.2 * RATE), int(1.2 * RATE))
    loud = np.abs(analytic)[late] > 0.03 * np.abs(analytic).max()
    if loud.sum() > RATE // 4:
        cents = 1200 / math.log(2) * np.std(pitch[late][loud]) / f
        figures["jitter"] = math.log10(float(np.clip(cents, 0.01, 100)))
    first = np.median(pitch[int(0.02 * RATE) : int(0.05 * RATE)])
    then = np.median(pitch[int(0.25 * RATE) : int(0.4 * RATE)])
    if first > 0 and then > 0:
        figures["chirp"] = float(np.clip(1200 * math.log2(first / then), -300, 300))
    return figures
