"""How loud each instrument is in a mix, once the gain of the whole file is known."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .loudness import GatedLoudness

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .staged import Mixer

DOMINANCE_LU = 20.0  # [LU] by which one instrument hides all others
MEASURED_OUTPUTS_MAX = (
    256  # instruments times channels: beyond that measuring costs more than mixing
)
_PEAKS_PER_MEASURE = 10  # true peaks in a step of 100 ms
_LENGTH_FORMAT = struct.Struct("<Q")


@dataclass(frozen=True, slots=True)
class InstrumentLevel:
    """The peak of one instrument as a ratio, and its integrated loudness [LUFS], in the file."""

    name: str
    peak: float
    loudness: float


class Balance:
    """Measures the level of one instrument by itself, before the limiter.

    It is measured every 100 ms of the piece, whatever part of it is in the file, so that what an
    earlier render measured is known in this one. Peaks are those of 10 ms each.
    """

    def __init__(
        self,
        name: str,
        mixer: Mixer,
        rate: float,
        n_channels: int,
        start: int,
        stop: int,
        unit: float = 1.0,
    ) -> None:
        """Measure frames `start` to `stop`, counted from 0 at the first frame that `take`
        receives; what `mixer` gives is in units of `unit`.
        """
        import numpy as np

        from ergon import _core

        self._name, self._mixer = name, mixer
        self._loudness = GatedLoudness(rate, n_channels)
        self._levels = _core.LevelSteps(rate, n_channels)
        self._recalled: NDArray[np.float64] | None = None
        self._n_channels, self._unit = n_channels, unit
        self._start, self._stop = start, stop
        self._mix_buffer: NDArray[np.float64] = np.empty((0, n_channels))

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_out)."""
        import numpy as np

        if len(self._mix_buffer) < len(frames):
            self._mix_buffer = np.empty((len(frames), self._n_channels))
        mixed = self._mix_buffer[: len(frames)]
        self._mixer.process(frames, mixed)
        self._levels.process(mixed)

    def state(self) -> bytes | None:
        """What later measures depend on, besides the frames; None if the mixer has none."""
        state = self._mixer.state()
        return (
            None
            if state is None
            else _LENGTH_FORMAT.pack(len(state)) + state + self._levels.state()
        )

    def resume(self, measured: NDArray[np.float64], state: bytes) -> None:
        """Go on after frames of which another balance has `measured` all, in this `state` after
        them. Raises EngineError.
        """
        (n_bytes,) = _LENGTH_FORMAT.unpack_from(state)
        self._mixer.set_state(state[_LENGTH_FORMAT.size : _LENGTH_FORMAT.size + n_bytes])
        self._levels.set_state(state[_LENGTH_FORMAT.size + n_bytes :], measured.reshape(-1))

    @property
    def n_measures(self) -> int:
        """How many numbers are measured of each 100 ms."""
        return 1 + _PEAKS_PER_MEASURE

    @property
    def measured(self) -> NDArray[np.float64]:
        """What was measured of each 100 ms (n_steps, 1 + 10): the level of the last 400 ms [LUFS],
        and peaks as ratios.
        """
        if self._recalled is not None:
            return self._recalled
        return self._levels.measured.reshape(-1, 1 + _PEAKS_PER_MEASURE)

    def recall(self, measured: NDArray[np.float64], stop: int) -> bool:
        """Take what an earlier render measured, in place of frames up to `stop`; False if it is too
        short.
        """
        if len(measured) < min(stop, self._stop) // self._loudness.step_frames:
            return False
        self._recalled = measured
        return True

    def level(self, gain: float, stop: int | None = None) -> InstrumentLevel:
        """The level in a file that has this gain (a ratio), and may end sooner, at `stop`."""
        import numpy as np

        gain *= self._unit
        stop = self._stop if stop is None else stop
        loudness_step, measured = self._loudness.step_frames, self.measured
        self._loudness.block_levels = measured[:, 0].tolist()
        loudness = self._loudness.loudness(
            gain, -(-self._start // loudness_step), stop // loudness_step
        )
        peak_indices = np.arange(len(measured) * _PEAKS_PER_MEASURE)
        peak_starts = (
            peak_indices // _PEAKS_PER_MEASURE * loudness_step
            + peak_indices % _PEAKS_PER_MEASURE * loudness_step // _PEAKS_PER_MEASURE
        )
        is_inside = (peak_starts >= self._start) & (
            peak_starts + loudness_step // _PEAKS_PER_MEASURE < stop
        )
        peaks = measured[:, 1:].reshape(-1)[is_inside]
        return InstrumentLevel(self._name, float(np.max(peaks, initial=0.0)) * gain, loudness)


def dominant_instrument(levels: Sequence[InstrumentLevel]) -> tuple[InstrumentLevel, float] | None:
    """The instrument that hides all others, and how much louder it is than the second [LU]; or
    None.
    """
    audible = sorted(
        (level for level in levels if level.loudness > -math.inf), key=lambda level: level.loudness
    )
    if len(audible) < 2:
        return None
    loudest_level = audible[-1]
    loudness_above = loudest_level.loudness - audible[-2].loudness
    return (loudest_level, loudness_above) if loudness_above > DOMINANCE_LU else None
