"""Integrated loudness by the formulas of ITU-R BS.1770-4 alone."""

import math

import numpy as np
from scipy.signal import lfilter

RATE = 48_000
# BS.1770-4, tables 1 and 2, for 48 kHz: the shelf of a head, and a high-pass.
SHELF = (
    (1.53512485958697, -2.69169618940638, 1.19839281085285),
    (*(1.0, -1.69065929318241, 0.73248077421585),),
)
HIGHPASS = (1.0, -2.0, 1.0), (1.0, -1.99004745483398, 0.99007225036621)


def integrated(sound: np.ndarray) -> float:
    """Loudness [LUFS] of (n_frames, n_channels) at 48 kHz, channels alike: BS.1770-4, eqs 1-7."""
    weighted = lfilter(*HIGHPASS, lfilter(*SHELF, sound, axis=0), axis=0)
    size, step = 4 * RATE // 10, RATE // 10
    starts = range(0, len(sound) - size + 1, step)
    power = np.array([(weighted[n : n + size] ** 2).mean(axis=0).sum() for n in starts])
    above = power[-0.691 + 10 * np.log10(power) > -70]
    gate = -0.691 + 10 * np.log10(above.mean()) - 10
    return -0.691 + 10 * math.log10(above[-0.691 + 10 * np.log10(above) > gate].mean())
