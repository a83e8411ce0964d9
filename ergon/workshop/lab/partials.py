"""Pitch and decay of one partial in two sounds: cents and ratio of T60, by demodulation."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log, log2, nan, pi

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ergon.workshop.lab.metrics import Floats

Complexes = NDArray[np.complex128]

_WINDOW_DURATION = 0.05  # [s] of Hann window: partials 40 Hz apart do not mix
_RESOLUTION = 2.0 / _WINDOW_DURATION  # [Hz] its main lobe, to one side
_HOP_DURATION = 1e-3  # [s]
_AMPLITUDE_RATIO_MIN = 1e-3  # weaker partials, relative to the strongest, are not followed
_STROKE_GROWTH = 1.12  # growth over one window that means another stroke: 1 dB
_RING_DURATION_MIN = 0.05  # [s] of ringing that tell a pitch


@dataclass(frozen=True, slots=True)
class Partial:
    """y compared with x near `f` [Hz]: pitch [cents], T60 of y over that of x, and x's T60 [s]."""

    f: float
    cents: float
    t60_ratio: float
    t60: float


def compare(y: Floats, x: Floats, f: float, rate: float) -> Partial | None:
    """Follow the partial near `f` [Hz] in both sounds, through the longest decay of x;
    None if there is none.

    Both are shifted to zero frequency and smoothed. With ρ their ratio, the slopes of arg ρ and
    ln|ρ|, weighted by |X|², are the difference of frequency (2πΔf) and of decay (-Δσ).
    """
    frames, Y, X = _baseband(y, x, f, rate)
    ringing = _decaying_section(np.abs(X))
    if (
        ringing is None
        or not np.all(np.isfinite(Y[ringing]))
        or not np.all(np.abs(Y[ringing]) > 0.0)
    ):
        return None
    t, ratio, weight = (
        frames[ringing] / rate,
        Y[ringing] / X[ringing],
        np.abs(X[ringing]) ** 2,
    )
    f_difference = _slope(t, np.unwrap(np.angle(ratio)), weight) / (2.0 * pi)
    # The reference of the comparison is the true frequency of the partial, not the
    # `f` of the search.
    reference_frequency = f + _slope(t, np.unwrap(np.angle(X[ringing])), weight) / (2.0 * pi)
    decay = -_slope(t, np.log(np.abs(X[ringing])), weight)
    decay_of_y = decay - _slope(t, np.log(np.abs(ratio)), weight)
    t60_ratio = decay / decay_of_y if decay > 0.0 and decay_of_y > 0.0 else nan
    cents = (
        1200.0 * log2(1.0 + f_difference / reference_frequency)
        if f_difference > -reference_frequency
        else -inf
    )
    return Partial(
        reference_frequency, cents, t60_ratio, 3.0 * log(10.0) / decay if decay > 0.0 else inf
    )


def strongest_partials(
    x: Floats, rate: float, n_max: int = 5, window: Floats | None = None
) -> list[float]:
    """Frequencies of the strongest partials [Hz], each the strongest within 40 Hz around it.

    Found on a window over all of x (a Hann window by default), between bins by a parabola through
    logarithms.
    """
    if not x.any():
        return []
    fft_size = 4 * len(x)
    if window is None:
        window = np.hanning(len(x) + 1)[:-1]
    magnitude = np.abs(np.fft.rfft(x * window, fft_size))
    half_width = max(2, int(_RESOLUTION * fft_size / rate))
    first_bin, end_bin = int(1.5 * half_width), int(0.45 * fft_size)
    # The rise towards a stronger peak's neighbour is not a peak.
    neighbourhoods = sliding_window_view(np.pad(magnitude, half_width), 2 * half_width + 1)
    peak_bins: list[int] = []
    for peak in np.argsort(magnitude[first_bin:end_bin])[::-1] + first_bin:
        if (
            len(peak_bins) == n_max
            or magnitude[peak] < _AMPLITUDE_RATIO_MIN * magnitude[first_bin:end_bin].max()
        ):
            break
        if magnitude[peak] > 0.0 and magnitude[peak] == neighbourhoods[peak].max():
            peak_bins.append(int(peak))
    return [_interpolated_bin(magnitude, index) * rate / fft_size for index in peak_bins]


def _interpolated_bin(magnitude: Floats, index: int) -> float:
    log_before, log_peak, log_after = np.log(np.maximum(magnitude[index - 1 : index + 2], 1e-300))
    curvature = log_before - 2.0 * log_peak + log_after
    return (
        index + 0.5 * float((log_before - log_after) / curvature)
        if curvature < 0.0 and isfinite(curvature)
        else float(index)
    )


def _baseband(y: Floats, x: Floats, f: float, rate: float) -> tuple[Floats, Complexes, Complexes]:
    """The middle frame of each window, and y and x there, shifted by -f and smoothed."""
    window_size = min(len(x), max(4, round(_WINDOW_DURATION * rate)))
    hop = max(1, round(_HOP_DURATION * rate))
    window = np.hanning(window_size + 2)[1:-1]
    carrier = np.exp(-2j * pi * f / rate * np.arange(len(x)))

    def smooth(signal: Floats) -> Complexes:
        smoothed: Complexes = sliding_window_view(signal * carrier, window_size)[::hop] @ (
            window / window.sum()
        )
        return smoothed

    y_smooth, x_smooth = smooth(y), smooth(x)
    return window_size / 2.0 + hop * np.arange(len(x_smooth), dtype=np.float64), y_smooth, x_smooth


def _decaying_section(amplitudes: Floats) -> slice | None:
    """The section with most energy in which a partial only decays: from one stroke to the next."""
    hops_per_window = round(_WINDOW_DURATION / _HOP_DURATION)
    is_strong = amplitudes > _AMPLITUDE_RATIO_MIN * amplitudes.max(initial=0.0)
    is_struck = np.zeros(len(amplitudes), dtype=bool)
    for i in np.flatnonzero(
        amplitudes[hops_per_window:] > _STROKE_GROWTH * amplitudes[:-hops_per_window]
    ):
        is_struck[i : i + hops_per_window] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_strong & ~is_struck, [False]])))
    spans = [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    spans = [
        span for span in spans if (span.stop - span.start) * _HOP_DURATION >= _RING_DURATION_MIN
    ]
    return max(spans, key=lambda span: float(np.sum(amplitudes[span] ** 2)), default=None)


def _slope(t: Floats, values: Floats, weight: Floats) -> float:
    """The slope of the line fitted by weighted least squares."""
    total = np.sum(weight)
    t, values = (
        t - np.sum(weight * t) / total,
        values - np.sum(weight * values) / total,
    )
    return float(np.sum(weight * t * values) / np.sum(weight * t * t))
