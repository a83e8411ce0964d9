"""The head that ships, and one from a file: delays, levels, spectra, other rates."""

from pathlib import Path

import numpy as np
import pytest
from domes import dome
from sweep import few

from ergon.space import head
from ergon.space.directions import point, spread_directions, unit_vectors

ARRAY = unit_vectors(dome())


def spectrum(filters: np.ndarray, rate: float, frequency: float) -> np.ndarray:
    """Magnitudes at one frequency, (n, 2)."""
    n = np.arange(filters.shape[2])
    return np.abs(filters @ np.exp(-2j * np.pi * frequency * n / rate))


def apart(pair: np.ndarray, rate: float) -> float:
    """How much later the right ear hears than the left below 1.5 kHz [µs]."""
    size, finer = 1 << 13, 16
    left, right = np.fft.rfft(pair, size)
    low = np.fft.rfftfreq(size, 1.0 / rate) < 1500.0
    match = np.fft.fftshift(np.fft.irfft(right * np.conj(left) * low, size * finer))
    return 1e6 * (int(np.argmax(match)) - size * finer // 2) / (rate * finer)


def test_head_delays_and_levels_at_sides():
    """A KEMAR at 90°: 700 µs and 12 dB at 44.1 kHz, by its measured responses."""
    pairs = head.kemar().pairs(ARRAY, 44_100.0)
    power = (pairs**2).sum(2)
    levels = 10.0 * np.log10(power[:, 0] / power[:, 1])
    assert 680.0 < apart(pairs[3], 44_100.0) < 780.0
    assert 10.0 < levels[3] < 16.0
    assert abs(apart(pairs[0], 44_100.0)) < 1.0
    assert abs(levels[0]) < 0.01


def test_head_filters_mirror_symmetry():
    pairs = head.kemar().pairs(ARRAY, 48_000.0)
    mirrored = [int(np.argmax(ARRAY @ (one * [-1, 1, 1]))) for one in ARRAY]
    np.testing.assert_allclose(pairs[mirrored][:, ::-1], pairs, atol=2e-3)


def test_head_filters_diffuse_field_flat():
    """Equalised to a diffuse field: ±2 dB from 50 Hz to 12 kHz over all directions."""
    pairs = head.kemar().pairs(ARRAY, 48_000.0)
    for frequency in (50.0, 100.0, 500.0, 2_000.0, 8_000.0, 12_000.0):
        mean = 10.0 * np.log10((spectrum(pairs, 48_000.0, frequency) ** 2).mean())
        assert abs(mean) < 2.0, frequency


@pytest.mark.parametrize("rate", few([22_050.0, 48_000.0, 96_000.0], 1))
def test_head_filters_same_at_other_rates(rate: float):
    item, other = (head.kemar().pairs(ARRAY, r) for r in (44_100.0, rate))
    for frequency in (200.0, 1_000.0, 5_000.0):
        ratio = spectrum(item, 44_100.0, frequency) / spectrum(other, rate, frequency)
        np.testing.assert_allclose(20.0 * np.log10(ratio), 0.0, atol=0.1)
    np.testing.assert_allclose(apart(other[3], rate), apart(item[3], 44_100.0), atol=5.0)


def test_head_filters_between_directions_panned():
    """As loud as its neighbours, and between their delays."""
    pairs = head.kemar().pairs(unit_vectors((point(75.0, 0.0, 1.0),)), 44_100.0)
    low, high = (apart(one, 44_100.0) for one in head.kemar().pairs(ARRAY, 44_100.0)[2:4])
    assert low < apart(pairs[0], 44_100.0) < high


def sphere(count: int = 400, rate: float = 48_000.0) -> tuple[np.ndarray, np.ndarray]:
    """A made-up head: ears that hear later and softer on the far side, both with one resonance."""
    directions = spread_directions(count)
    n = np.arange(256)
    frequency = np.fft.rfftfreq(512, 1.0 / rate)
    responses = []
    for x, _, _ in directions:
        pair = []
        for side in (-1.0, 1.0):
            late = (40.0 - 10.0 * side * x) / rate
            colour = (1.0 + 0.5 * side * x) * (1.0 + np.exp(-(((frequency - 3e3) / 800) ** 2)))
            response = np.fft.irfft(colour * np.exp(-2j * np.pi * frequency * late), 512)[:256]
            pair.append(response * (n < 200))
        responses.append(pair)
    return directions, np.array(responses)


def test_head_filters_of_synthetic_sphere():
    """Delays to a twentieth of a sample, levels to 0.3 dB; what all directions share is gone."""
    rate = 48_000.0
    directions, responses = sphere(rate=rate)
    wanted = directions[[5, 50, 200, 333]]
    result = head.prepared(directions, responses, rate, wanted)
    late = (result.delays[:, 1] - result.delays[:, 0]) * rate
    np.testing.assert_allclose(late, -20.0 * wanted[:, 0], atol=0.07)
    sides = spectrum(result.filters, rate, 3_000.0)
    ratio = (1.0 + 0.5 * wanted[:, 0]) / (1.0 - 0.5 * wanted[:, 0])
    np.testing.assert_allclose(20 * np.log10(sides[:, 1] / sides[:, 0] / ratio), 0.0, atol=0.3)
    flat = spectrum(result.filters, rate, 6_000.0) / sides
    np.testing.assert_allclose(20 * np.log10(flat), 0.0, atol=1.0)


def test_head_delay_field_equals_delay_in_response():
    """AES69 lets a file say the same sound both ways."""
    directions, responses = sphere(rate=48_000.0)
    wanted = directions[[5, 50, 200, 333]]
    within = head.prepared(directions, responses, 48_000.0, wanted)
    samples = np.stack([10 - 5 * directions[:, 0], 10 + 5 * directions[:, 0]], axis=1).round()
    early = np.array(
        [
            [np.roll(h, -int(late)) for h, late in zip(pair, lates, strict=True)]
            for pair, lates in zip(responses, samples, strict=True)
        ]
    )
    beside = head.prepared(directions, early, 48_000.0, wanted, samples / 48_000.0)
    np.testing.assert_allclose(beside.delays, within.delays, atol=1e-9)
    np.testing.assert_allclose(beside.filters, within.filters, atol=0.03)


def test_head_file_credits_and_shape():
    text = Path(head.KEMAR_PATH).read_text(encoding="utf-8")
    assert "Bill Gardner and Keith Martin" in text
    assert "Copyright 1994 by the MIT Media Laboratory" in text
    assert head.kemar().filters.shape == (24, 2, head.TAPS)
    np.testing.assert_allclose(head.kemar().directions, ARRAY, atol=1e-12)
