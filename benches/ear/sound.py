"""Figures of a sound that do without its partials: attack, spectrum, bands, flatness, decay."""

from __future__ import annotations

import math

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from benches.ear.features import OCTAVES

Samples = NDArray[np.float64]
Figures = dict[str, float]

RATE = 44_100  # [Hz] at which sounds are compared
SECONDS = 2.4  # of them
_WINDOWS = {"a": (0.0, 0.05), "b": (0.0, 0.5), "c": (0.5, 1.5)}


def decibels(power: Samples | float) -> Samples:
    """Of a power; silence is -300 dB."""
    return np.asarray(10.0 * np.log10(np.asarray(power) + 1e-30))


def slope(t: Samples, level: Samples) -> float:
    """Of a line through levels, nan where there are fewer than three."""
    return float(np.polyfit(t, level, 1)[0]) if len(t) > 2 else math.nan


def decay_time(slope: float) -> float:
    """The logarithm of the T60 [s] of a slope [dB/s]."""
    return math.log10(float(np.clip(-60.0 / slope if slope < -1e-6 else 60.0, 0.02, 30.0)))


def from_onset(x: Samples, rate: float) -> Samples | None:
    """2.4 s from 2 ms before the onset, at 44.1 kHz, above 20 Hz, with a peak of 1; None if
    silent.
    """
    x = np.asarray(x, float)
    if rate != RATE:
        x = scipy.signal.resample_poly(x, RATE, int(rate))
    highpass = scipy.signal.butter(2, 20, "high", fs=RATE, output="sos")
    x = scipy.signal.sosfilt(highpass, x)
    peak = np.max(np.abs(x), initial=0.0)
    if peak < 1e-12:
        return None
    begins = max(0, int(np.argmax(np.abs(x) > 0.01 * peak)) - int(0.002 * RATE))
    n = int(SECONDS * RATE)
    y = x[begins : begins + n]
    y = np.pad(y, (0, n - len(y)))
    return np.asarray(y / np.max(np.abs(y)))


def smoothed(power: Samples, n: int) -> Samples:
    """A running mean of power under Hann's window of `n` frames."""
    window = np.hanning(n) / np.hanning(n).sum()
    return np.maximum(scipy.signal.oaconvolve(power, window, "same"), 0.0)


