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

LOW, HIGH = 50.0, 16_000.0  # [Hz] modes are sought here
_WIDTHS = (80.0, 400.0)  # [Hz] of bands; wider ones in what is left
_SAMPLES_MAX = 1_100  # samples of a band
_SAMPLES_MIN = 40
_BAND_MODES_MAX = 16  # modes of a band
_SKIP = 3.0  # over a band's width: what its edge smears [s]
_DECAYS = 0.03, 1.5  # least decay [1/s]; most, over a band's width
_DECAY_RATE_MAX = _DECAYS[1] * _WIDTHS[1]  # decay [1/s]
_FITTED = 2.0  # [s] of the beginning that tell amplitudes
_DECAY_ERROR_MAX = 0.5  # largest relative error of a mode's decay
_AROUND = 20.0, 200.0  # [Hz] on both sides of a mode that is removed; its neighbours are polished
_POLISHED = 3_000  # samples
_ROUNDS_MAX = 40  # largest number of rounds of removals
_BLOCK = 4096  # samples
_NOISE_HERTZ = 25.0  # [Hz] around a mode, where the residual tells its noise


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

    def some(self, which: NDArray[np.intp]) -> Modes:
        """The modes of these indices."""
        return Modes(self.f[which], self.d[which], self.c[which])

    def energy(self, duration: float) -> Array:
        """∫ of the square of each mode over a duration [s]."""
        energies = np.abs(self.c) ** 2 / (4.0 * self.d)
        return np.asarray(energies * -np.expm1(-2.0 * self.d * duration))


NONE = Modes(np.zeros(0), np.zeros(0), np.zeros(0, complex))


def find_modes(stroke_sound: Array, rate: float) -> tuple[Modes, Array]:
    """The modes of a sound (n,) that begins after its stroke, and the residual (n,)."""
    modes, residual = NONE, stroke_sound
    for band_width in _WIDTHS:
        bands = Bands(residual, rate)
        highest = min(HIGH, 0.45 * rate)
        mode_frequencies, decay_rates = list(modes.f), list(modes.d)
        for low, high in bands.occupied(LOW, highest, band_width):
            _core.poll()
            band_modes = _in_band(bands, low, high, band_width)
            mode_frequencies += list(band_modes[0])
            decay_rates += list(band_modes[1])
        if mode_frequencies:
            order = np.argsort(mode_frequencies)
            modes, residual = fit_amplitudes(
                stroke_sound, rate, np.array(mode_frequencies)[order], np.array(decay_rates)[order]
            )
    for _ in range(_ROUNDS_MAX):
        errors = uncertainty(modes, residual, rate)
        worst_modes = _unknown(modes, errors)
        if not worst_modes:
            break
        modes, residual = _without_modes(modes, residual, worst_modes, stroke_sound, rate)
    return modes, residual


def _unknown(modes: Modes, errors: Uncertainty) -> list[int]:
    """Modes whose decay is not known, the worst first; of neighbours only the worst."""
    decay_errors = errors.d / modes.d
    chosen: list[int] = []
    for mode in np.argsort(-decay_errors):
        if decay_errors[mode] < _DECAY_ERROR_MAX:
            break
        reach = _reach(modes, mode)
        if all(
            abs(modes.f[mode] - modes.f[chosen_mode]) > reach + _reach(modes, chosen_mode)
            for chosen_mode in chosen
        ):
            chosen.append(int(mode))
    return chosen


def _reach(modes: Modes, mode: int) -> float:
    """The distance [Hz] within which a mode has neighbours, which take over its energy when it is
    removed.
    """
    return float(np.clip(3.0 * modes.d[mode], *_AROUND))


