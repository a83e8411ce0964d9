"""Pink noise that identifies loudspeakers: the same samples on every machine."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

from ergon import _core

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_FADE = 0.02  # [s] of fade at either end
# Three poles and a constant make -3 dB an octave within 0.5 dB above 9 Hz at 44.1 kHz (P. Kellet,
# "Filter to make pink noise from white", music-dsp, 1999).
_POLES = ((0.99765, 0.0990460), (0.96300, 0.2965164), (0.57000, 1.0526913))
_WHITE_GAIN = 0.1848


def pink_noise_burst(burst_seconds: float, rate: float, burst_level: float) -> NDArray[np.float64]:
    """Pink noise of an rms level [ratio of full scale], faded in and out, (n_frames,)."""
    import numpy as np

    n_frames = max(1, int(burst_seconds * rate))
    random_generator = _core.Chance(1, "noise", "loudspeaker", 0, 0)
    states = [0.0] * len(_POLES)
    burst = np.zeros(n_frames)
    for i in range(n_frames):
        white = random_generator.uniform(-1.0, 1.0)
        pink_sample = white * _WHITE_GAIN
        for k, (pole, gain) in enumerate(_POLES):
            states[k] = pole * states[k] + white * gain
            pink_sample += states[k]
        burst[i] = pink_sample
    power = 0.0
    for value in burst.tolist():
        power += value * value
    burst *= burst_level / (power / n_frames) ** 0.5 if power else 0.0
    n_fade = min(n_frames // 2, int(_FADE * rate))
    for i in range(n_fade):
        fade_gain = 0.5 - 0.5 * _core.cos(pi * i / n_fade)
        burst[i] *= fade_gain
        burst[n_frames - 1 - i] *= fade_gain
    return burst
