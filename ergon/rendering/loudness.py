"""Integrated loudness at any gain, and the gain to a true peak (ITU-R BS.1770-4)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

TRUE_PEAK_DB_MAX = -1.0  # [dBTP] of what is brought to a loudness (EBU R 128)
# Gains found by measurement are multiples of this [dB]: the filters of the meter differ in their
# last bits from machine to machine, and samples must not.
GAIN_STEP_DB = 0.01
_STEPS_PER_BLOCK = 4  # steps of 100 ms in a block
_ABSOLUTE_GATE_LUFS = -70.0  # [LUFS] absolute gate: quieter blocks do not count
_RELATIVE_GATE_LU = -10.0  # [LU] relative gate, from the mean of the other blocks
_GAIN_ROUNDS_MAX = 50  # rounds of the search for a gain; a few are usually enough


class GatedLoudness:
    """The 400 ms blocks of a sound, because which of them pass the gates depends on the gain.

    `block_levels` are the levels [LUFS] of the 400 ms that end with each `step_frames` of 100 ms
    [frames].
    """

    def __init__(self, rate: float, n_channels: int) -> None:
        """Measure frames of `n_channels` at `rate` [Hz], all channels alike."""
        from ergon import _core

        self.step_frames = (int(rate + 0.5) + 5) // 10
        self.block_levels: list[float] = []
        self._meter = _core.Meter(rate, n_channels)
        self._n_measured = 0

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_channels)."""
        import numpy as np

        while len(frames):
            frame_count = min(self.step_frames - self._n_measured % self.step_frames, len(frames))
            self._meter.process(np.ascontiguousarray(frames[:frame_count]))
            frames = frames[frame_count:]
            self._n_measured += frame_count
            if self._n_measured % self.step_frames == 0:
                self.block_levels.append(self._meter.momentary)

    def loudness(self, gain: float, first_step: int = 0, end_step: int | None = None) -> float:
        """Integrated loudness [LUFS] of the steps `first_step` to `end_step` at a gain (a ratio);
        -inf where nothing passes the gates.
        """
        return _gated_level(
            self._blocks_within(first_step, end_step), 20.0 * math.log10(max(gain, 1e-30))
        )

    def gain_to(self, target_lufs: float) -> float | None:
        """The gain [dB] at which the loudness is `target_lufs` [LUFS]; None for silence."""
        import numpy as np

        gated_blocks = self._blocks_within(0, None)
        block_max = float(np.max(gated_blocks, initial=-math.inf))
        if block_max == -math.inf:
            return None
        gain_db = target_lufs - block_max  # at least one block passes the gates
        for _ in range(_GAIN_ROUNDS_MAX):
            gain_change = target_lufs - _gated_level(gated_blocks, gain_db)
            gain_db += gain_change
            if abs(gain_change) < GAIN_STEP_DB / 100:
                break
        return gain_db

    def _blocks_within(self, first_step: int, end_step: int | None) -> NDArray[np.float64]:
        """The blocks between two steps: the first of them ends 400 ms after `first_step`."""
        import numpy as np

        return np.array(self.block_levels[first_step + _STEPS_PER_BLOCK - 1 : end_step])


def gain_to_peak(true_peak: float) -> float:
    """The gain (a ratio) that brings a true peak above 0 to `TRUE_PEAK_DB_MAX`, or just below."""
    from ergon import _core

    gain_db_max = TRUE_PEAK_DB_MAX - 20.0 * math.log10(true_peak)
    return _core.decibels(math.floor(gain_db_max / GAIN_STEP_DB) * GAIN_STEP_DB)


def _gated_level(blocks: NDArray[np.float64], gain_db: float) -> float:
    """The level [LUFS] of those `blocks` that pass both gates after a gain."""
    amplified_blocks = blocks + gain_db
    amplified_blocks = amplified_blocks[amplified_blocks > _ABSOLUTE_GATE_LUFS]
    if len(amplified_blocks):
        amplified_blocks = amplified_blocks[
            amplified_blocks > _mean_level(amplified_blocks) + _RELATIVE_GATE_LU
        ]
    return _mean_level(amplified_blocks) if len(amplified_blocks) else -math.inf


def _mean_level(blocks: NDArray[np.float64]) -> float:
    """The level of the mean power of blocks."""
    import numpy as np

    return float(10.0 * np.log10(np.mean(10.0 ** (blocks / 10.0))))
