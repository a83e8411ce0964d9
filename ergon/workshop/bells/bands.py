"""Bands of a sound, each as a complex signal at a rate of its own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, log

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SMOOTH = 5  # bins over which valleys between peaks are sought
_EDGE_SHARE_MIN, _EDGE_SHARE_MAX = 0.6, 1.4  # of a band's width: where its edge may lie
_PEAK_POWER_RATIO_MIN = 3.98  # of the noise's power (6 dB): a band with less has no peak
_QUIET = 20.0  # percentile of the powers that counts as noise
_PERCENTILE_OVER_MEAN = (
    0.223  # that percentile over the mean, of powers that are distributed exponentially
)


class Bands:
    """The spectrum of a sound, from which bands are extracted."""

    def __init__(self, sound: Array, rate: float) -> None:
        """Take a sound (n,) at `rate` [Hz]."""
        self.rate = rate
        self.n = sound.size
        self.spectrum = np.fft.rfft(sound)

    def take(self, low: float, high: float) -> tuple[Complex, float, float]:
        """A band as a signal shifted to 0; its rate [Hz], and the frequency [Hz] that was shifted
        to 0.

        The window of the band falls to zero within half of its width on both sides.
        """
        width = high - low
        bin_count = ceil(2.0 * width * self.n / self.rate)
        band_rate = bin_count * self.rate / self.n
        centre = round(0.5 * (low + high) * self.n / self.rate)
        bin_offsets = np.arange(-(bin_count // 2), bin_count - bin_count // 2)
        distances = np.abs(bin_offsets * self.rate / self.n)
        window_positions = np.clip(
            (0.5 * band_rate - distances) / (0.5 * (band_rate - width)), 0.0, 1.0
        )
        weights = np.sin(0.5 * np.pi * window_positions) ** 2
        spectrum_bins = centre + bin_offsets
        is_in_spectrum = (spectrum_bins > 0) & (spectrum_bins < self.spectrum.size)
        spectrum_at_zero = np.zeros(bin_count, complex)
        spectrum_at_zero[bin_offsets[is_in_spectrum] % bin_count] = (
            self.spectrum[spectrum_bins[is_in_spectrum]] * weights[is_in_spectrum]
        )
        return (
            np.fft.ifft(spectrum_at_zero) * (2.0 * bin_count / self.n),
            band_rate,
            centre * self.rate / self.n,
        )

    def occupied(self, low: float, high: float, width: float) -> Iterator[tuple[float, float]]:
        """Bands about `width` wide [Hz] with a peak above the noise; they are cut where the
        spectrum is low.
        """
        power_spectrum = np.abs(self.spectrum) ** 2
        bin_width = self.rate / self.n
        smoothed_power = np.convolve(power_spectrum, np.full(_SMOOTH, 1.0 / _SMOOTH), "same")
        edges_hertz = [low]
        while edges_hertz[-1] < high - 1.5 * width:
            search_begin, search_end = (
                int((edges_hertz[-1] + part * width) / bin_width)
                for part in (_EDGE_SHARE_MIN, _EDGE_SHARE_MAX)
            )
            edges_hertz.append(
                (search_begin + int(np.argmin(smoothed_power[search_begin:search_end]))) * bin_width
            )
        edges_hertz.append(high)
        for low_edge, high_edge in pairwise(edges_hertz):
            power_in_band = power_spectrum[int(low_edge / bin_width) : int(high_edge / bin_width)]
            power_around = power_spectrum[
                max(1, int(0.7 * low_edge / bin_width)) : int(1.4 * high_edge / bin_width)
            ]
            noise = float(np.percentile(power_around, _QUIET)) / _PERCENTILE_OVER_MEAN
            if power_in_band.size and power_in_band.max() > _PEAK_POWER_RATIO_MIN * noise * (
                1.0 + log(power_in_band.size)
            ):
                yield low_edge, high_edge
