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
from ergon.workshop.bells.poles import exponentials, polish_poles

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
_ROUNDS_MAX = 40  # largest number of rounds of removals
_BLOCK = 4096  # samples
_NOISE_HALF_WIDTH = 25.0  # [Hz] around a mode, where the residual tells its noise


@dataclass(frozen=True)
class Modes:
    """f [Hz], decay d [1/s] and complex amplitude at the first sample, each (n,)."""

    f: Array
    d: Array
    c: Complex

    @property
    def poles(self) -> Complex:
        """s of Re(c·e^{s·t})."""
        return -self.d + 2j * np.pi * self.f

    @property
    def t60(self) -> Array:
        """Time to fall by 60 dB [s]."""
        return LN_1000 / self.d

    def subset(self, indices: NDArray[np.intp]) -> Modes:
        """The modes of these indices."""
        return Modes(self.f[indices], self.d[indices], self.c[indices])

    def energy(self, duration: float) -> Array:
        """∫ of the square of each mode over a duration [s]."""
        energies = np.abs(self.c) ** 2 / (4.0 * self.d)
        return np.asarray(energies * -np.expm1(-2.0 * self.d * duration))


NO_MODES = Modes(np.zeros(0), np.zeros(0), np.zeros(0, complex))


def find_modes(sound: Array, rate: float) -> tuple[Modes, Array]:
    """The modes of a sound (n,) that begins after its stroke, and the residual (n,)."""
    modes, residual = NO_MODES, sound
    for band_width in _BAND_WIDTHS:
        bands = Bands(residual, rate)
        frequency_max = min(FREQUENCY_MAX, 0.45 * rate)
        f, d = list(modes.f), list(modes.d)
        for low, high in bands.occupied_bands(FREQUENCY_MIN, frequency_max, band_width):
            _core.poll()
            band_modes = _modes_in_band(bands, low, high, band_width)
            f += list(band_modes[0])
            d += list(band_modes[1])
        if f:
            order = np.argsort(f)
            modes, residual = fit_amplitudes(sound, rate, np.array(f)[order], np.array(d)[order])
    for _ in range(_ROUNDS_MAX):
        errors = uncertainty(modes, residual, rate)
        uncertain = _uncertain_modes(modes, errors)
        if not uncertain:
            break
        modes, residual = _without_modes(modes, residual, uncertain, sound, rate)
    return modes, residual


def _uncertain_modes(modes: Modes, errors: Uncertainty) -> list[int]:
    """Modes whose decay is not known, the worst first; of neighbours only the worst."""
    decay_errors = errors.d / modes.d
    chosen: list[int] = []
    for mode in np.argsort(-decay_errors):
        if decay_errors[mode] < _DECAY_ERROR_MAX:
            break
        reach = _neighbour_range(modes, mode)
        if all(
            abs(modes.f[mode] - modes.f[chosen_mode]) > reach + _neighbour_range(modes, chosen_mode)
            for chosen_mode in chosen
        ):
            chosen.append(int(mode))
    return chosen


def _neighbour_range(modes: Modes, mode: int) -> float:
    """The distance [Hz] within which a mode has neighbours, which take over its energy when it is
    removed.
    """
    return float(np.clip(3.0 * modes.d[mode], *_NEIGHBOUR_RANGE_LIMITS))


def _without_modes(
    modes: Modes, residual: Array, removed: list[int], sound: Array, rate: float
) -> tuple[Modes, Array]:
    """The modes without some; neighbours of each removed mode are fitted again to take over its
    energy.
    """
    f, d = modes.f.copy(), modes.d.copy()
    for mode in removed:
        _core.poll()
        reach = _neighbour_range(modes, mode)
        near = np.flatnonzero(np.abs(modes.f - modes.f[mode]) < reach)
        neighbours = near[near != mode]
        if not neighbours.size:
            continue
        local_sound = residual + synthesise(modes.subset(near), residual.size, rate)
        low, high = (
            float(f[near].min()) - reach,
            float(f[near].max()) + reach,
        )
        signal, band_rate, centre = Bands(local_sound, rate).extract(max(low, 1.0), high)
        n_skipped = ceil(_SKIP_CYCLES * band_rate / (high - low))
        signal = signal[
            n_skipped : max(
                n_skipped + _SAMPLES_MIN, min(signal.size - n_skipped, _POLISHED_SAMPLES_MAX)
            )
        ]
        poles = np.exp((-d[neighbours] + 2j * np.pi * (f[neighbours] - centre)) / band_rate)
        poles, _, _ = polish_poles(signal, poles)
        new_f, new_d = (
            centre + np.angle(poles) * band_rate / (2.0 * np.pi),
            -np.log(np.abs(poles)) * band_rate,
        )
        is_plausible = (
            (np.abs(new_f - f[neighbours]) < reach)
            & (new_d > _DECAY_LIMITS[0])
            & (new_d < _DECAY_RATE_MAX)
        )
        f[neighbours[is_plausible]], d[neighbours[is_plausible]] = (
            new_f[is_plausible],
            new_d[is_plausible],
        )
    remaining = np.delete(np.arange(f.size), removed)
    remaining = remaining[np.argsort(f[remaining])]
    return fit_amplitudes(sound, rate, f[remaining], d[remaining])


