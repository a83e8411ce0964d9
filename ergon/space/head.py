"""Filters of a head: what it does to sound from a direction on its way to two ears.

A pair of filters is an equalised impulse response of minimum phase for each ear, and a delay
each. The head that ships is a KEMAR manikin (B. Gardner and K. Martin, "HRTF Measurements of a
KEMAR Dummy-Head Microphone", MIT Media Lab Perceptual Computing Technical Report 280, 1994).
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from math import ceil, pi
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ergon import _core

from .directions import point, unit_vectors
from .panning import vbap

if TYPE_CHECKING:
    from numpy.typing import NDArray

TAPS = 128
KEMAR_PATH = Path(__file__).with_name("kemar.csv")
FULL_SCALE = 8192.0  # full scale of a coefficient in the shipped file
_RATE = 44_100.0  # [Hz] of the shipped file
_HALF_TAPS = 16  # samples on either side that make a resampled one
_SPECTRUM_POINTS = 4096  # points of a spectrum
_NEIGHBOURS_MAX = 4  # measured directions that are averaged for one in between
_UPSAMPLING = 16
_LONG_WAVES = (100.0, 400.0)  # [Hz]
_EQUALISED_BAND = (100.0, 16_000.0)  # [Hz] outside it the equaliser keeps its value at the border


@dataclass(frozen=True, slots=True)
class Head:
    """Pairs of filters of one head.

    `directions` (n, 3), `filters` (n, 2, n_taps) at `rate` [Hz], left ear first, `delays` (n, 2)
    [s]. A direction in between is panned between these directions.
    """

    rate: float
    directions: NDArray[np.float64]
    filters: NDArray[np.float64]
    delays: NDArray[np.float64]

    def pairs(self, array: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
        """Filters of loudspeakers in directions (n, 3) at a rate [Hz], (n, 2, n_taps).

        They have an extra delay of 16 samples of the slower rate, which interpolation between
        samples needs. Raises ArrayError.
        """
        resampled = self.resampled(rate)
        filter_pairs = np.zeros((len(array), *resampled.shape[1:]))
        gains = vbap(array, self.directions)
        for row, gain in zip(filter_pairs, gains, strict=True):
            for index in np.flatnonzero(gain > 1e-9):
                row += gain[index] * resampled[index]
        return filter_pairs

    def resampled(self, rate: float) -> NDArray[np.float64]:
        """The filters with their delays at another rate [Hz], (n, 2, n_taps).

        Band-limited interpolation with a raised cosine as window (J. O. Smith and P. Gossett,
        ICASSP 1984).
        """
        rate_ratio = self.rate / rate  # samples of the head per sample at `rate`
        band = min(1.0, 1.0 / rate_ratio)
        kernel_reach = _HALF_TAPS / band
        n_taps = self.filters.shape[2]
        delay_max = float(self.delays.max(initial=0.0)) * self.rate
        n = ceil((n_taps + delay_max + 2.0 * kernel_reach) / rate_ratio)
        resampled = np.zeros((*self.filters.shape[:2], n))
        for delay_index, delay in np.ndenumerate(self.delays):
            kernel = _kernel(n, n_taps, rate_ratio, kernel_reach + delay * self.rate, band)
            for tap, h in enumerate(self.filters[delay_index]):
                resampled[delay_index] += h * kernel[:, tap]
        return resampled * rate_ratio


def _kernel(
    n: int, n_taps: int, rate_ratio: float, delay: float, band: float
) -> NDArray[np.float64]:
    """The weight of each tap in each sample, (n, n_taps)."""
    kernel_reach = _HALF_TAPS / band
    kernel = np.zeros((n, n_taps))
    for sample_index in range(n):
        first_tap = max(0, ceil(sample_index * rate_ratio - delay - kernel_reach))
        for tap in range(first_tap, n_taps):
            tap_position = sample_index * rate_ratio - delay - tap
            if tap_position < -kernel_reach:
                break
            kernel[sample_index, tap] = _windowed_sinc(tap_position, band, kernel_reach)
    return kernel


def _windowed_sinc(position: float, band: float, reach: float) -> float:
    x = pi * band * position
    sinc = 1.0 if abs(x) < 1e-12 else _core.sin(x) / x
    return band * sinc * 0.5 * (1.0 + _core.cos(pi * position / reach))


@cache
def kemar() -> Head:
    """The head that ships: 24 pairs, for the directions of the dome 12 + 8 + 4."""
    directions, delays, filters = [], [], []
    with KEMAR_PATH.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(line for line in file if not line.startswith("#"))
        for azimuth, elevation, left, right, *taps in rows:
            directions.append(point(float(azimuth), float(elevation), 1.0))
            delays.append((float(left) * 1e-6, float(right) * 1e-6))
            filters.append(np.array([float(h) for h in taps]).reshape(2, -1) / FULL_SCALE)
    return Head(_RATE, unit_vectors(directions), np.array(filters), np.array(delays))


def prepared(
    directions: NDArray[np.float64],
    responses: NDArray[np.float64],
    rate: float,
    directions_wanted: NDArray[np.float64],
    extra_delays: NDArray[np.float64] | None = None,
) -> Head:
    """A head for `directions_wanted` directions (n, 3), from responses (n_measured, 2, n_samples)
    at `rate` [Hz]. `extra_delays` (n_measured, 2): added to the delays of the responses [s].

    Responses are equalised so that sound from all directions together (the diffuse field) has a
    flat spectrum, and are made minimum-phase. The delay of a response is the one at which its
    minimum-phase version matches the measured response best (J. Nam et al., AES preprint 7612,
    2008). Between measured directions, magnitudes (in dB) and delays are means weighted by the
    inverse squares of angular distances (D. Shepard, 1968).
    """
    transform_size = max(_SPECTRUM_POINTS, 1 << (responses.shape[2] - 1).bit_length())
    magnitude = np.abs(np.fft.rfft(responses, transform_size))
    relative_level = np.maximum(magnitude, magnitude.max() * 1e-5) / _diffuse_field_level(
        directions, magnitude, rate
    )
    relative_level = relative_level ** _retained_shares(transform_size, rate)
    delays = np.array([[_delay(h, rate) for h in pair] for pair in responses])
    delays += 0.0 if extra_delays is None else extra_delays
    filters, delays_wanted = [], []
    for direction in directions_wanted:
        weights = _weights(directions, direction)
        near_directions = np.flatnonzero(weights)
        level_shape = np.exp(
            np.tensordot(weights[near_directions], np.log(relative_level[near_directions]), 1)
        )
        filters.append(
            [_minimum_phase(response, transform_size)[:TAPS] * _fade() for response in level_shape]
        )
        delays_wanted.append(np.tensordot(weights[near_directions], delays[near_directions], 1))
    mean_delays = np.array(delays_wanted)
    return Head(rate, directions_wanted, np.array(filters), mean_delays - mean_delays.min())


def _diffuse_field_level(
    directions: NDArray[np.float64], magnitude: NDArray[np.float64], rate: float
) -> NDArray[np.float64]:
    """Root of the mean power over all directions and both ears, by frequency, smoothed."""
    # A direction is weighted by the area around it: the squared mean angle to its five neighbours.
    neighbour_indices = np.argsort(directions @ directions.T, 1)[:, -6:-1]
    near_cosines = np.take_along_axis(directions @ directions.T, neighbour_indices, 1)
    area = np.arccos(np.clip(near_cosines, -1.0, 1.0)).mean(1) ** 2
    power = np.tensordot(area / area.sum(), magnitude**2, 1).mean(0)
    frequency = np.fft.rfftfreq(2 * (len(power) - 1), 1.0 / rate)
    low, high = np.searchsorted(frequency, _EQUALISED_BAND)
    high = min(int(high), len(power) - 1)
    power[:low], power[high:] = power[low], power[high]
    return np.sqrt(_smooth(power))


def _retained_shares(transform_size: int, rate: float) -> NDArray[np.float64]:
    """The share of a level in dB that is kept, by frequency: a head does not affect long waves, and
    what is measured there is the loudspeaker and the room.
    """
    frequency = np.fft.rfftfreq(transform_size, 1.0 / rate)
    return np.clip((frequency - _LONG_WAVES[0]) / (_LONG_WAVES[1] - _LONG_WAVES[0]), 0.0, 1.0)


def _smooth(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over a third of an octave."""
    power_sums = np.concatenate([[0.0], np.cumsum(power)])
    indices = np.arange(len(power))
    low = np.floor(indices / 2 ** (1 / 6)).astype(np.intp)
    high = np.minimum(np.ceil(indices * 2 ** (1 / 6)).astype(np.intp) + 1, len(power))
    mean: NDArray[np.float64] = (power_sums[high] - power_sums[low]) / (high - low)
    return mean


