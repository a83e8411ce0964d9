"""What a rendered sound is like, in a few figures: brightness, pitch, decay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_WINDOW_SAMPLES = 8192  # frames of one spectrum: 0.2 s, 5 Hz apart at 44.1 kHz
_PITCH_HZ_MIN, _PITCH_HZ_MAX = 20.0, 5000.0  # range of a pitch [Hz]
_PITCH_SECONDS = 0.2  # [s] that a pitch is found in
_APERIODICITY_MAX = 0.2  # more of the power than this does not repeat: no pitch
_LEVEL_SECONDS = 0.02  # [s] of one level
_LAST_BLOW_RATIO = 100.0  # a blow counts up to 20 dB below the highest level
_DECAY_RANGE_DB = (-5.0, -25.0)  # [dB] between which a decay is measured (T20 of ISO 3382-1)


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


def measure_sound(sound_frames: NDArray[np.float64], rate: float) -> Measures:
    """The figures of frames (n_frames, n_channels) at `rate` [Hz].

    Powers of channels are added up; pitch and partial are those of the loudest channel.
    """
    import numpy as np

    if not len(sound_frames) or not sound_frames.any():
        return Measures(None, None, None, None)
    powers = (sound_frames * sound_frames).sum(axis=1)
    loudest_channel = sound_frames[:, int((sound_frames * sound_frames).sum(axis=0).argmax())]
    frequencies, spectrum = _spectrum(sound_frames, rate)
    is_audible = frequencies >= _PITCH_HZ_MIN
    total = float(spectrum[is_audible].sum())
    centroid = float((frequencies * spectrum)[is_audible].sum() / total) if total > 0.0 else None
    return Measures(
        centroid,
        _pitch(loudest_channel, powers, rate),
        _strongest_partial(loudest_channel, rate),
        _decay_time(np.asarray(powers), rate),
    )


def _spectrum(
    sound_frames: NDArray[np.float64], rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies, and power summed over Hann windows that overlap by half (Welch 1967)."""
    import numpy as np

    window = np.hanning(_WINDOW_SAMPLES + 1)[:-1, None]
    spectrum: NDArray[np.float64] = np.zeros(_WINDOW_SAMPLES // 2 + 1)
    for first_frame in range(
        0, max(1, len(sound_frames) - _WINDOW_SAMPLES // 2), _WINDOW_SAMPLES // 2
    ):
        block = sound_frames[first_frame : first_frame + _WINDOW_SAMPLES]
        padded = np.zeros((_WINDOW_SAMPLES, sound_frames.shape[1]))
        padded[: len(block)] = block
        spectrum += (np.abs(np.fft.rfft(window * padded, axis=0)) ** 2).sum(axis=1)
    frequencies = np.arange(len(spectrum), dtype=np.float64) * (rate / _WINDOW_SAMPLES)
    return frequencies, spectrum


def _pitch(samples: NDArray[np.float64], power: NDArray[np.float64], rate: float) -> float | None:
    """The pitch by the normalised difference function of YIN (de Cheveigné & Kawahara 2002)."""
    import numpy as np

    window_frames, longest_lag = int(_PITCH_SECONDS * rate), int(rate / _PITCH_HZ_MIN) + 2
    if len(samples) < window_frames + longest_lag:
        return None
    sums = np.concatenate([[0.0], np.cumsum(power)])
    segment_start = int(
        np.argmax(
            sums[window_frames : len(samples) - longest_lag + 1]
            - sums[: len(samples) - longest_lag - window_frames + 1]
        )
    )
    segment = samples[segment_start : segment_start + window_frames + longest_lag]
    size = 1 << (2 * len(segment)).bit_length()
    transform = np.fft.rfft(segment[:window_frames], size)
    correlation = np.fft.irfft(np.conj(transform) * np.fft.rfft(segment, size), size)[:longest_lag]
    energy_sums = np.concatenate([[0.0], np.cumsum(segment * segment)])
    energy = energy_sums[window_frames : window_frames + longest_lag] - energy_sums[:longest_lag]
    difference = np.maximum(energy[0] + energy - 2.0 * correlation, 0.0)
    total = np.cumsum(difference[1:])
    normalised = np.ones(longest_lag)
    np.divide(
        difference[1:] * np.arange(1, longest_lag), total, out=normalised[1:], where=total > 0.0
    )
    first_lag = max(2, int(rate / _PITCH_HZ_MAX))
    periodic_lags = np.flatnonzero(normalised[first_lag:-1] < _APERIODICITY_MAX)
    if not len(periodic_lags):
        return None
    lag = first_lag + int(periodic_lags[0])
    while lag + 1 < longest_lag - 1 and normalised[lag + 1] < normalised[lag]:
        lag += 1
    return rate / _parabola_peak(-difference[lag - 1 : lag + 2], lag)


def _strongest_partial(samples: NDArray[np.float64], rate: float) -> float | None:
    """The highest peak of one Hann window over the whole sound, interpolated by a parabola."""
    import numpy as np

    transform_size = 2 * len(samples)
    magnitude = np.abs(np.fft.rfft(samples * np.hanning(len(samples) + 1)[:-1], transform_size))
    lowest_bin = max(1, math.ceil(_PITCH_HZ_MIN * transform_size / rate))
    if len(magnitude) < lowest_bin + 2 or not magnitude[lowest_bin:-1].any():
        return None
    peak_bin = lowest_bin + int(magnitude[lowest_bin:-1].argmax())
    return (
        _parabola_peak(np.log(np.maximum(magnitude[peak_bin - 1 : peak_bin + 2], 1e-300)), peak_bin)
        * rate
        / transform_size
    )


def _parabola_peak(three_values: NDArray[np.float64], peak_bin: int) -> float:
    """Position of the maximum of the parabola through three values, of which the middle one is at
    `peak_bin`.
    """
    a, b, c = (float(y) for y in three_values)
    curvature = a - 2.0 * b + c
    return peak_bin + 0.5 * (a - c) / curvature if curvature < 0.0 else float(peak_bin)


def _decay_time(power: NDArray[np.float64], rate: float) -> float | None:
    """T60 by backward integration of the energy (Schroeder 1965), after the last loud blow."""
    import numpy as np

    window_frames = max(1, int(_LEVEL_SECONDS * rate))
    window_energies = (
        power[: len(power) // window_frames * window_frames].reshape(-1, window_frames).sum(axis=1)
    )
    if len(window_energies) < 3:
        return None
    # A blow is a rise by 3 dB to a level that is loud.
    is_rising = window_energies[1:] > np.maximum(
        2.0 * window_energies[:-1], window_energies.max() / _LAST_BLOW_RATIO
    )
    blow_index = (
        1 + int(np.flatnonzero(is_rising)[-1]) if is_rising.any() else int(window_energies.argmax())
    )
    window_energies = window_energies[
        blow_index + int(window_energies[blow_index : blow_index + 5].argmax()) :
    ]
    energy_left = np.cumsum(window_energies[::-1])[::-1]
    if energy_left[0] <= 0.0:
        return None
    decay_db = 10.0 * np.log10(np.maximum(energy_left / energy_left[0], 1e-30))
    fitted_windows = np.flatnonzero(
        (decay_db <= _DECAY_RANGE_DB[0]) & (decay_db >= _DECAY_RANGE_DB[1])
    )
    # The sum misses what the file cuts off, so the level at the end has to be well below the range.
    if (
        len(fitted_windows) < 2
        or 10.0 * math.log10(max(window_energies[-1] / window_energies.max(), 1e-30))
        > _DECAY_RANGE_DB[1] - 10.0
    ):
        return None
    slope = float(np.polyfit(fitted_windows * window_frames / rate, decay_db[fitted_windows], 1)[0])
    return -60.0 / slope if slope < 0.0 else None