def _modes_in_band(bands: Bands, low: float, high: float, band_width: float) -> tuple[Array, Array]:
    signal, rate, centre = bands.extract(low, high)
    n_skipped = ceil(_SKIP_CYCLES * rate / (high - low))
    signal = signal[
        n_skipped : max(n_skipped + _SAMPLES_MIN, min(signal.size - n_skipped, _SAMPLES_MAX))
    ]
    if signal.size < _SAMPLES_MIN:
        return np.zeros(0), np.zeros(0)
    poles, _ = exponentials(signal, min(_BAND_MODES_MAX, signal.size // 5))
    f = centre + np.angle(poles) * rate / (2.0 * np.pi)
    d = -np.log(np.abs(poles)) * rate
    is_accepted = (
        (f >= low) & (f < high) & (d > _DECAY_LIMITS[0]) & (d < _DECAY_LIMITS[1] * band_width)
    )
    return f[is_accepted], d[is_accepted]


def fit_amplitudes(sound: Array, rate: float, f: Array, d: Array) -> tuple[Modes, Array]:
    """Modes of known f [Hz] and d [1/s] with the amplitudes that fit a sound best; the residual."""
    if not f.size:
        return NO_MODES, sound
    n_fitted = min(sound.size, round(_FITTED_SECONDS * rate))
    s = (-d + 2j * np.pi * f) / rate
    # Sums of products of the real parts u and of -v, from sums of e^(s+s')k and of e^(s+s'*)k.
    sums, conjugate_sums = (
        _geometric_sum(s[:, None] + s, n_fitted),
        _geometric_sum(s[:, None] + s.conj(), n_fitted),
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
    correlations = _correlations(s, sound[:n_fitted])
    rhs = np.concatenate([correlations.real, -correlations.imag])
    norms = np.sqrt(gram.diagonal())
    solution = np.linalg.lstsq(gram / np.outer(norms, norms), rhs / norms, rcond=1e-12)[0] / norms
    modes = Modes(
        f,
        d,
        solution[: f.size] + 1j * solution[f.size :],
    )
    return modes, sound - synthesise(modes, sound.size, rate)


def _geometric_sum(s: NDArray[Any], n: int) -> Complex:
    """Σ of e^(s·k) over k < n."""
    return np.asarray(np.expm1(s * n) / np.expm1(s))


def _correlations(s: NDArray[Any], sound: Array) -> Complex:
    """Σ of sound[k]·e^(s·k), for each s (m,)."""
    powers = np.exp(np.arange(_BLOCK)[:, None] * s)
    products = np.zeros(s.size, complex)
    for begin in range(0, sound.size, _BLOCK):
        block = sound[begin : begin + _BLOCK]
        products += np.exp(begin * s) * (block @ powers[: block.size])
    return products


def synthesise(modes: Modes, n: int, rate: float) -> Array:
    """The sum of modes as a sound (n,)."""
    sound = np.zeros(n)
    powers = np.exp(np.arange(_BLOCK)[:, None] / rate * modes.poles)
    for begin in range(0, n, _BLOCK):
        c = modes.c * np.exp(begin / rate * modes.poles)
        sound[begin : begin + _BLOCK] = (powers[: n - begin] @ c).real
    return sound


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations: of f [Hz], of d [1/s], of the amplitude over itself; each (n,)."""

    f: Array
    d: Array
    level: Array


def uncertainty(modes: Modes, residual: Array, rate: float) -> Uncertainty:
    """The Cramér-Rao bound for modes in noise as strong as the residual around each mode."""
    duration = residual.size / rate
    n_modes = modes.f.size
    pole_sums = modes.poles.conj()[:, None] + modes.poles[None, :]
    pole_sums = np.where(np.abs(pole_sums) * duration < 1e-3, -1e-3 / duration, pole_sums)
    end_factors = np.exp(pole_sums * duration)
    i0 = (end_factors - 1.0) / pole_sums
    i1 = (duration * end_factors - i0) / pole_sums
    i2 = (duration * duration * end_factors - 2.0 * i1) / pole_sums
    amplitude_products = modes.c.conj()[:, None] * modes.c[None, :]
    fisher = np.block(
        [
            [i2 * amplitude_products, i1 * amplitude_products],
            [i1 * amplitude_products, i0 * amplitude_products],
        ]
    )
    norms = np.sqrt(np.maximum(fisher.diagonal().real, 1e-300))
    variances = np.linalg.pinv(fisher / np.outer(norms, norms), hermitian=True).diagonal().real
    unit_deviations = np.sqrt(np.maximum(variances, 0.0)) / norms
    noise = np.sqrt(2.0 * _noise_variance(modes.f, residual, rate) / rate)
    decay_deviation, level_deviation = (
        unit_deviations[:n_modes] * noise,
        unit_deviations[n_modes:] * noise,
    )
    return Uncertainty(decay_deviation / (2.0 * np.pi), decay_deviation, level_deviation)


def _noise_variance(f: Array, residual: Array, rate: float) -> Array:
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
        for frequency in f
    ]
    return np.array([float(powers.mean()) if powers.size else 0.0 for powers in nearby_power])
