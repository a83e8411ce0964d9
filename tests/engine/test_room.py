"""A room's impulse response beside what was asked of it."""

from itertools import product

import numpy as np
import pytest
from sweep import few

from ergon._core import EngineError, Mixer

RATE = 44100.0


def response(
    t60: tuple[tuple[float, float], tuple[float, float]],
    size: float = 12.0,
    seconds: float = 4.0,
    n_channels: int = 1,
    block: int = 4096,
) -> np.ndarray:
    mixer = Mixer(RATE, 1, n_channels)
    room = mixer.room("hall", range(n_channels), size=size, t60=t60)
    mixer.route(0, room, to_room=True)
    click = np.zeros((int(seconds * RATE), 1))
    click[0] = 1.0
    listened = np.zeros((len(click), n_channels))
    for index in range(0, len(click), block):
        mixer.process(click[index : index + block], listened[index : index + block])
    return listened


def decay(sound: np.ndarray, f: float) -> float:
    """T60 [s] near a frequency, of all channels: Schroeder's integral from -5 dB to -35 dB."""
    n = 1 << (2 * len(sound) - 1).bit_length()
    bins = np.fft.rfftfreq(n, 1 / RATE)
    shape = np.exp(-0.5 * ((bins - f) / (0.1 * f)) ** 2)[:, None]
    spectrum = np.fft.rfft(sound, n, axis=0)
    band = np.fft.irfft(spectrum * shape, n, axis=0)[: len(sound)]
    energy = (band**2).sum(axis=1)
    level = 10 * np.log10(np.cumsum(energy[::-1])[::-1])
    level -= level[0]
    first, last = np.argmax(level < -5), np.argmax(level < -35)
    return -60.0 / np.polyfit(np.arange(first, last) / RATE, level[first:last], 1)[0]


@pytest.mark.parametrize(
    ("t60", "size"),
    few(
        product(
            [
                ((200.0, 2.0), (6_000.0, 2.0)),
                ((200.0, 2.4), (6_000.0, 0.8)),
                ((125.0, 1.2), (8_000.0, 0.6)),
                ((300.0, 1.0), (5_000.0, 1.6)),
            ],
            [4.0, 12.0, 35.0],
        ),
        1,
    ),
)
def test_room_decay_time_by_frequency(t60, size):
    sound = response(t60, size, n_channels=15)
    for f, wanted in t60:
        assert decay(sound, f) == pytest.approx(wanted, rel=0.05), f


@pytest.mark.slow
def test_room_decay_between_and_beyond_two_frequencies():
    (low, long), (high, short) = t60 = (200.0, 2.4), (6_000.0, 0.8)
    sound = response(t60, n_channels=15)

    def share(f):
        return np.tan(np.pi * f / RATE) ** 2 / (
            np.tan(np.pi * f / RATE) ** 2 + np.tan(np.pi * low / RATE) * np.tan(np.pi * high / RATE)
        )

    slope = (1 / short - 1 / long) / (share(high) - share(low))
    for f in (500.0, 1_000.0, 3_000.0, 12_000.0):
        wanted = 1 / (1 / long + slope * (share(f) - share(low)))
        assert decay(sound, f) == pytest.approx(wanted, rel=0.06), f


@pytest.mark.parametrize("t60", [0.5, 3.0])
def test_room_click_energy_in_each_channel(t60):
    sound = response(((200.0, t60), (6_000.0, t60)), n_channels=24, seconds=2 * t60)
    energies = 10 * np.log10((sound**2).sum(axis=0))
    assert np.abs(energies).max() < 2.0


def test_room_channels_with_uncorrelated_echoes():
    sound = response(((200.0, 2.0), (6_000.0, 1.0)), n_channels=4)
    unit = sound / np.linalg.norm(sound, axis=0)
    assert np.abs(unit.T @ unit - np.eye(4)).max() < 0.2


def test_room_bytes_with_any_block_size():
    t60 = ((200.0, 2.0), (6_000.0, 1.0))
    complete = response(t60, seconds=0.5, n_channels=2)
    for block in (1, 44, 333):
        assert np.array_equal(response(t60, seconds=0.5, n_channels=2, block=block), complete)


def test_room_refuses_impossible_decays_and_channels():
    with pytest.raises(EngineError, match="are impossible at these frequencies"):
        Mixer(RATE, 1, 1).room("hall", [0], size=12.0, t60=((200.0, 9.0), (400.0, 0.2)))
    with pytest.raises(EngineError, match="there is no channel 1"):
        Mixer(RATE, 1, 1).room("hall", [1], size=12.0, t60=((200.0, 2.0), (4e3, 1.0)))
    with pytest.raises(EngineError, match="there is no room 0"):
        Mixer(RATE, 1, 1).route(0, 0, to_room=True)
