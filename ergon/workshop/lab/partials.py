"""Pitch and decay of one partial in two sounds: cents and ratio of T60, by demodulation."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, log2, nan, pi

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ergon.workshop.lab.metrics import Floats

Complexes = NDArray[np.complex128]

_SMOOTHING = 0.05  # [s] of Hann window: partials 40 Hz apart do not mix
_RESOLUTION_HERTZ = 2.0 / _SMOOTHING  # [Hz] its main lobe, to one side
_HOP = 1e-3  # [s]
_DOWN = 1e-3  # weaker partials, relative to the strongest, are not followed
_STROKE_GROWTH = 1.12  # growth over one window that means another stroke: 1 dB
_RING_SECONDS_MIN = 0.05  # [s] of ringing that tell a pitch


@dataclass(frozen=True, slots=True)
class Partial:
    """y compared with x near `f` [Hz]: pitch [cents], T60 of y over that of x, and x's T60 [s]."""

    f: float
    cents: float
    t60_ratio: float
    t60: float


def compare(y: Floats, x: Floats, partial_frequency: float, rate: float) -> Partial | None:
    """Follow the partial near `partial_frequency` in both sounds, through the longest decay of x;
    None if there is none.

    Both are shifted to zero frequency and smoothed. With ρ their ratio, the slopes of arg ρ and
    ln|ρ|, weighted by |X|², are the difference of frequency (2πΔf) and of decay (-Δσ).
    """
    start_samples, Y, X = _baseband(y, x, partial_frequency, rate)
    ringing = _ringing(np.abs(X))
    if (
        ringing is None
        or not np.all(np.isfinite(Y[ringing]))
        or not np.all(np.abs(Y[ringing]) > 0.0)
    ):
        return None
    t, amplitude_ratio, amplitude_weight = (
        start_samples[ringing] / rate,
        Y[ringing] / X[ringing],
        np.abs(X[ringing]) ** 2,
    )
    frequency_difference = _slope(t, np.unwrap(np.angle(amplitude_ratio)), amplitude_weight) / (
        2.0 * pi
    )
    # The reference of the comparison is the true frequency of the partial, not the
    # `f` of the search.
    true_frequency = partial_frequency + _slope(
        t, np.unwrap(np.angle(X[ringing])), amplitude_weight
    ) / (2.0 * pi)
    decay = -_slope(t, np.log(np.abs(X[ringing])), amplitude_weight)
    measured_decay = decay - _slope(t, np.log(np.abs(amplitude_ratio)), amplitude_weight)
    t60_ratio = decay / measured_decay if decay > 0.0 and measured_decay > 0.0 else nan
    cents = (
        1200.0 * log2(1.0 + frequency_difference / true_frequency)
        if frequency_difference > -true_frequency
        else -inf
    )
    return Partial(
        true_frequency, cents, t60_ratio, 3.0 * log(10.0) / decay if decay > 0.0 else inf
    )


def strongest(x: Floats, rate: float, count: int = 5, window: Floats | None = None) -> list[float]:
    """Frequencies of the strongest partials [Hz], each the strongest within 40 Hz around it.

    Found on a window over all of x (a Hann window by default), between bins by a parabola through
    logarithms.
    """
    if not x.any():
        return []
    window_size = 4 * len(x)
    if window is None:
        window = np.hanning(len(x) + 1)[:-1]
    magnitude = np.abs(np.fft.rfft(x * window, window_size))
    reach = max(2, int(_RESOLUTION_HERTZ * window_size / rate))
    first_bin, end_bin = int(1.5 * reach), int(0.45 * window_size)
    # The rise towards a stronger peak's neighbour is not a peak.
    neighbourhoods = sliding_window_view(np.pad(magnitude, reach), 2 * reach + 1)
    peak_bins: list[int] = []
    for bin_index in np.argsort(magnitude[first_bin:end_bin])[::-1] + first_bin:
        if (
            len(peak_bins) == count
            or magnitude[bin_index] < _DOWN * magnitude[first_bin:end_bin].max()
        ):
            break
        if magnitude[bin_index] > 0.0 and magnitude[bin_index] == neighbourhoods[bin_index].max():
            peak_bins.append(int(bin_index))
    return [_between(magnitude, index) * rate / window_size for index in peak_bins]


def _between(magnitude: Floats, index: int) -> float:
    log_before, log_peak, log_after = np.log(np.maximum(magnitude[index - 1 : index + 2], 1e-300))
    curvature = log_before - 2.0 * log_peak + log_after
    return (
        index + 0.5 * float((log_before - log_after) / curvature)
        if curvature < 0.0 and isfinite(curvature)
        else float(index)
    )


def _baseband(y: Floats, x: Floats, f: float, rate: float) -> tuple[Floats, Complexes, Complexes]:
    """The middle frame of each window, and y and x there, shifted by -f and smoothed."""
    window_size = min(len(x), max(4, round(_SMOOTHING * rate)))
    hop = max(1, round(_HOP * rate))
    window = np.hanning(window_size + 2)[1:-1]
    shift = np.exp(-2j * pi * f / rate * np.arange(len(x)))

    def smooth(signal: Floats) -> Complexes:
        smoothed: Complexes = sliding_window_view(signal * shift, window_size)[::hop] @ (
            window / window.sum()
        )
        return smoothed

    y_smooth, x_smooth = smooth(y), smooth(x)
    return window_size / 2.0 + hop * np.arange(len(x_smooth), dtype=np.float64), y_smooth, x_smooth


def _ringing(amplitude_sizes: Floats) -> slice | None:
    """The section with most energy in which a partial only decays: from one stroke to the next."""
    window_hops = round(_SMOOTHING / _HOP)
    is_strong = amplitude_sizes > _DOWN * amplitude_sizes.max(initial=0.0)
    is_struck = np.zeros(len(amplitude_sizes), dtype=bool)
    for i in np.flatnonzero(
        amplitude_sizes[window_hops:] > _STROKE_GROWTH * amplitude_sizes[:-window_hops]
    ):
        is_struck[i : i + window_hops] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_strong & ~is_struck, [False]])))
    spans = [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    spans = [span for span in spans if (span.stop - span.start) * _HOP >= _RING_SECONDS_MIN]
    return max(spans, key=lambda span: float(np.sum(amplitude_sizes[span] ** 2)), default=None)


def _slope(t: Floats, values: Floats, weight: Floats) -> float:
    """The slope of the line fitted by weighted least squares."""
    total = np.sum(weight)
    t, values = (
        t - np.sum(weight * t) / total,
        values - np.sum(weight * values) / total,
    )
    return float(np.sum(weight * t * values) / np.sum(weight * t * t))
