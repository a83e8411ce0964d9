"""How loud the noise between the partials of a note is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_AUDIBLE = 50.0, 16_000.0  # Hz
_NEAR = 0.03  # of the pitch that is written, within which the pitch that sounds is looked for
_AROUND, _MARGIN = 60.0, 15.0  # Hz; dB that a partial stands above the middle of what is around it
_BETWEEN = 0.25  # of the pitch: farther from every harmonic than this, it is noise


def noise_level(x: NDArray[np.float64], rate: float, f: float) -> float:
    """Power of the noise over that of all the rest of a steady note of pitch `f` [Hz], in dB.

    The noise is what lies between the harmonics, taken as evenly strong below them. What is
    below 50 Hz or above 16 kHz does not count.
    """
    power = np.abs(np.fft.rfft((x - x.mean()) * np.blackman(len(x)))) ** 2
    frequencies = np.fft.rfftfreq(len(x), 1.0 / rate)
    near = np.abs(frequencies / f - 1.0) < _NEAR
    pitch = frequencies[np.argmax(np.where(near, power, 0.0))]
    orders = frequencies / pitch
    audible = (frequencies > _AUDIBLE[0]) & (frequencies < _AUDIBLE[1])
    between = audible & (np.abs(orders - np.round(orders)) > _BETWEEN)
    noise = 0.0
    for order in range(int(_AUDIBLE[1] / pitch) + 1):  # each band around a harmonic by its own gaps
        band = audible & (np.round(orders) == order)
        gaps = between & band
        if gaps.any():
            noise += float(power[gaps].mean() * band.sum())
    return float(10.0 * np.log10(noise / max(float(power[audible].sum()) - noise, 1e-300)))


def stands_out(frequencies: NDArray[np.float64], magnitude: NDArray[np.float64], f: float) -> bool:
    """Whether a peak at `f` [Hz] of a spectrum is a partial, not the noise that is around it."""
    floor = np.median(magnitude[np.abs(frequencies - f) < _AROUND])
    top = magnitude[np.abs(frequencies - f) <= 2.0 * frequencies[1]].max()
    return bool(top > floor * 10.0 ** (_MARGIN / 20.0))
