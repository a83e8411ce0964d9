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
    bell_modes, residual = NONE, stroke_sound
    for band_width in _WIDTHS:
        bands = Bands(residual, rate)
        high = min(HIGH, 0.45 * rate)
        mode_frequencies, decay_rates = list(bell_modes.f), list(bell_modes.d)
        for low, top in bands.occupied(LOW, high, band_width):
            _core.poll()
            band_modes = _in_band(bands, low, top, band_width)
            mode_frequencies += list(band_modes[0])
            decay_rates += list(band_modes[1])
        if mode_frequencies:
            order = np.argsort(mode_frequencies)
            bell_modes, residual = fit_amplitudes(
                stroke_sound, rate, np.array(mode_frequencies)[order], np.array(decay_rates)[order]
            )
    for _ in range(_ROUNDS_MAX):
        errors = uncertainty(bell_modes, residual, rate)
        worst = _unknown(bell_modes, errors)
        if not worst:
            break
        bell_modes, residual = _without_modes(bell_modes, residual, worst, stroke_sound, rate)
    return bell_modes, residual


def _unknown(bell_modes: Modes, errors: Uncertainty) -> list[int]:
    """Modes whose decay is not known, the worst first; of neighbours only the worst."""
    decay_share = errors.d / bell_modes.d
    chosen_modes: list[int] = []
    for mode_index in np.argsort(-decay_share):
        if decay_share[mode_index] < _DECAY_ERROR_MAX:
            break
        reach = _reach(bell_modes, mode_index)
        if all(
            abs(bell_modes.f[mode_index] - bell_modes.f[chosen_mode])
            > reach + _reach(bell_modes, chosen_mode)
            for chosen_mode in chosen_modes
        ):
            chosen_modes.append(int(mode_index))
    return chosen_modes


def _reach(modes: Modes, mode: int) -> float:
    """The distance [Hz] within which a mode has neighbours, which take over its energy when it is
    removed.
    """
    return float(np.clip(3.0 * modes.d[mode], *_AROUND))


def _without_modes(
    bell_modes: Modes, residual: Array, worst_modes: list[int], stroke_sound: Array, rate: float
) -> tuple[Modes, Array]:
    """The modes without some; neighbours of each removed mode are fitted again to take over its
    energy.
    """
    mode_frequencies, decay_rates = bell_modes.f.copy(), bell_modes.d.copy()
    for mode in worst_modes:
        _core.poll()
        mode_reach = _reach(bell_modes, mode)
        near_modes = np.flatnonzero(np.abs(bell_modes.f - bell_modes.f[mode]) < mode_reach)
        other_modes = near_modes[near_modes != mode]
        if not other_modes.size:
            continue
        near_sound = residual + synthesise(bell_modes.some(near_modes), residual.size, rate)
        low_hertz, top = (
            float(mode_frequencies[near_modes].min()) - mode_reach,
            float(mode_frequencies[near_modes].max()) + mode_reach,
        )
        signal, band_rate, centre = Bands(near_sound, rate).take(max(low_hertz, 1.0), top)
        skip = ceil(_SKIP * band_rate / (top - low_hertz))
        signal = signal[skip : max(skip + _SAMPLES_MIN, min(signal.size - skip, _POLISHED))]
        z = np.exp(
            (-decay_rates[other_modes] + 2j * np.pi * (mode_frequencies[other_modes] - centre))
            / band_rate
        )
        z, _, _ = polish_poles(signal, z)
        new_f, new_d = (
            centre + np.angle(z) * band_rate / (2.0 * np.pi),
            -np.log(np.abs(z)) * band_rate,
        )
        is_fit = (
            (np.abs(new_f - mode_frequencies[other_modes]) < mode_reach)
            & (new_d > _DECAYS[0])
            & (new_d < _DECAY_RATE_MAX)
        )
        mode_frequencies[other_modes[is_fit]], decay_rates[other_modes[is_fit]] = (
            new_f[is_fit],
            new_d[is_fit],
        )
    remaining = np.delete(np.arange(mode_frequencies.size), worst_modes)
    remaining = remaining[np.argsort(mode_frequencies[remaining])]
    return fit_amplitudes(stroke_sound, rate, mode_frequencies[remaining], decay_rates[remaining])


