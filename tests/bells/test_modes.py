"""Modes of synthetic strokes, beside the truth and beside the bound of Cramér and Rao."""

import warnings

import numpy as np
import pytest
from struck import RATE, church, matched, others
from sweep import few

from ergon.workshop.bells.modes import find_modes, mode_uncertainty

DURATION = 6.0


def analysed(struck, noise_db, seed, duration=DURATION):
    clean = struck.sound(duration)
    deviation = np.abs(clean).max() * 10 ** (noise_db / 20)
    sound = clean + deviation * np.random.default_rng(seed).standard_normal(clean.size)
    modes, rest = find_modes(sound, RATE)
    output = mode_uncertainty(modes, rest, RATE)
    return modes, output, deviation, clean.size


@pytest.mark.parametrize("name", few(sorted(others()), ["bowl"]))
def test_bell_modes_and_beats_of_other_bells(name):
    struck = others()[name]
    modes, output, *_ = analysed(struck, -60, 3)
    pairs = matched(modes.frequencies, struck.f)
    assert (len(pairs), len(modes.frequencies)) == (len(struck.f), len(struck.f))
    true, item = (np.array(column) for column in zip(*pairs, strict=True))
    cents = 1200 * np.abs(np.log2(modes.frequencies[item] / struck.f[true]))
    assert cents.max() < 0.05
    assert np.abs(struck.d[true] / modes.decays[item] - 1).max() < 0.05
    assert np.abs(np.abs(modes.amplitudes[item]) / struck.a[true] - 1).max() < 0.1
    assert np.all(np.abs(modes.frequencies[item] - struck.f[true]) < 6 * output.frequencies[item])


@pytest.mark.slow
def test_bell_mode_deviations_equal_cramer_rao_bound():
    struck = church()
    modes, output, deviation, n = analysed(struck, -60, 0)
    bound = struck.bound(n, deviation)
    true, item = (
        np.array(column) for column in zip(*matched(modes.frequencies, struck.f), strict=True)
    )
    assert output.frequencies[item] == pytest.approx(bound[true, 0], rel=0.25)
    assert output.decays[item] == pytest.approx(bound[true, 1], rel=0.25)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "outcome", "spurious", "cents", "t60", "ratio"),
    [
        (-80, 1.0, 0.0, (1.2e-4, 0.0015), (1e-4, 0.0017), 1.7),
        (-60, 1.0, 0.0, (7e-4, 0.012), (6e-4, 0.014), 1.1),
        (-40, 0.91, 0.0, (0.004, 1.0), (0.005, 0.64), 1.2),
    ],
)
def test_modes_of_church_bell_in_noise(noise, outcome, spurious, cents, t60, ratio):
    """Eight takes; each figure within 1.2 times what was measured when the method was chosen."""
    struck = church()
    seeds = 8
    f, d = (np.full((seeds, struck.f.size), np.nan) for _ in "fd")
    more = 0
    for seed in range(seeds):
        modes, _, deviation, n = analysed(struck, noise, seed)
        pairs = matched(modes.frequencies, struck.f)
        more += len(modes.frequencies) - len(pairs)
        for true, item in pairs:
            f[seed, true] = modes.frequencies[item] - struck.f[true]
            d[seed, true] = modes.decays[item] - struck.d[true]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a mode may be found in no take
        off_f, off_d = (np.sqrt(np.nanmean(x**2, axis=0)) for x in (f, d))
    bound = struck.bound(n, deviation)
    in_cents, in_t60 = 1731.234 * off_f / struck.f, off_d / struck.d
    text = (
        np.mean(np.isfinite(f)),
        more / seeds,
        (np.nanmedian(in_cents), np.nanmax(in_cents)),
        (np.nanmedian(in_t60), np.nanmax(in_t60)),
        (np.nanmedian(off_f / bound[:, 0]), np.nanmedian(off_d / bound[:, 1])),
    )
    print(noise, text)
    assert text[0] >= outcome / (1.0 if outcome == 1.0 else 1.2)
    assert text[1] <= spurious
    assert np.all(np.array(text[2]) <= 1.2 * np.array(cents))
    assert np.all(np.array(text[3]) <= 1.2 * np.array(t60))
    assert np.all(np.array(text[4]) <= 1.2 * ratio)