def attack(y: Samples) -> Figures:
    """How the sound begins."""
    envelope = np.sqrt(smoothed(y**2, int(0.003 * RATE)))[:: RATE // 1000][:1000]
    peak = envelope.max()
    low, high = np.argmax(envelope > 0.1 * peak), np.argmax(envelope > 0.9 * peak)

    def power(begin: float, end: float) -> float:
        part = y[int(begin * RATE) : int(end * RATE)]
        return float(np.sum(part**2)) / (end - begin)

    burst = decibels(power(0.0, 0.02) / (power(0.1, 0.2) + 1e-12))
    first = y[: int(0.05 * RATE)]
    crest = np.max(np.abs(first)) / (np.sqrt(np.mean(first**2)) + 1e-12)
    centre = float(np.sum(np.arange(len(y)) * y**2) / np.sum(y**2)) / RATE
    return {
        "att": math.log10(max(float(high - low), 0.5) / 1000),
        "tpeak": math.log10(max(int(np.argmax(envelope)), 1) / 1000),
        "burst": float(np.clip(burst, -40, 60)),
        "crest": 20 * math.log10(crest),
        "tcent": math.log10(max(centre, 1e-4)),
    }


def _power(x: Samples, n: int | None, rise: int) -> tuple[Samples, Samples]:
    """Frequencies [Hz] and power of a part that is faded out over its second half."""
    window = np.ones(len(x))
    if rise:
        window[:rise] = 0.5 - 0.5 * np.cos(np.pi * np.arange(rise) / rise)
    fade = len(x) // 2
    window[-fade:] = 0.5 + 0.5 * np.cos(np.pi * np.arange(fade) / fade)
    n = n or 1 << (len(x) - 1).bit_length()
    f = np.fft.rfftfreq(n, 1 / RATE)
    audible = (f > 25) & (f < 20_000)
    return f[audible], np.abs(np.fft.rfft(x * window, n)[audible]) ** 2


def spectra(y: Samples) -> Figures:
    """The spectrum of three stretches of time."""
    figures: Figures = {}
    for w, (begin, end) in _WINDOWS.items():
        part = y[int(begin * RATE) : int(end * RATE)]
        if np.sqrt(np.mean(part**2)) < 1e-4:  # 80 dB below the peak: it is over
            names = ("cent", "spread", "roll95", "roll99", "hi4", "hi8", "flat")
            figures |= {f"{w}_{name}": math.nan for name in names}
            if w != "c":
                figures |= {f"{w}_{f}": -80.0 for f in OCTAVES}
            continue
        f, power = _power(part, 8192 if w == "a" else None, RATE // 2 if w == "c" else 0)
        total = power.sum()
        figures[f"{w}_cent"] = math.log2(np.sum(f * power) / total)
        pitch = np.log2(f)
        middle = np.sum(pitch * power) / total
        figures[f"{w}_spread"] = float(np.sqrt(np.sum((pitch - middle) ** 2 * power) / total))
        below = np.cumsum(power) / total
        for share in (95, 99):
            figures[f"{w}_roll{share}"] = math.log2(f[np.searchsorted(below, share / 100)])

        def level(inside: NDArray[np.bool_], power: Samples = power) -> float:
            return max(-80.0, float(decibels(power[inside].sum() / power.sum())))

        for kilohertz in (4, 8):
            figures[f"{w}_hi{kilohertz}"] = level(f > kilohertz * 1000)
        inner = power[(f > 150) & (f < 12_000)]
        inner = inner + 1e-8 * inner.max()
        figures[f"{w}_flat"] = float(decibels(np.exp(np.mean(np.log(inner))) / inner.mean()))
        if w != "c":
            for centre in OCTAVES:
                band = (f > centre / 2**0.5) & (f <= centre * 2**0.5)
                figures[f"{w}_{centre}"] = level(band)
    return figures


def decays(y: Samples) -> Figures:
    """T60 of octaves, and how evenly the level falls."""
    hop = int(0.02 * RATE)

    def steps(power: Samples) -> Samples:
        return np.add.reduceat(power, np.arange(0, len(power) - hop, hop))

    loudest = steps(y**2).max() + 1e-20
    transform = np.fft.rfft(y)
    pitch = np.log2(np.maximum(np.fft.rfftfreq(len(y), 1 / RATE), 1.0))
    figures: Figures = {}
    for centre in OCTAVES[1:8]:
        gain = np.clip(1.5 - 2 * np.abs(pitch - math.log2(centre)), 0, 1)
        power = steps(np.fft.irfft(transform * gain, len(y)) ** 2)
        if power.max() / loudest < 1e-7:
            figures[f"t60_{centre}"] = math.nan
            continue
        level = decibels(power / power.max())
        level = level[int(np.argmax(level)) :]
        t = np.arange(len(level)) * 0.02
        end = max(int(np.argmax(level < -35)) if np.any(level < -35) else len(level), 4)
        figures[f"t60_{centre}"] = decay_time(slope(t[:end], level[:end]))
    level = decibels(smoothed(y**2, 882)[::441] + 1e-12)
    t = np.arange(len(level)) * 0.01
    first, then = (t > 0.02) & (t < 0.15), (t > 0.5) & (t < 1.5) & (level > -75)
    early = float(np.clip(slope(t[first], level[first]), -600, 100))
    late = math.nan
    if then.sum() > 20:
        late = float(np.clip(slope(t[then], level[then]), -150, 30))
    figures |= {"early": early, "late": late, "slopes": math.nan, "wobble": math.nan}
    if math.isfinite(late):
        figures["slopes"] = math.log2(max(-early, 1.0) / max(-late, 1.0))
    inside = (t > 0.1) & (t < 2) & (level > -70)
    if inside.sum() > 20:
        smooth = np.polyval(np.polyfit(t[inside], level[inside], 3), t[inside])
        figures["wobble"] = float(np.std(level[inside] - smooth))
    return figures
