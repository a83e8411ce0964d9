"""What a rendered sound is like, in a few figures: brightness, pitch, decay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_SIZE = 8192  # frames of one spectrum: 0.2 s, 5 Hz apart at 44.1 kHz
_LOWEST, _HIGHEST = 20.0, 5000.0  # of a pitch [Hz]
_PITCH_SPAN = 0.2  # [s] that a pitch is found in
_APERIODIC = 0.2  # more of the power than this does not repeat: no pitch
_LEVEL_SPAN = 0.02  # [s] of one level
_LAST_BLOW = 100.0  # a blow counts up to 20 dB below the highest level
_DECAY = (-5.0, -25.0)  # [dB] between which a decay is measured (T20 of ISO 3382-1)


@dataclass(frozen=True, slots=True)
class Measures:
    """Figures of a sound; None is a figure that the sound does not have.

    `centroid` [Hz] is the mean frequency, weighted by power. `pitch` [Hz] is that of the loudest
    0.2 s, if these are periodic; `partial` [Hz] is the strongest partial of the whole sound.
    `t60` [s] is the decay after the last loud blow.
    """

    centroid: float | None
    pitch: float | None
    partial: float | None
    t60: float | None


def measures(frames: NDArray[np.float64], rate: float) -> Measures:
    """The figures of frames (n_frames, n_channels) at `rate` [Hz].

    Powers of channels are added up; pitch and partial are those of the loudest channel.
    """
    import numpy as np

    if not len(frames) or not frames.any():
        return Measures(None, None, None, None)
    power = (frames * frames).sum(axis=1)
    loudest = frames[:, int((frames * frames).sum(axis=0).argmax())]
    f, spectrum = _spectrum(frames, rate)
    audible = f >= _LOWEST
    total = float(spectrum[audible].sum())
    centroid = float((f * spectrum)[audible].sum() / total) if total > 0.0 else None
    return Measures(
        centroid,
        _pitch(loudest, power, rate),
        _partial(loudest, rate),
        _t60(np.asarray(power), rate),
    )


def _spectrum(
    frames: NDArray[np.float64], rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies, and power summed over Hann windows that overlap by half (Welch 1967)."""
    import numpy as np

    window = np.hanning(_SIZE + 1)[:-1, None]
    power: NDArray[np.float64] = np.zeros(_SIZE // 2 + 1)
    for first_frame in range(0, max(1, len(frames) - _SIZE // 2), _SIZE // 2):
        block = frames[first_frame : first_frame + _SIZE]
        padded = np.zeros((_SIZE, frames.shape[1]))
        padded[: len(block)] = block
        power += (np.abs(np.fft.rfft(window * padded, axis=0)) ** 2).sum(axis=1)
    f = np.arange(len(power), dtype=np.float64) * (rate / _SIZE)
    return f, power


def _pitch(x: NDArray[np.float64], power: NDArray[np.float64], rate: float) -> float | None:
    """The pitch by the normalised difference function of YIN (de Cheveigné & Kawahara 2002)."""
    import numpy as np

    span, longest = int(_PITCH_SPAN * rate), int(rate / _LOWEST) + 2
    if len(x) < span + longest:
        return None
    sums = np.concatenate([[0.0], np.cumsum(power)])
    start = int(np.argmax(sums[span : len(x) - longest + 1] - sums[: len(x) - longest - span + 1]))
    segment = x[start : start + span + longest]
    size = 1 << (2 * len(segment)).bit_length()
    transform = np.fft.rfft(segment[:span], size)
    match = np.fft.irfft(np.conj(transform) * np.fft.rfft(segment, size), size)[:longest]
    squares = np.concatenate([[0.0], np.cumsum(segment * segment)])
    energy = squares[span : span + longest] - squares[:longest]
    difference = np.maximum(energy[0] + energy - 2.0 * match, 0.0)
    total = np.cumsum(difference[1:])
    normal = np.ones(longest)
    np.divide(difference[1:] * np.arange(1, longest), total, out=normal[1:], where=total > 0.0)
    first_lag = max(2, int(rate / _HIGHEST))
    periodic_lags = np.flatnonzero(normal[first_lag:-1] < _APERIODIC)
    if not len(periodic_lags):
        return None
    lag = first_lag + int(periodic_lags[0])
    while lag + 1 < longest - 1 and normal[lag + 1] < normal[lag]:
        lag += 1
    return rate / _parabola_peak(-difference[lag - 1 : lag + 2], lag)


def _partial(x: NDArray[np.float64], rate: float) -> float | None:
    """The highest peak of one Hann window over the whole sound, interpolated by a parabola."""
    import numpy as np

    size = 2 * len(x)
    magnitude = np.abs(np.fft.rfft(x * np.hanning(len(x) + 1)[:-1], size))
    low = max(1, math.ceil(_LOWEST * size / rate))
    if len(magnitude) < low + 2 or not magnitude[low:-1].any():
        return None
    peak_bin = low + int(magnitude[low:-1].argmax())
    return (
        _parabola_peak(np.log(np.maximum(magnitude[peak_bin - 1 : peak_bin + 2], 1e-300)), peak_bin)
        * rate
        / size
    )


def _parabola_peak(three: NDArray[np.float64], peak_bin: int) -> float:
    """Position of the maximum of the parabola through three values; the middle one is at "
    "`peak_bin`."""
    a, b, c = (float(y) for y in three)
    curve = a - 2.0 * b + c
    return peak_bin + 0.5 * (a - c) / curve if curve < 0.0 else float(peak_bin)


def _t60(power: NDArray[np.float64], rate: float) -> float | None:
    """T60 by backward integration of the energy (Schroeder 1965), after the last loud blow."""
    import numpy as np

    span = max(1, int(_LEVEL_SPAN * rate))
    levels = power[: len(power) // span * span].reshape(-1, span).sum(axis=1)
    if len(levels) < 3:
        return None
    # A blow is a rise by 3 dB to a level that is loud.
    rises = levels[1:] > np.maximum(2.0 * levels[:-1], levels.max() / _LAST_BLOW)
    blow = 1 + int(np.flatnonzero(rises)[-1]) if rises.any() else int(levels.argmax())
    levels = levels[blow + int(levels[blow : blow + 5].argmax()) :]
    energy_left = np.cumsum(levels[::-1])[::-1]
    if energy_left[0] <= 0.0:
        return None
    fall = 10.0 * np.log10(np.maximum(energy_left / energy_left[0], 1e-30))
    fitted_frames = np.flatnonzero((fall <= _DECAY[0]) & (fall >= _DECAY[1]))
    # The sum misses what the file cuts off, so the end of the file has to lie well below the range.
    if (
        len(fitted_frames) < 2
        or 10.0 * math.log10(max(levels[-1] / levels.max(), 1e-30)) > _DECAY[1] - 10.0
    ):
        return None
    slope = float(np.polyfit(fitted_frames * span / rate, fall[fitted_frames], 1)[0])
    return -60.0 / slope if slope < 0.0 else None