def _without_modes(
    modes: Modes, residual: Array, worst_modes: list[int], stroke_sound: Array, rate: float
) -> tuple[Modes, Array]:
    """The modes without some; neighbours of each removed mode are fitted again to take over its
    energy.
    """
    mode_frequencies, decay_rates = modes.f.copy(), modes.d.copy()
    for mode in worst_modes:
        _core.poll()
        reach = _reach(modes, mode)
        near = np.flatnonzero(np.abs(modes.f - modes.f[mode]) < reach)
        neighbours = near[near != mode]
        if not neighbours.size:
            continue
        near_sound = residual + synthesise(modes.some(near), residual.size, rate)
        low, high = (
            float(mode_frequencies[near].min()) - reach,
            float(mode_frequencies[near].max()) + reach,
        )
        band_signal, band_rate, centre = Bands(near_sound, rate).take(max(low, 1.0), high)
        skipped = ceil(_SKIP * band_rate / (high - low))
        band_signal = band_signal[
            skipped : max(skipped + _SAMPLES_MIN, min(band_signal.size - skipped, _POLISHED))
        ]
        band_poles = np.exp(
            (-decay_rates[neighbours] + 2j * np.pi * (mode_frequencies[neighbours] - centre))
            / band_rate
        )
        band_poles, _, _ = polish_poles(band_signal, band_poles)
        new_f, new_d = (
            centre + np.angle(band_poles) * band_rate / (2.0 * np.pi),
            -np.log(np.abs(band_poles)) * band_rate,
        )
        is_plausible = (
            (np.abs(new_f - mode_frequencies[neighbours]) < reach)
            & (new_d > _DECAYS[0])
            & (new_d < _DECAY_RATE_MAX)
        )
        mode_frequencies[neighbours[is_plausible]], decay_rates[neighbours[is_plausible]] = (
            new_f[is_plausible],
            new_d[is_plausible],
        )
    remaining = np.delete(np.arange(mode_frequencies.size), worst_modes)
    remaining = remaining[np.argsort(mode_frequencies[remaining])]
    return fit_amplitudes(stroke_sound, rate, mode_frequencies[remaining], decay_rates[remaining])


