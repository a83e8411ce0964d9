"""Figures of a movement: how far, how fast, at which frequencies, where it turns, how smooth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ergon._core import Take
from ergon.scores.gesture.take_file import Floats

CUTOFF_HZ = 20.0  # Hz: hands move below; differentiated sensor noise is above
RATE_OVER_CUTOFF = 50.0  # times the cutoff: samples a second at which derivatives are taken
_CUTOFF_RATIO_MAX = 0.45  # largest cutoff over the sample rate
_REVERSAL_SHARE_MIN = 0.05  # smallest reversal over the range
_STRIKE_RMS_RATIO = 3.0  # times the rms of the acceleration
_FILTER_MEMORY_PERIODS = 4.0  # periods of the cutoff, after which the filter has forgotten
_EDGE_SAMPLES = 4  # samples beyond each end: two for each of two derivatives
_REVERSAL_SECONDS = 0.01  # s before and after a reversal: its acceleration is the peak there
_ARC_LENGTH_CUTOFF_HZ = 20.0  # Hz: 40π rad/s (Balasubramanian & others, 2012)
_ARC_LENGTH_PADDING = 64  # times the length of a movement
_STROKE_SECONDS_MIN, _STROKE_SECONDS_MAX = 0.02, 10.0  # s: strokes whose smoothness is computed


@dataclass(frozen=True, slots=True)
class MovementStats:
    """Figures of one movement, in SI units.

    `low`, `high` and `rms` (about the mean) [m] are those of the positions, `path` [m] is the
    total distance. Speed [m/s] and acceleration [m/s²] are those below `cutoff` [Hz]. `centre`
    and `bandwidth` [Hz] are mean and standard deviation of frequency by the power of the
    velocity. `reversals` (n_reversals,) [s] are the instants at which it reverses by a twentieth
    of its range, `strikes` (n_strikes,) [s] those of them with three times the rms acceleration.
    `smoothness` is the median spectral arc length of the strokes between reversals (below 0,
    nearer to 0 is smoother); None without a stroke.
    """

    duration: float
    low: float
    high: float
    rms: float
    path: float
    speed_peak: float
    speed_rms: float
    acceleration_peak: float
    acceleration_rms: float
    cutoff: float
    centre: float
    bandwidth: float
    reversals: Floats
    strikes: Floats
    smoothness: float | None


def movement_stats(t: Floats, x: Floats, cutoff: float = CUTOFF_HZ) -> MovementStats:
    """Figures of positions x (n,) [m] at rising instants t (n,) [s].

    Derivatives are those of the spline that a score would play, after a fourth-order Butterworth
    low-pass at `cutoff` [Hz], forward and backward; samples with too low a rate for the filter
    are not filtered. Raises EngineError.
    """
    t, x = np.asarray(t, float) - t[0], np.asarray(x, float)
    duration = float(t[-1])
    mean_rate = (len(t) - 1) / duration
    rate = max(mean_rate, RATE_OVER_CUTOFF * cutoff)
    n_samples = max(int(duration * rate), 8)
    rate = n_samples / duration
    smoothed_positions = _smoothed_positions(
        t, x, cutoff, cutoff < _CUTOFF_RATIO_MAX * mean_rate, n_samples
    )
    velocities = _derivative(smoothed_positions) * rate
    accelerations = _derivative(velocities) * rate
    smoothed_positions, velocities = (
        smoothed_positions[_EDGE_SAMPLES:-_EDGE_SAMPLES],
        velocities[_EDGE_SAMPLES // 2 : -_EDGE_SAMPLES // 2],
    )
    centre, bandwidth = _spectral_centre_and_width(velocities, rate)
    turn_samples = _reversal_samples(smoothed_positions)
    n_near = max(1, round(_REVERSAL_SECONDS * rate))
    peaks = [
        float(np.abs(accelerations[max(0, i - n_near) : i + n_near + 1]).max())
        for i in turn_samples
    ]
    acceleration_rms = _rms(accelerations)
    arc_lengths = [
        spectral_arc_length(np.abs(velocities[i : j + 1]), rate)
        for i, j in zip([0, *turn_samples], [*turn_samples, n_samples], strict=True)
        if _STROKE_SECONDS_MIN <= (j - i) / rate <= _STROKE_SECONDS_MAX
        and velocities[i : j + 1].any()
    ]
    return MovementStats(
        duration,
        float(np.min(x)),
        float(np.max(x)),
        float(np.std(x)),
        float(np.abs(np.diff(smoothed_positions)).sum()),
        float(np.abs(velocities).max()),
        _rms(velocities),
        float(np.abs(accelerations).max()),
        acceleration_rms,
        cutoff,
        centre,
        bandwidth,
        np.array(turn_samples) / rate,
        np.array(
            [
                i / rate
                for i, x in zip(turn_samples, peaks, strict=True)
                if x > _STRIKE_RMS_RATIO * acceleration_rms
            ]
        ),
        float(np.median(arc_lengths)) if arc_lengths else None,
    )


def _smoothed_positions(
    t: Floats, x: Floats, cutoff: float, is_filtered: bool, n_samples: int
) -> Floats:
    """Positions (n + 9,) at even instants of the spline through the samples, four of them beyond
    each end.

    The samples are extended by point reflection at both ends, for as long as the filter
    remembers.
    """
    edge_seconds = max(
        _FILTER_MEMORY_PERIODS / cutoff, _EDGE_SAMPLES * 2 * float(t[-1]) / n_samples
    )
    n_before = min(len(t) - 1, int(np.searchsorted(t, edge_seconds)))
    n_after = min(len(t) - 1, int(np.searchsorted(t[-1] - t[::-1], edge_seconds)))
    mirrored_start, mirrored_end = slice(n_before, 0, -1), slice(-2, -2 - n_after, -1)
    mirrored_instants = np.concatenate(
        [2 * t[0] - t[mirrored_start], t, 2 * t[-1] - t[mirrored_end]]
    )
    x = np.concatenate([2 * x[0] - x[mirrored_start], x, 2 * x[-1] - x[mirrored_end]])
    take = Take(mirrored_instants - mirrored_instants[0], x, smooth=cutoff if is_filtered else None)
    instants = float(t[0] - mirrored_instants[0]) + np.arange(
        -_EDGE_SAMPLES, n_samples + _EDGE_SAMPLES + 1
    ) * (float(t[-1]) / n_samples)
    return take.positions(np.clip(instants, 0.0, take.duration))


def spectral_arc_length(speed: Floats, rate: float) -> float:
    """The spectral arc length of a speed profile (n,), `rate` samples a second; below 0.

    Minus the length of the curve of |V(ω)|/|V(0)| over ω/ω_c, up to ω_c = 40π rad/s
    (Balasubramanian, Melendez-Calderon & Burdet, IEEE Transactions on Biomedical Engineering 59,
    2012). The scale of the speed has no effect, nor has rest before and after.
    """
    padded_length = 1 << int(np.ceil(np.log2(_ARC_LENGTH_PADDING * len(speed))))
    n_bins = int(_ARC_LENGTH_CUTOFF_HZ / rate * padded_length) + 1
    magnitudes = np.abs(np.fft.rfft(speed, padded_length))[: n_bins + 1]
    return (
        -float(np.hypot(np.diff(magnitudes) / magnitudes[0], 1 / n_bins).sum())
        if magnitudes[0]
        else 0.0
    )


def _derivative(x: Floats) -> Floats:
    """Derivative in units per sample, exact for polynomials of the fourth degree, (n - 4,)."""
    return (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) / 12


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2)))


def _spectral_centre_and_width(velocities: Floats, rate: float) -> tuple[float, float]:
    """Mean of the frequency [Hz] weighted by power, and its standard deviation, under a Hann
    window; 0 at rest.
    """
    power_spectrum = np.abs(np.fft.rfft(velocities * np.hanning(len(velocities)))) ** 2
    if not power_spectrum.any():
        return 0.0, 0.0
    frequency = np.fft.rfftfreq(len(velocities), 1 / rate)
    power_spectrum /= power_spectrum.sum()
    centre = float(power_spectrum @ frequency)
    return centre, float(np.sqrt(power_spectrum @ (frequency - centre) ** 2))


def _reversal_samples(x: Floats) -> list[int]:
    """Samples at which a path reverses and then goes back by a part of its range."""
    threshold = _REVERSAL_SHARE_MIN * float(np.ptp(x))
    if not threshold:
        return []
    extremes = np.flatnonzero(np.diff(np.sign(np.diff(x)))) + 1
    turn_samples: list[int] = []
    direction, low_sample, high_sample = 0, 0, 0  # direction; extreme samples since the last turn
    for i in (*extremes.tolist(), len(x) - 1):
        low_sample, high_sample = (
            (i if x[i] < x[low_sample] else low_sample),
            (i if x[i] > x[high_sample] else high_sample),
        )
        if direction >= 0 and x[i] < x[high_sample] - threshold:
            turn_samples += [high_sample] if direction else []
            direction, low_sample, high_sample = -1, i, i
        elif direction <= 0 and x[i] > x[low_sample] + threshold:
            turn_samples += [low_sample] if direction else []
            direction, low_sample, high_sample = 1, i, i
    return turn_samples
