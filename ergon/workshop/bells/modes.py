"""The modes of a stroke: sums of damped sines, and the uncertainty of each."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ergon import _core
from ergon.common.decay import LN_1000
from ergon.workshop.bells.bands import Array, Bands, Complex
from ergon.workshop.bells.poles import fit_exponentials, polish_poles

FREQUENCY_MIN, FREQUENCY_MAX = 50.0, 16_000.0  # [Hz] modes are sought here
_BAND_WIDTHS = (80.0, 400.0)  # [Hz] of bands; wider ones in what is left
_SAMPLES_MAX = 1_100  # samples of a band
_SAMPLES_MIN = 40
_BAND_MODES_MAX = 16  # modes of a band
_SKIP_CYCLES = 3.0  # periods of a band's width: its edge smears the first ones
_DECAY_LIMITS = 0.03, 1.5  # least decay [1/s]; most, over a band's width
_DECAY_RATE_MAX = _DECAY_LIMITS[1] * _BAND_WIDTHS[1]  # decay [1/s]
_FITTED_SECONDS = 2.0  # [s] amplitudes are fitted to the beginning of this length
_DECAY_ERROR_MAX = 0.5  # largest relative error of a mode's decay
_NEIGHBOUR_RANGE_LIMITS = (
    20.0,
    200.0,
)  # [Hz] on both sides of a mode that is removed; its neighbours are polished
_POLISHED_SAMPLES_MAX = 3_000  # samples
_REMOVAL_ROUNDS_MAX = 40  # largest number of rounds of removals
_BLOCK = 4096  # samples
_NOISE_HALF_WIDTH = 25.0  # [Hz] around a mode, where the residual tells its noise


@dataclass(frozen=True)
class Modes:
    """f [Hz], decay d [1/s] and complex amplitude at the first sample, each (n,)."""

    frequencies: Array
    decays: Array
    amplitudes: Complex

    @property
    def poles(self) -> Complex:
        """s of Re(c·e^{s·t})."""
        return -self.decays + 2j * np.pi * self.frequencies

    @property
    def t60(self) -> Array:
        """Time to fall by 60 dB [s]."""
        return LN_1000 / self.decays

    def subset(self, indices: NDArray[np.intp]) -> Modes:
        """The modes of these indices."""
        return Modes(self.frequencies[indices], self.decays[indices], self.amplitudes[indices])

    def energy(self, duration: float) -> Array:
        """∫ of the square of each mode over a duration [s]."""
        energies = np.abs(self.amplitudes) ** 2 / (4.0 * self.decays)
        return np.asarray(energies * -np.expm1(-2.0 * self.decays * duration))


NO_MODES = Modes(np.zeros(0), np.zeros(0), np.zeros(0, complex))


def find_modes(sound: Array, rate: float) -> tuple[Modes, Array]:
    """The modes of a sound (n,) that begins after its stroke, and the residual (n,)."""
    modes, residual = NO_MODES, sound
    for band_width in _BAND_WIDTHS:
        bands = Bands(residual, rate)
        frequency_max = min(FREQUENCY_MAX, 0.45 * rate)
        frequencies, decays = list(modes.frequencies), list(modes.decays)
        for low, high in bands.occupied_bands(FREQUENCY_MIN, frequency_max, band_width):
            _core.poll()
            band_modes = _modes_in_band(bands, low, high, band_width)
            frequencies += list(band_modes[0])
            decays += list(band_modes[1])
        if frequencies:
            order = np.argsort(frequencies)
            modes, residual = fit_amplitudes(
                sound, rate, np.array(frequencies)[order], np.array(decays)[order]
            )
    for _ in range(_REMOVAL_ROUNDS_MAX):
        errors = mode_uncertainty(modes, residual, rate)
        uncertain = _uncertain_modes(modes, errors)
        if not uncertain:
            break
        modes, residual = _without_modes(modes, residual, uncertain, sound, rate)
    return modes, residual


def _uncertain_modes(modes: Modes, errors: Uncertainty) -> list[int]:
    """Modes whose decay is not known, the worst first; of neighbours only the worst."""
    decay_errors = errors.decays / modes.decays
    chosen: list[int] = []
    for mode in np.argsort(-decay_errors):
        if decay_errors[mode] < _DECAY_ERROR_MAX:
            break
        neighbour_range = _neighbour_range(modes, mode)
        if all(
            abs(modes.frequencies[mode] - modes.frequencies[chosen_mode])
            > neighbour_range + _neighbour_range(modes, chosen_mode)
            for chosen_mode in chosen
        ):
            chosen.append(int(mode))
    return chosen


def _neighbour_range(modes: Modes, mode: int) -> float:
    """The distance [Hz] within which a mode has neighbours, which take over its energy when it is
    removed.
    """
    return float(np.clip(3.0 * modes.decays[mode], *_NEIGHBOUR_RANGE_LIMITS))


def _without_modes(
    modes: Modes, residual: Array, removed: list[int], sound: Array, rate: float
) -> tuple[Modes, Array]:
    """The modes without some; neighbours of each removed mode are fitted again to take over its
    energy.
    """
    frequencies, decays = modes.frequencies.copy(), modes.decays.copy()
    for mode in removed:
        _core.poll()
        neighbour_range = _neighbour_range(modes, mode)
        near_modes = np.flatnonzero(
            np.abs(modes.frequencies - modes.frequencies[mode]) < neighbour_range
        )
        neighbours = near_modes[near_modes != mode]
        if not neighbours.size:
            continue
        local_sound = residual + synthesise(modes.subset(near_modes), residual.size, rate)
        low, high = (
            float(frequencies[near_modes].min()) - neighbour_range,
            float(frequencies[near_modes].max()) + neighbour_range,
        )
        signal, band_rate, centre = Bands(local_sound, rate).extract(max(low, 1.0), high)
        n_skipped = ceil(_SKIP_CYCLES * band_rate / (high - low))
        signal = signal[
            n_skipped : max(
                n_skipped + _SAMPLES_MIN, min(signal.size - n_skipped, _POLISHED_SAMPLES_MAX)
            )
        ]
        poles = np.exp(
            (-decays[neighbours] + 2j * np.pi * (frequencies[neighbours] - centre)) / band_rate
        )
        poles, _, _ = polish_poles(signal, poles)
        new_frequencies, new_decays = (
            centre + np.angle(poles) * band_rate / (2.0 * np.pi),
            -np.log(np.abs(poles)) * band_rate,
        )
        is_plausible = (
            (np.abs(new_frequencies - frequencies[neighbours]) < neighbour_range)
            & (new_decays > _DECAY_LIMITS[0])
            & (new_decays < _DECAY_RATE_MAX)
        )
        frequencies[neighbours[is_plausible]], decays[neighbours[is_plausible]] = (
            new_frequencies[is_plausible],
            new_decays[is_plausible],
        )
    remaining = np.delete(np.arange(frequencies.size), removed)
    remaining = remaining[np.argsort(frequencies[remaining])]
    return fit_amplitudes(sound, rate, frequencies[remaining], decays[remaining])


def _modes_in_band(bands: Bands, low: float, high: float, band_width: float) -> tuple[Array, Array]:
    signal, rate, centre = bands.extract(low, high)
    n_skipped = ceil(_SKIP_CYCLES * rate / (high - low))
    signal = signal[
        n_skipped : max(n_skipped + _SAMPLES_MIN, min(signal.size - n_skipped, _SAMPLES_MAX))
    ]
    if signal.size < _SAMPLES_MIN:
        return np.zeros(0), np.zeros(0)
    poles, _ = fit_exponentials(signal, min(_BAND_MODES_MAX, signal.size // 5))
    frequencies = centre + np.angle(poles) * rate / (2.0 * np.pi)
    decays = -np.log(np.abs(poles)) * rate
    is_accepted = (
        (frequencies >= low)
        & (frequencies < high)
        & (decays > _DECAY_LIMITS[0])
        & (decays < _DECAY_LIMITS[1] * band_width)
    )
    return frequencies[is_accepted], decays[is_accepted]


def fit_amplitudes(
    sound: Array, rate: float, frequencies: Array, decays: Array
) -> tuple[Modes, Array]:
    """Modes of known f [Hz] and d [1/s] with the amplitudes that fit a sound best; the residual."""
    if not frequencies.size:
        return NO_MODES, sound
    n_fitted = min(sound.size, round(_FITTED_SECONDS * rate))
    step_poles = (-decays + 2j * np.pi * frequencies) / rate
    # Sums of products of the real parts u and of -v, from sums of e^(s+s')k and of e^(s+s'*)k.
    sums, conjugate_sums = (
        _geometric_sum(step_poles[:, None] + step_poles, n_fitted),
        _geometric_sum(step_poles[:, None] + step_poles.conj(), n_fitted),
    )
    gram = 0.5 * np.block(
        [
            [
                (conjugate_sums + sums).real,
                (conjugate_sums - sums).imag,
            ],
            [
                -(conjugate_sums + sums).imag,
                (conjugate_sums - sums).real,
            ],
        ]
    )
    correlations = _correlations(step_poles, sound[:n_fitted])
    rhs = np.concatenate([correlations.real, -correlations.imag])
    norms = np.sqrt(gram.diagonal())
    solution = np.linalg.lstsq(gram / np.outer(norms, norms), rhs / norms, rcond=1e-12)[0] / norms
    modes = Modes(
        frequencies,
        decays,
        solution[: frequencies.size] + 1j * solution[frequencies.size :],
    )
    return modes, sound - synthesise(modes, sound.size, rate)


def _geometric_sum(exponents: NDArray[Any], n_terms: int) -> Complex:
    """Σ of e^(s·k) over k < n."""
    return np.asarray(np.expm1(exponents * n_terms) / np.expm1(exponents))


def _correlations(exponents: NDArray[Any], sound: Array) -> Complex:
    """Σ of sound[k]·e^(s·k), for each s (m,)."""
    phasors = np.exp(np.arange(_BLOCK)[:, None] * exponents)
    products = np.zeros(exponents.size, complex)
    for first_sample in range(0, sound.size, _BLOCK):
        block = sound[first_sample : first_sample + _BLOCK]
        products += np.exp(first_sample * exponents) * (block @ phasors[: block.size])
    return products


def synthesise(modes: Modes, n_samples: int, rate: float) -> Array:
    """The sum of modes as a sound (n,)."""
    sound = np.zeros(n_samples)
    phasors = np.exp(np.arange(_BLOCK)[:, None] / rate * modes.poles)
    for first_sample in range(0, n_samples, _BLOCK):
        amplitudes = modes.amplitudes * np.exp(first_sample / rate * modes.poles)
        sound[first_sample : first_sample + _BLOCK] = (
            phasors[: n_samples - first_sample] @ amplitudes
        ).real
    return sound


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations: of f [Hz], of d [1/s], of the amplitude over itself; each (n,)."""

    frequencies: Array
    decays: Array
    relative_amplitudes: Array


