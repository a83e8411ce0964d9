"""The level of each instrument beside that of a file which holds it alone."""

import numpy as np
import pytest

from ergon._core import Meter, Mixer
from ergon.rendering.balance import Balance, InstrumentLevel, dominant_instrument

RATE = 44_100


def frames(n: int) -> np.ndarray:
    """Two outputs: a tone that fades, and one that comes late."""
    t = np.arange(n) / RATE
    first = 1e-3 * np.sin(2 * np.pi * 440 * t) * np.exp(-t)
    two = np.where(t > 3, 4e-4 * np.sin(2 * np.pi * 1234 * t), 0)
    return np.column_stack([first, two])


def mixer(out: int) -> Mixer:
    single = Mixer(RATE, 2, 2)
    single.route(out, 0, 0.5)
    single.route(out, 1, 1.0)
    return single


@pytest.mark.parametrize("out", [0, 1])
@pytest.mark.parametrize("block", [100, 4096])
@pytest.mark.parametrize("gain", [1.0, 30.0, 400.0])
def test_balance_equals_a_meter_after_the_gain(out, block, gain):
    """The gates of BS.1770 are absolute: they are applied when the gain is known."""
    sound, start, stop = frames(6 * RATE), RATE // 2, 5 * RATE + 777
    balance = Balance("bell", mixer(out), RATE, 2, start, stop)
    for index in range(0, len(sound), block):
        balance.take(sound[index : index + block])
    mixed = np.zeros_like(sound)
    mixer(out).process(sound, mixed)
    meter = Meter(RATE, 2)
    meter.process(np.ascontiguousarray(mixed[start:stop] * gain))
    result = balance.level(gain)
    assert result.peak == pytest.approx(meter.peak, rel=1e-12)
    assert result.loudness == pytest.approx(meter.loudness, abs=0.02)


def test_balance_level_of_silence():
    balance = Balance("bell", mixer(0), RATE, 2, 0, RATE)
    balance.take(np.zeros((RATE, 2)))
    assert (balance.level(3.0).peak, balance.level(3.0).loudness) == (0.0, -np.inf)


@pytest.mark.parametrize(
    ("levels", "loudest"),
    [
        ([-30.0, -51.0, -60.0], 0),
        ([-30.0, -49.0, -60.0], None),
        ([-60.0, -20.0, -np.inf], 1),
        ([-60.0, -np.inf], None),
        ([], None),
    ],
)
def test_balance_dominant_instrument_by_levels(levels: list[float], loudest: int | None):
    each = [InstrumentLevel(f"i{at}", 0.1, level) for at, level in enumerate(levels)]
    result = dominant_instrument(each)
    if loudest is None:
        assert result is None
    else:
        assert result is not None
        assert result[0] is each[loudest]
        assert result[1] == pytest.approx(levels[loudest] - sorted(levels)[-2])
