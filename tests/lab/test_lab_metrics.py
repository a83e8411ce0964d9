"""Measures of the laboratory against closed forms: sinusoids whose difference is known."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from ergon.workshop.lab import energy, metrics, partials
from ergon.workshop.lab.canonical import exact_cell_motion

RATE = 44100.0
T = np.arange(int(2.0 * RATE)) / RATE


def ring(f: float, t60: float, amplitude: float = 1.0, t: np.ndarray = T) -> np.ndarray:
    return amplitude * np.exp(-3.0 * math.log(10.0) * t / t60) * np.sin(2.0 * math.pi * f * t + 0.3)


# --- waveform -----------------------------------------------------------------------------------


def test_waveform_db_of_scaled_sound():
    x = ring(437.0, 0.8)
    x -= x.mean()
    assert metrics.waveform_db(1.01 * x, x) == pytest.approx(-40.0, abs=1e-9)
    assert metrics.waveform_db(x, x) == -math.inf
    assert metrics.waveform_db(x, 0.0 * x) == math.inf


def test_waveform_db_of_worst_channel():
    loud, soft = ring(437.0, 0.8), 1e-3 * ring(300.0, 0.8)
    x = np.stack([loud, soft, 0.0 * soft], axis=1)
    y = np.stack([loud, 1.1 * soft, 0.0 * soft], axis=1)
    assert metrics.waveform_db(y, x) == pytest.approx(-20.0, abs=0.01)
    # Where a thing stands is no sound.
    assert metrics.waveform_db(y + 5.0, x + 5.0) == pytest.approx(-20.0, abs=0.01)


def test_waveform_db_of_detuned_partial():
    """‖y - x‖/‖x‖ ≈ 2πΔf·t_rms with t_rms = √2/(2σ)."""
    cents, f, t60 = 0.1, 437.0, 0.8
    sigma = 3.0 * math.log(10.0) / t60
    expected = 2.0 * math.pi * f * (2.0 ** (cents / 1200.0) - 1.0) * math.sqrt(2.0) / (2.0 * sigma)
    result = metrics.waveform_db(ring(f * 2.0 ** (cents / 1200.0), t60), ring(f, t60))
    assert result == pytest.approx(20.0 * math.log10(expected), abs=0.2)


def test_early_db_from_onset():
    silence = np.zeros(3000)
    x = np.concatenate([silence, ring(437.0, 0.8)])
    y = x.copy()
    y[3000 + int(0.11 * RATE) :] = 0.0  # a fault after the first 0.1 s
    assert metrics.onset_frame(x) == 3000
    assert metrics.early_db(y, x, RATE) == -math.inf
    assert metrics.waveform_db(y, x) > -10.0
    assert metrics.onset_frame(silence) is None


# --- spectra ------------------------------------------------------------------------------------


def test_spectral_metric_ignores_phase_but_not_level():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(20000, 2))
    assert metrics.spectral_difference(-x, x) == metrics.Spectral(0.0, 0.0)
    louder = metrics.spectral_difference(2.0 * x, x)
    assert louder.difference == pytest.approx(20.0 * math.log10(2.0), abs=1e-9)
    assert louder.convergence == pytest.approx(1.0, abs=1e-9)


def test_spectral_metric_of_missing_partial():
    x = ring(437.0, 2.0) + ring(3000.0, 2.0, 0.5)
    result = metrics.spectral_difference(ring(437.0, 2.0), x)
    assert result.difference > 5.0
    assert 0.3 < result.convergence < 0.6  # half the amplitude: 0.45 of the whole


def test_spectral_metric_of_silence_and_short_sounds():
    assert metrics.spectral_difference(np.zeros(100), np.zeros(100)) == metrics.Spectral(0.0, 0.0)
    assert metrics.spectral_difference(np.ones(1), np.ones(1)) == metrics.Spectral(0.0, 0.0)


def test_third_octave_levels_of_sines():
    x = np.sin(2.0 * math.pi * 1000.0 * T) + 0.1 * np.sin(2.0 * math.pi * 100.0 * T)
    centres, level = metrics.third_octaves(x, RATE)
    assert centres[0] == pytest.approx(24.8, abs=0.1)
    assert centres[-1] < 0.45 * RATE
    position = {f: level[np.argmin(np.abs(centres - f))] for f in (100.0, 1000.0, 4000.0)}
    assert position[1000.0] == pytest.approx(-3.0103, abs=1e-3)
    assert position[100.0] == pytest.approx(-23.0103, abs=1e-3)
    assert position[4000.0] < -200.0


def test_bands_db_of_independent_noises():
    rng = np.random.default_rng(4)
    x, other = rng.normal(size=(2, 88200))
    assert metrics.bands_db(-x, x, RATE) == 0.0
    assert metrics.bands_db(2.0 * x, x, RATE) == pytest.approx(6.0206, abs=1e-3)
    # Two seconds of noise have ten independent values in the lowest band, thousands in the highest.
    assert 0.0 < metrics.bands_db(other, x, RATE) < 1.0
    assert metrics.waveform_db(other, x) > 0.0


# --- partials -----------------------------------------------------------------------------------


@pytest.mark.parametrize("f", [110.0, 437.0, 1500.0, 9000.0])
@pytest.mark.parametrize("cents", [1e-3, 1.0, -20.0])
def test_partials_compare_of_detuned_partial(f: float, cents: float):
    x, y = ring(f, 0.8), ring(f * 2.0 ** (cents / 1200.0), 0.8 * 1.07, 0.4)
    result = partials.compare(y, x, 1.002 * f, RATE)
    assert result is not None
    assert result.cents == pytest.approx(cents, abs=1e-4)
    assert result.t60_ratio == pytest.approx(1.07, rel=1e-5)
    assert result.f == pytest.approx(f, abs=1e-4)
    assert result.t60 == pytest.approx(0.8, rel=1e-4)


def test_partials_compare_with_neighbour_and_noise():
    noise = 1e-4 * np.random.default_rng(2).normal(size=len(T))
    x = ring(437.0, 0.8) + ring(655.5, 1.2, 0.5)
    y = ring(437.0 * 2.0 ** (1.0 / 1200.0), 0.84) + ring(656.0, 1.2, 0.5) + noise
    result = partials.compare(y, x, 437.0, RATE)
    assert result is not None
    assert result.cents == pytest.approx(1.0, abs=1e-3)
    assert result.t60_ratio == pytest.approx(1.05, rel=1e-3)


def test_partials_compare_with_second_stroke():
    """Phases begin anew with each stroke: only what rings in between tells the pitch."""
    x, y = ring(437.0, 0.8), ring(437.0 * 2.0 ** (3.0 / 1200.0), 0.8)
    later = int(0.7 * RATE)
    x[later:] += ring(437.0, 0.8, 0.6, T[: len(T) - later] + 1e-4)
    y[later:] += ring(437.0 * 2.0 ** (3.0 / 1200.0), 0.8, 0.6, T[: len(T) - later] + 2e-4)
    result = partials.compare(y, x, 437.0, RATE)
    assert result is not None
    assert result.cents == pytest.approx(3.0, abs=0.01)


def test_partials_compare_of_silence():
    assert partials.compare(ring(437.0, 0.8), np.zeros_like(T), 437.0, RATE) is None
    assert partials.compare(np.zeros_like(T), ring(437.0, 0.8), 437.0, RATE) is None
    assert partials.strongest_partials(np.zeros(1000), RATE) == []


def test_partials_strongest_of_separate_partials():
    x = ring(437.0, 0.8) + ring(880.0, 0.5, 0.5) + ring(895.0, 0.5, 0.1) + ring(1204.0, 1.0, 0.01)
    assert partials.strongest_partials(x, RATE) == pytest.approx([437.0, 880.0, 1204.0], abs=0.01)
    assert partials.strongest_partials(x, RATE, n_max=1) == pytest.approx([437.0], abs=1e-4)


# --- energy -------------------------------------------------------------------------------------


@dataclass
class Books:
    start: float = 1.0
    stored: float = 1.0
    injected: float = 0.0
    lost: float = 0.0
    produced: float = 0.0
    residual: float = 0.0


def test_energy_production_db_of_scheme():
    assert energy.production_db(Books()) == -math.inf
    assert energy.production_db(Books(produced=-0.01)) == pytest.approx(-20.0)
    assert energy.production_db(Books(start=0.0, produced=1.0)) == math.inf


def test_energy_drift_of_one_db_per_second():
    t = [0.1 * i for i in range(20)]
    result = energy.drift(t, [Books(stored=10.0 ** (s / 10.0) - 0.2, lost=0.2) for s in t])
    assert result.db_per_second == pytest.approx(1.0, abs=1e-9)
    assert result.worst_db == pytest.approx(1.9, abs=1e-9)
    assert energy.drift([0.0], [Books()]) == energy.Drift(0.0, 0.0)


# --- the truth of a cell ------------------------------------------------------------------------


@pytest.mark.parametrize(("kappa", "zeta"), [(0.1, 0.0), (0.3, 0.2), (0.04, 0.4), (0.01, 1.0)])
def test_cell_exactly_against_its_equation(kappa: float, zeta: float):
    """ẍ + ζẋ + κx = 0 in units of the step, by differences of a finely sampled solution."""
    fine = 1000
    x = exact_cell_motion(kappa / fine**2, zeta / fine, 3000)[:, 0]
    again = exact_cell_motion(kappa, zeta, 3)[:, 0]
    assert x[::fine] == pytest.approx(again, rel=1e-8)
    curvature = (x[2:] - 2.0 * x[1:-1] + x[:-2]) * fine**2
    slope = 0.5 * (x[2:] - x[:-2]) * fine
    assert np.abs(curvature + zeta * slope + kappa * x[1:-1]).max() < 1e-5 * np.abs(x).max()