def _in_band(
    bands: Bands, low_hertz: float, top_hertz: float, band_width: float
) -> tuple[Array, Array]:
    signal, rate, centre = bands.take(low_hertz, top_hertz)
    skip = ceil(_SKIP * rate / (top_hertz - low_hertz))
    signal = signal[skip : max(skip + _SAMPLES_MIN, min(signal.size - skip, _SAMPLES_MAX))]
    if signal.size < _SAMPLES_MIN:
        return np.zeros(0), np.zeros(0)
    z, _ = exponentials(signal, min(_BAND_MODES_MAX, signal.size // 5))
    band_frequencies = centre + np.angle(z) * rate / (2.0 * np.pi)
    d = -np.log(np.abs(z)) * rate
    is_ours = (
        (band_frequencies >= low_hertz)
        & (band_frequencies < top_hertz)
        & (d > _DECAYS[0])
        & (d < _DECAYS[1] * band_width)
    )
    return band_frequencies[is_ours], d[is_ours]


def fit_amplitudes(
    stroke_sound: Array, rate: float, mode_frequencies: Array, decay_rates: Array
) -> tuple[Modes, Array]:
    """Modes of known f [Hz] and d [1/s] with the amplitudes that fit a sound best; the residual."""
    if not mode_frequencies.size:
        return NONE, stroke_sound
    n = min(stroke_sound.size, round(_FITTED * rate))
    pole_logarithms = (-decay_rates + 2j * np.pi * mode_frequencies) / rate
    # Sums of products of the real parts u and of -v, from sums of e^(s+s')k and of e^(s+s'*)k.
    plain_sums, rotated_sums = (
        _sum(pole_logarithms[:, None] + pole_logarithms, n),
        _sum(pole_logarithms[:, None] + pole_logarithms.conj(), n),
    )
    gram = 0.5 * np.block(
        [
            [(rotated_sums + plain_sums).real, (rotated_sums - plain_sums).imag],
            [-(rotated_sums + plain_sums).imag, (rotated_sums - plain_sums).real],
        ]
    )
    products = _exponential_products(pole_logarithms, stroke_sound[:n])
    right_side = np.concatenate([products.real, -products.imag])
    size = np.sqrt(gram.diagonal())
    solution = (
        np.linalg.lstsq(gram / np.outer(size, size), right_side / size, rcond=1e-12)[0] / size
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
    block_step = np.exp(np.arange(_BLOCK)[:, None] * exponent_steps)
    product_sum = np.zeros(exponent_steps.size, complex)
    for begin in range(0, stroke_sound.size, _BLOCK):
        block = stroke_sound[begin : begin + _BLOCK]
        product_sum += np.exp(begin * exponent_steps) * (block @ block_step[: block.size])
    return product_sum


def synthesise(modes: Modes, n: int, rate: float) -> Array:
    """The sum of modes as a sound (n,)."""
    synthesised_sound = np.zeros(n)
    block_step = np.exp(np.arange(_BLOCK)[:, None] / rate * modes.poles)
    for begin in range(0, n, _BLOCK):
        c = modes.c * np.exp(begin / rate * modes.poles)
        synthesised_sound[begin : begin + _BLOCK] = (block_step[: n - begin] @ c).real
    return synthesised_sound


@dataclass(frozen=True)
class Uncertainty:
    """Standard deviations: of f [Hz], of d [1/s], of the amplitude over itself; each (n,)."""

    f: Array
    d: Array
    level: Array


def uncertainty(bell_modes: Modes, residual: Array, rate: float) -> Uncertainty:
    """The Cramér-Rao bound for modes in noise as strong as the residual around each mode."""
    duration = residual.size / rate
    n = bell_modes.f.size
    pole_sums = bell_modes.poles.conj()[:, None] + bell_modes.poles[None, :]
    pole_sums = np.where(np.abs(pole_sums) * duration < 1e-3, -1e-3 / duration, pole_sums)
    end_values = np.exp(pole_sums * duration)
    i0 = (end_values - 1.0) / pole_sums
    i1 = (duration * end_values - i0) / pole_sums
    i2 = (duration * duration * end_values - 2.0 * i1) / pole_sums
    weight = bell_modes.c.conj()[:, None] * bell_modes.c[None, :]
    fisher = np.block([[i2 * weight, i1 * weight], [i1 * weight, i0 * weight]])
    size = np.sqrt(np.maximum(fisher.diagonal().real, 1e-300))
    bound = np.linalg.pinv(fisher / np.outer(size, size), hermitian=True).diagonal().real
    deviation = np.sqrt(np.maximum(bound, 0.0)) / size
    noise = np.sqrt(2.0 * _noise(bell_modes.f, residual, rate) / rate)
    d, level = deviation[:n] * noise, deviation[n:] * noise
    return Uncertainty(d / (2.0 * np.pi), d, level)


def _noise(f: Array, residual: Array, rate: float) -> Array:
    """Variance of white noise that is as strong as the residual near each frequency."""
    power = np.abs(np.fft.rfft(residual)) ** 2 / residual.size
    step = rate / residual.size
    neighbours = [
        power[
            max(1, int((frequency - _NOISE_HERTZ) / step)) : int((frequency + _NOISE_HERTZ) / step)
            + 2
        ]
        for frequency in f
    ]
    return np.array([float(powers.mean()) if powers.size else 0.0 for powers in neighbours])
