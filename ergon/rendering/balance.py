"""How loud each instrument is in a mix, once the gain of the whole file is known."""

from __future__ import annotations

import math
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
_PEAKS = 10  # in a step of 100 ms


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

        self._name, self._mixer = name, mixer
        self._loudness = GatedLoudness(rate, n_channels)
        self._n_channels, self._unit = n_channels, unit
        self._start, self._stop = start, stop
        self._step: NDArray[np.float64] = np.empty((self._loudness.step, n_channels))
        self._n_pending = 0  # frames in `_step`
        self._peaks: list[NDArray[np.float64]] = []

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_out)."""
        import numpy as np

        mixed = np.empty((len(frames), self._n_channels))
        self._mixer.process(frames, mixed)
        while len(mixed):
            place = self._step[self._n_pending : self._n_pending + len(mixed)]
            place[:] = mixed[: len(place)]
            mixed = mixed[len(place) :]
            self._n_pending += len(place)
            if self._n_pending == len(self._step):
                self._measure()
                self._n_pending = 0

    def _measure(self) -> None:
        import numpy as np

        self._loudness.take(self._step)
        edges = np.arange(_PEAKS) * len(self._step) // _PEAKS * self._n_channels
        self._peaks.append(np.maximum.reduceat(np.abs(self._step).reshape(-1), edges))

    @property
    def n_measures(self) -> int:
        """How many numbers are measured of each 100 ms."""
        return 1 + _PEAKS

    @property
    def measured(self) -> NDArray[np.float64]:
        """What was measured of each 100 ms (n_steps, 1 + 10): the level of the last 400 ms [LUFS],
        and peaks as ratios.
        """
        import numpy as np

        if not self._peaks:
            return np.zeros((0, 1 + _PEAKS))
        return np.column_stack([np.array(self._loudness.blocks), np.array(self._peaks)])

    def recall(self, measured: NDArray[np.float64], stop: int) -> bool:
        """Take what an earlier render measured, in place of frames up to `stop`; False if it is too
        short.
        """
        if len(measured) < min(stop, self._stop) // self._loudness.step:
            return False
        self._loudness.blocks, self._peaks = measured[:, 0].tolist(), list(measured[:, 1:])
        return True

    def level(self, gain: float, stop: int | None = None) -> InstrumentLevel:
        """The level in a file that has this gain (a ratio), and may end sooner, at `stop`."""
        import numpy as np

        gain *= self._unit
        stop = self._stop if stop is None else stop
        step = self._loudness.step
        loudness = self._loudness.loudness(gain, -(-self._start // step), stop // step)
        cells = np.arange(len(self._peaks) * _PEAKS)
        begins = cells // _PEAKS * step + cells % _PEAKS * step // _PEAKS
        inside = (begins >= self._start) & (begins + step // _PEAKS < stop)
        peaks = np.array(self._peaks).reshape(-1)[inside]
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
    loudest = audible[-1]
    loudness_above = loudest.loudness - audible[-2].loudness
    return (loudest, loudness_above) if loudness_above > DOMINANCE_LU else None
