"""The mode that would explain most of the residual of a key's model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .output_error import residuals
from .parameters import INDEX, total_mass

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from .gesture import Floats, Gesture
    from .output_error import Fit

# 20 lies above 18, the highest score of 20 keys without a mode; 50 keys reached 37 at least
# with a mode of a twentieth of their mass, a second mode 26. What passes is fitted and judged.
SCORE_MIN = 20.0
_FREQUENCY_MIN, _FREQUENCY_MAX_RATE_RATIO = 5.0, 0.479  # Hz; of the rate
_N_FREQUENCIES = 1200
_DAMPING_RATIOS = np.array([0.003, 0.01, 0.03, 0.1])
_MASS_SHARE_MAX = 0.3  # largest mass of a mode over that of the key


@dataclass(frozen=True, slots=True)
class Peak:
    """A possible mode: mass [kg], frequency [Hz], damping ratio, and its score."""

    mass: float
    frequency: float
    ratio: float
    score: float


def _background(powers: NDArray[np.floating], bin_frequencies: NDArray[np.floating]) -> Floats:
    """Median of a periodogram over half an octave, which a narrow peak does not lift, (n,)."""
    n_bins = powers.size
    bins = np.unique(
        np.concatenate([np.arange(min(n_bins, 64)), np.geomspace(64, n_bins - 1, 300).astype(int)])
    )
    first_bins = np.searchsorted(bin_frequencies, bin_frequencies[bins] * 2**-0.25)
    end_bins = np.searchsorted(bin_frequencies, bin_frequencies[bins] * 2**0.25) + 1
    first_bins, end_bins = (
        np.minimum(first_bins, np.maximum(bins - 8, 0)),
        np.maximum(end_bins, np.minimum(bins + 9, n_bins)),
    )
    medians = [np.median(powers[i:j]) for i, j in zip(first_bins, end_bins, strict=True)]
    background_at_bins = np.maximum(np.array(medians) / np.log(2), np.finfo(float).tiny)
    background: Floats = np.exp(np.interp(np.arange(n_bins), bins, np.log(background_at_bins)))
    return background


def _taper(n: int) -> Floats:
    """A window: one, except for a cosine taper to zero over a twentieth at both ends, (n,)."""
    edge = max(n // 20, 1)
    rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(edge) + 0.5) / edge)
    return np.concatenate([rise, np.ones(n - 2 * edge), rise[::-1]])


def highest_peak(gestures: Sequence[Gesture], fit: Fit) -> Peak:
    """The mode that explains most of the residual of a fit, to first order in its mass."""
    parameters, rate = fit.parameters, gestures[0].rate
    frequencies = np.geomspace(_FREQUENCY_MIN, _FREQUENCY_MAX_RATE_RATIO * rate, _N_FREQUENCIES)
    omega = 2 * np.pi * frequencies[:, None]
    projection, squared_norm = (
        np.zeros((_N_FREQUENCIES, _DAMPING_RATIOS.size)),
        np.zeros((_N_FREQUENCIES, _DAMPING_RATIOS.size)),
    )
    for gesture, start in zip(gestures, fit.start_positions, strict=True):
        error = np.zeros(gesture.force.size)
        error[gesture.is_compared] = residuals(parameters, gesture, start)
        window = _taper(error.size)
        bin_frequencies = np.fft.rfftfreq(error.size, 1 / rate)
        is_in_band = (bin_frequencies > _FREQUENCY_MIN) & (
            bin_frequencies < _FREQUENCY_MAX_RATE_RATIO * rate
        )
        s = 2j * np.pi * bin_frequencies[is_in_band]
        residual_spectrum = np.fft.rfft(error * window)
        force_spectrum = np.fft.rfft(gesture.force * window)[is_in_band]
        # The force is held for a tick, and delayed.
        force_spectrum = (
            force_spectrum
            * np.sinc(bin_frequencies[is_in_band] / rate)
            * np.exp(-s * (parameters[INDEX["delay"]] + 0.5 / rate))
        )
        key_response = 1 / (
            total_mass(parameters) * s * s
            + parameters[INDEX["damping"]] * s
            + parameters[INDEX["stiffness"]]
        )
        whitening = 1 / np.sqrt(
            _background(np.abs(residual_spectrum) ** 2, bin_frequencies)[is_in_band]
        )
        template_without_mode, residual_spectrum = (
            force_spectrum * key_response**2 * s**4 * whitening,
            residual_spectrum[is_in_band] * whitening,
        )
        for ratio_column, ratio in enumerate(_DAMPING_RATIOS):
            for block in np.array_split(np.arange(_N_FREQUENCIES), 12):
                omega_block = omega[block]
                template = template_without_mode / (
                    s * s + (2 * ratio * omega_block) * s + omega_block * omega_block
                )
                projection[block, ratio_column] += np.real(template.conj() @ residual_spectrum)
                squared_norm[block, ratio_column] += np.einsum(
                    "ij,ij->i", template, template.conj()
                ).real
    scores = np.where(projection > 0, 2 * projection**2 / squared_norm, 0.0)
    frequency_index, ratio_index = divmod(int(np.argmax(scores)), _DAMPING_RATIOS.size)
    mass = float(
        np.clip(
            projection[frequency_index, ratio_index] / squared_norm[frequency_index, ratio_index],
            1e-4,
            _MASS_SHARE_MAX * parameters[0],
        )
    )
    return Peak(
        mass,
        float(frequencies[frequency_index]),
        float(_DAMPING_RATIOS[ratio_index]),
        float(scores[frequency_index, ratio_index]),
    )
