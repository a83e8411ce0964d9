"""Bands of a sound, each as a complex signal at a rate of its own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, log

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SMOOTHING_BINS = 5  # bins over which valleys between peaks are sought
_EDGE_SHARE_MIN, _EDGE_SHARE_MAX = 0.6, 1.4  # of a band's width: where its edge may lie
_PEAK_POWER_RATIO_MIN = 3.98  # of the noise's power (6 dB): a band with less has no peak
_NOISE_PERCENTILE = 20.0  # percentile of the powers that counts as noise
_PERCENTILE_OVER_MEAN = (
    0.223  # that percentile over the mean, of powers that are distributed exponentially
)


class Bands:
    """The spectrum of a sound, from which bands are extracted."""

    def __init__(self, sound: Array, rate: float) -> None:
        """Take a sound (n,) at `rate` [Hz]."""
        self.rate = rate
        self.n_samples = sound.size
        self.spectrum = np.fft.rfft(sound)

    def extract(self, low: float, high: float) -> tuple[Complex, float, float]:
        """A band as a signal shifted to 0; its rate [Hz], and the frequency [Hz] that was shifted
        to 0.

        The window of the band falls to zero within half of its width on both sides.
        """
        width = high - low
        n_bins = ceil(2.0 * width * self.n_samples / self.rate)
        band_rate = n_bins * self.rate / self.n_samples
        centre = round(0.5 * (low + high) * self.n_samples / self.rate)
        bin_offsets = np.arange(-(n_bins // 2), n_bins - n_bins // 2)
        offsets_hz = np.abs(bin_offsets * self.rate / self.n_samples)
        window_phases = np.clip(
            (0.5 * band_rate - offsets_hz) / (0.5 * (band_rate - width)), 0.0, 1.0
        )
        window = np.sin(0.5 * np.pi * window_phases) ** 2
        bins = centre + bin_offsets
        is_in_spectrum = (bins > 0) & (bins < self.spectrum.size)
        shifted_spectrum = np.zeros(n_bins, complex)
        shifted_spectrum[bin_offsets[is_in_spectrum] % n_bins] = (
            self.spectrum[bins[is_in_spectrum]] * window[is_in_spectrum]
        )
        return (
            np.fft.ifft(shifted_spectrum) * (2.0 * n_bins / self.n_samples),
            band_rate,
            centre * self.rate / self.n_samples,
        )

    def occupied_bands(
        self, low: float, high: float, width: float
    ) -> Iterator[tuple[float, float]]:
        """Bands about `width` wide [Hz] with a peak above the noise; they are cut where the
        spectrum is low.
        """
        power = np.abs(self.spectrum) ** 2
        bin_width = self.rate / self.n_samples
        smoothed = np.convolve(power, np.full(_SMOOTHING_BINS, 1.0 / _SMOOTHING_BINS), "same")
        edges = [low]
        while edges[-1] < high - 1.5 * width:
            first_bin, end_bin = (
                int((edges[-1] + width_ratio * width) / bin_width)
                for width_ratio in (_EDGE_SHARE_MIN, _EDGE_SHARE_MAX)
            )
            edges.append((first_bin + int(np.argmin(smoothed[first_bin:end_bin]))) * bin_width)
        edges.append(high)
        for low_edge, high_edge in pairwise(edges):
            band_power = power[int(low_edge / bin_width) : int(high_edge / bin_width)]
            nearby_power = power[
                max(1, int(0.7 * low_edge / bin_width)) : int(1.4 * high_edge / bin_width)
            ]
            noise = float(np.percentile(nearby_power, _NOISE_PERCENTILE)) / _PERCENTILE_OVER_MEAN
            if band_power.size and band_power.max() > _PEAK_POWER_RATIO_MIN * noise * (
                1.0 + log(band_power.size)
            ):
                yield low_edge, high_edge
