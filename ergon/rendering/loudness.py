"""Integrated loudness at any gain, and true peak (ITU-R BS.1770-4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TRUE_PEAK_MAX = -1.0  # [dBTP] of what is brought to a loudness (EBU R 128)
# Gains found by measurement are multiples of this [dB]: the filters of the meter differ in their
# last bits from machine to machine, and samples must not.
GAIN_STEP = 0.01
_STEPS = 4  # of 100 ms in a block
_GATE = -70.0  # [LUFS] absolute gate: quieter blocks do not count
_RELATIVE = -10.0  # [LU] relative gate, from the mean of the other blocks
_ROUNDS = 50  # of the search for a gain; a few are enough, as gates change little
# The interpolation of BS.1770-4, Annex 2: phases 0 and 1 of four; 3 and 2 are these reversed.
_PHASES = (
    (
        *(0.001708984375, 0.010986328125, -0.0196533203125, 0.033203125),
        *(-0.0594482421875, 0.1373291015625, 0.97216796875, -0.102294921875),
        *(0.047607421875, -0.026611328125, 0.014892578125, -0.00830078125),
    ),
    (
        *(-0.0291748046875, 0.029296875, -0.0517578125, 0.089111328125),
        *(-0.16650390625, 0.465087890625, 0.77978515625, -0.2003173828125),
        *(0.1015625, -0.0582275390625, 0.0330810546875, -0.0189208984375),
    ),
)
_TAPS = len(_PHASES[0])
_SPAN = 64  # frames that are interpolated together, or not at all
_LARGEST = max(sum(map(abs, phase)) for phase in _PHASES)  # of an interpolated value to a sample


class GatedLoudness:
    """The 400 ms blocks of a sound, because which of them pass the gates depends on the gain.

    `blocks` are the levels [LUFS] of the 400 ms that end with each `step` of 100 ms [frames].
    """

    def __init__(self, rate: float, n_channels: int) -> None:
        """Measure frames of `n_channels` at `rate` [Hz], all channels alike."""
        from ergon import _core

        self.step = (int(rate + 0.5) + 5) // 10
        self.blocks: list[float] = []
        self._meter = _core.Meter(rate, n_channels)
        self._measured = 0

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_channels)."""
        import numpy as np

        while len(frames):
            count = min(self.step - self._measured % self.step, len(frames))
            self._meter.process(np.ascontiguousarray(frames[:count]))
            frames = frames[count:]
            self._measured += count
            if self._measured % self.step == 0:
                self.blocks.append(self._meter.momentary)

    def loudness(self, gain: float, first: int = 0, last: int | None = None) -> float:
        """Integrated loudness [LUFS] of the steps `first` to `last` at a gain (a ratio); -inf where
        nothing passes the gates.
        """
        return _gated(self._inside(first, last), 20.0 * math.log10(max(gain, 1e-30)))

    def gain_to(self, target: float) -> float | None:
        """The gain [dB] at which the loudness is `target` [LUFS]; None for silence."""
        import numpy as np

        blocks = self._inside(0, None)
        loudest = float(np.max(blocks, initial=-math.inf))
        if loudest == -math.inf:
            return None
        gain = target - loudest  # at least one block passes the gates
        for _ in range(_ROUNDS):
            change = target - _gated(blocks, gain)
            gain += change
            if abs(change) < GAIN_STEP / 100:
                break
        return gain

    def _inside(self, first: int, last: int | None) -> NDArray[np.float64]:
        """The blocks that lie between two steps: the first of them ends 400 ms after `first`."""
        import numpy as np

        return np.array(self.blocks[first + _STEPS - 1 : last])


class TruePeak:
    """The largest absolute value of a sound between its samples: at four times its rate."""

    def __init__(self, n_channels: int) -> None:
        """Measure frames of `n_channels`; before the first there is silence."""
        import numpy as np

        self.peak = 0.0
        self._past = np.zeros((_TAPS - 1, n_channels))

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_channels)."""
        import numpy as np

        if not len(frames):
            return
        joined = np.concatenate([self._past, frames])
        self._past = joined[-(_TAPS - 1) :].copy()
        n_channels = frames.shape[1]
        magnitudes = np.abs(joined).reshape(-1)
        largest = float(np.max(magnitudes, initial=0.0))
        new_magnitudes = magnitudes[(_TAPS - 1) * n_channels :]
        self.peak = max(self.peak, float(np.max(new_magnitudes, initial=0.0)))
        if largest * _LARGEST <= self.peak or not math.isfinite(largest):
            return
        # Only near samples that are loud enough may there be a larger value.
        largest_of = np.maximum.reduceat(
            magnitudes, np.arange(0, len(magnitudes), _SPAN * n_channels)
        )
        is_loud = largest_of * _LARGEST > self.peak
        n_spans = len(frames) // _SPAN
        loud = np.flatnonzero(is_loud[:n_spans] | is_loud[1 : n_spans + 1])
        sounds = [joined[None]]
        if 2 * len(loud) < n_spans:
            rows = loud[:, None] * _SPAN + np.arange(_SPAN + _TAPS - 1)
            sounds = [joined[rows], joined[None, n_spans * _SPAN :]]
        self.peak = max(self.peak, *map(_largest_between, sounds))


def _largest_between(sounds: NDArray[np.float64]) -> float:
    """The largest absolute value between samples of sounds (n_sounds, n_frames + 11, n_channels),
    the first 11 of which are past.
    """
    import numpy as np

    n_frames, largest = sounds.shape[1] - (_TAPS - 1), 0.0
    for phase in (*_PHASES, *(phase[::-1] for phase in _PHASES)):
        between = np.zeros((len(sounds), n_frames, sounds.shape[2]))
        for tap, factor in enumerate(phase):
            between += factor * sounds[:, tap : tap + n_frames]
        largest = max(largest, float(np.max(np.abs(between), initial=0.0)))
    return largest


def gain_to_peak(true_peak: float) -> float:
    """The gain (a ratio) that brings a true peak above 0 to `TRUE_PEAK_MAX`, or just below."""
    from ergon import _core

    highest = TRUE_PEAK_MAX - 20.0 * math.log10(true_peak)
    return _core.decibels(math.floor(highest / GAIN_STEP) * GAIN_STEP)


def _gated(blocks: NDArray[np.float64], decibels: float) -> float:
    """The level [LUFS] of those `blocks` that pass both gates when they are so much louder."""
    louder = blocks + decibels
    louder = louder[louder > _GATE]
    if len(louder):
        louder = louder[louder > _mean(louder) + _RELATIVE]
    return _mean(louder) if len(louder) else -math.inf


def _mean(blocks: NDArray[np.float64]) -> float:
    """The level of the mean power of blocks."""
    import numpy as np

    return float(10.0 * np.log10(np.mean(10.0 ** (blocks / 10.0))))