def mode_uncertainty(modes: Modes, residual: Array, rate: float) -> Uncertainty:
    """The Cramér-Rao bound for modes in noise as strong as the residual around each mode."""
    duration = residual.size / rate
    n_modes = modes.frequencies.size
    pole_sums = modes.poles.conj()[:, None] + modes.poles[None, :]
    pole_sums = np.where(np.abs(pole_sums) * duration < 1e-3, -1e-3 / duration, pole_sums)
    end_factors = np.exp(pole_sums * duration)
    i0 = (end_factors - 1.0) / pole_sums
    i1 = (duration * end_factors - i0) / pole_sums
    i2 = (duration * duration * end_factors - 2.0 * i1) / pole_sums
    amplitude_products = modes.amplitudes.conj()[:, None] * modes.amplitudes[None, :]
    fisher = np.block(
        [
            [i2 * amplitude_products, i1 * amplitude_products],
            [i1 * amplitude_products, i0 * amplitude_products],
        ]
    )
    norms = np.sqrt(np.maximum(fisher.diagonal().real, 1e-300))
    variances = np.linalg.pinv(fisher / np.outer(norms, norms), hermitian=True).diagonal().real
    unit_deviations = np.sqrt(np.maximum(variances, 0.0)) / norms
    noise = np.sqrt(2.0 * _noise_variance(modes.frequencies, residual, rate) / rate)
    decay_deviation, level_deviation = (
        unit_deviations[:n_modes] * noise,
        unit_deviations[n_modes:] * noise,
    )
    return Uncertainty(decay_deviation / (2.0 * np.pi), decay_deviation, level_deviation)


def _noise_variance(frequencies: Array, residual: Array, rate: float) -> Array:
    """Variance of white noise that is as strong as the residual near each frequency."""
    power = np.abs(np.fft.rfft(residual)) ** 2 / residual.size
    bin_width = rate / residual.size
    nearby_power = [
        power[
            max(1, int((frequency - _NOISE_HALF_WIDTH) / bin_width)) : int(
                (frequency + _NOISE_HALF_WIDTH) / bin_width
            )
            + 2
        ]
        for frequency in frequencies
    ]
    return np.array(
        [float(bin_powers.mean()) if bin_powers.size else 0.0 for bin_powers in nearby_power]
    )
