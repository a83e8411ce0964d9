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
        band_width = high - low
        n_bins = ceil(2.0 * band_width * self.n / self.rate)
        rate = n_bins * self.rate / self.n
        centre = round(0.5 * (low + high) * self.n / self.rate)
        bin_offsets = np.arange(-(n_bins // 2), n_bins - n_bins // 2)
        distances = np.abs(bin_offsets * self.rate / self.n)
        slopes = np.clip((0.5 * rate - distances) / (0.5 * (rate - band_width)), 0.0, 1.0)
        weights = np.sin(0.5 * np.pi * slopes) ** 2
        source_bins = centre + bin_offsets
        is_there = (source_bins > 0) & (source_bins < self.spectrum.size)
        bins = np.zeros(n_bins, complex)
        bins[bin_offsets[is_there] % n_bins] = (
            self.spectrum[source_bins[is_there]] * weights[is_there]
        )
        return np.fft.ifft(bins) * (2.0 * n_bins / self.n), rate, centre * self.rate / self.n

    def occupied(
        self, low_hertz: float, high_hertz: float, band_width: float
    ) -> Iterator[tuple[float, float]]:
        """Bands about `band_width` wide [Hz] with a peak above the noise; they are cut where the
        spectrum is low.
        """
        power_spectrum = np.abs(self.spectrum) ** 2
        bin_width = self.rate / self.n
        smooth = np.convolve(power_spectrum, np.full(_SMOOTH, 1.0 / _SMOOTH), "same")
        edges = [low_hertz]
        while edges[-1] < high_hertz - 1.5 * band_width:
            band_begin, band_end = (
                int((edges[-1] + part * band_width) / bin_width)
                for part in (_EDGE_SHARE_MIN, _EDGE_SHARE_MAX)
            )
            edges.append((band_begin + int(np.argmin(smooth[band_begin:band_end]))) * bin_width)
        edges.append(high_hertz)
        for low_edge, high_edge in pairwise(edges):
            power_in_band = power_spectrum[int(low_edge / bin_width) : int(high_edge / bin_width)]
            power_around = power_spectrum[
                max(1, int(0.7 * low_edge / bin_width)) : int(1.4 * high_edge / bin_width)
            ]
            noise = float(np.percentile(power_around, _QUIET)) / _PERCENTILE_OVER_MEAN
            if power_in_band.size and power_in_band.max() > _PEAK_POWER_RATIO_MIN * noise * (
                1.0 + log(power_in_band.size)
            ):
                yield low_edge, high_edge