def _in_band(bands: Bands, low: float, high: float, band_width: float) -> tuple[Array, Array]:
    band_signal, rate, centre = bands.take(low, high)
    skipped = ceil(_SKIP * rate / (high - low))
    band_signal = band_signal[
        skipped : max(skipped + _SAMPLES_MIN, min(band_signal.size - skipped, _SAMPLES_MAX))
    ]
    if band_signal.size < _SAMPLES_MIN:
        return np.zeros(0), np.zeros(0)
    band_poles, _ = exponentials(band_signal, min(_BAND_MODES_MAX, band_signal.size // 5))
    band_frequencies = centre + np.angle(band_poles) * rate / (2.0 * np.pi)
    decay_rates = -np.log(np.abs(band_poles)) * rate
    is_accepted = (
        (band_frequencies >= low)
        & (band_frequencies < high)
        & (decay_rates > _DECAYS[0])
        & (decay_rates < _DECAYS[1] * band_width)
    )
    return band_frequencies[is_accepted], decay_rates[is_accepted]


def fit_amplitudes(
    stroke_sound: Array, rate: float, mode_frequencies: Array, decay_rates: Array
) -> tuple[Modes, Array]:
    """Modes of known f [Hz] and d [1/s] with the amplitudes that fit a sound best; the residual."""
    if not mode_frequencies.size:
        return NONE, stroke_sound
    fitted_frames = min(stroke_sound.size, round(_FITTED * rate))
    pole_logarithms = (-decay_rates + 2j * np.pi * mode_frequencies) / rate
    # Sums of products of the real parts u and of -v, from sums of e^(s+s')k and of e^(s+s'*)k.
    sums_of_products, sums_of_conjugate_products = (
        _sum(pole_logarithms[:, None] + pole_logarithms, fitted_frames),
        _sum(pole_logarithms[:, None] + pole_logarithms.conj(), fitted_frames),
    )
    gram = 0.5 * np.block(
        [
            [
                (sums_of_conjugate_products + sums_of_products).real,
                (sums_of_conjugate_products - sums_of_products).imag,
            ],
            [
                -(sums_of_conjugate_products + sums_of_products).imag,
                (sums_of_conjugate_products - sums_of_products).real,
            ],
        ]
    )
    products = _exponential_products(pole_logarithms, stroke_sound[:fitted_frames])
    right_side = np.concatenate([products.real, -products.imag])
    norms = np.sqrt(gram.diagonal())
    solution = (
        np.linalg.lstsq(gram / np.outer(norms, norms), right_side / norms, rcond=1e-12)[0] / norms
    )
    modes = Modes(
        mode_frequencies,
        decay_rates,
        solution[: mode_frequencies.size] + 1j * solution[mode_frequencies.size :],
    )
    return modes, stroke_sound - synthesise(modes, stroke_sound.size, rate)


def _sum(s: NDArray[Any], n: int) -> Complex:
    """Σ of e^(s·k) over k < n."""
    return np.asarray(np.expm1(s * n) / np.expm1(s))


def _exponential_products(exponent_steps: NDArray[Any], stroke_sound: Array) -> Complex:
    """Σ of sound[k]·e^(s·k), for each s (m,)."""
    block_powers = np.exp(np.arange(_BLOCK)[:, None] * exponent_steps)
    products = np.zeros(exponent_steps.size, complex)
    for begin in range(0, stroke_sound.size, _BLOCK):
        block = stroke_sound[begin : begin + _BLOCK]
        products += np.exp(begin * exponent_steps) * (block @ block_powers[: block.size])
    return products


def synthesise(modes: Modes, n: int, rate: float) -> Array:
    """The sum of modes as a sound (n,)."""
    sound = np.zeros(n)
    block_powers = np.exp(np.arange(_BLOCK)[:, None] / rate * modes.poles)
    for begin in range(0, n, _BLOCK):
        c = modes.c * np.exp(begin / rate * modes.poles)
        sound[begin : begin + _BLOCK] = (block_powers[: n - begin] @ c).real
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
    mode_count = modes.f.size
    pole_sums = modes.poles.conj()[:, None] + modes.poles[None, :]
    pole_sums = np.where(np.abs(pole_sums) * duration < 1e-3, -1e-3 / duration, pole_sums)
    end_values = np.exp(pole_sums * duration)
    i0 = (end_values - 1.0) / pole_sums
    i1 = (duration * end_values - i0) / pole_sums
    i2 = (duration * duration * end_values - 2.0 * i1) / pole_sums
    amplitude_products = modes.c.conj()[:, None] * modes.c[None, :]
    fisher = np.block(
        [
            [i2 * amplitude_products, i1 * amplitude_products],
            [i1 * amplitude_products, i0 * amplitude_products],
        ]
    )
    norms = np.sqrt(np.maximum(fisher.diagonal().real, 1e-300))
    bound = np.linalg.pinv(fisher / np.outer(norms, norms), hermitian=True).diagonal().real
    deviations = np.sqrt(np.maximum(bound, 0.0)) / norms
    noise = np.sqrt(2.0 * _noise(modes.f, residual, rate) / rate)
    decay_deviation, level_deviation = (
        deviations[:mode_count] * noise,
        deviations[mode_count:] * noise,
    )
    return Uncertainty(decay_deviation / (2.0 * np.pi), decay_deviation, level_deviation)


def _noise(f: Array, residual: Array, rate: float) -> Array:
    """Variance of white noise that is as strong as the residual near each frequency."""
    power = np.abs(np.fft.rfft(residual)) ** 2 / residual.size
    bin_width = rate / residual.size
    neighbours = [
        power[
            max(1, int((frequency - _NOISE_HERTZ) / bin_width)) : int(
                (frequency + _NOISE_HERTZ) / bin_width
            )
            + 2
        ]
        for frequency in f
    ]
    return np.array([float(powers.mean()) if powers.size else 0.0 for powers in neighbours])
