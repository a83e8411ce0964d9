"""The gain that a master finds by measuring a whole piece."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .loudness import GAIN_STEP_DB, GatedLoudness, gain_to_peak

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .level import Level


class MeasuredLevel:
    """Finds the gain that brings a whole piece to the peak or the loudness of a `Level`."""

    def __init__(self, level: Level, rate: float, n_channels: int) -> None:
        """Measure frames of `n_channels` at `rate` [Hz]."""
        from ergon import _core

        self._level = level
        self._true_peak = _core.TruePeak(n_channels)
        self._loudness = None if level.loudness is None else GatedLoudness(rate, n_channels)
        self._peak = 0.0

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_channels)."""
        import numpy as np

        self._peak = max(self._peak, float(np.max(np.abs(frames), initial=0.0)))
        if self._loudness is not None:
            self._loudness.take(frames)
            self._true_peak.process(np.ascontiguousarray(frames))

    def gain_of_peak(self, peak: float) -> float:
        """The gain (a ratio) of a piece with this peak, without a loudness; 1 for silence."""
        return 1.0 if peak == 0.0 else (self._level.normalise or 1.0) / peak

    def gain(self) -> float:
        """The gain (a ratio); 1 for silence.

        A loudness is reached unless peaks would pass -1 dBTP with no limiter after them; a sound
        without a loudness, because it is short, is brought there.
        """
        from ergon import _core

        wanted_level = self._level
        if wanted_level.loudness is None or self._loudness is None or self._peak == 0.0:
            return self.gain_of_peak(self._peak)
        peak_gain = gain_to_peak(self._true_peak.peak)
        gain_db = self._loudness.gain_to(wanted_level.loudness)
        if gain_db is None:
            return peak_gain
        gain = _core.decibels(round(gain_db / GAIN_STEP_DB) * GAIN_STEP_DB)
        return gain if wanted_level.limit is not None else min(gain, peak_gain)