def _weights(
    directions: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    angles = np.arccos(np.clip(directions @ direction, -1.0, 1.0))
    direction_weights = np.zeros(len(directions))
    nearest_indices = np.argsort(angles)[:_NEIGHBOURS_MAX]
    if angles[nearest_indices[0]] < np.radians(0.5):
        direction_weights[nearest_indices[0]] = 1.0
    else:
        direction_weights[nearest_indices] = 1.0 / angles[nearest_indices] ** 2
    direction_weights /= direction_weights.sum()
    return direction_weights


def _minimum_phase(magnitude: NDArray[np.float64], transform_size: int) -> NDArray[np.float64]:
    """The minimum-phase response with a given magnitude (A. Oppenheim, R. Schafer, 1975)."""
    cepstrum = np.fft.irfft(np.log(magnitude), transform_size)
    folding_window = np.zeros(transform_size)
    (
        folding_window[0],
        folding_window[transform_size // 2],
        folding_window[1 : transform_size // 2],
    ) = 1.0, 1.0, 2.0
    return np.fft.irfft(np.exp(np.fft.rfft(cepstrum * folding_window)), transform_size)


def _delay(response: NDArray[np.float64], rate: float) -> float:
    """The delay of a response against its own minimum-phase version [s]."""
    transform_size = 1 << (2 * len(response) - 1).bit_length()
    spectrum = np.fft.rfft(response, transform_size)
    magnitude_min = max(float(np.abs(spectrum).max()) * 1e-5, 1e-30)
    minimum_phase_spectrum = np.fft.rfft(
        _minimum_phase(np.maximum(np.abs(spectrum), magnitude_min), transform_size), transform_size
    )
    match = np.fft.irfft(spectrum * np.conj(minimum_phase_spectrum), transform_size * _UPSAMPLING)
    return float(np.argmax(match[: len(match) // 2])) / (rate * _UPSAMPLING)


def _fade() -> NDArray[np.float64]:
    fade = np.ones(TAPS)
    fade[-24:] = np.cos(np.linspace(0.0, pi / 2, 24)) ** 2
    return fade
