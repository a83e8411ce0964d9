"""How loud each instrument is in a mix, once the gain of the whole file is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .staged import Mixer

DOMINANCE_LU = 20.0  # [LU] by which one instrument hides all others
MEASURED_OUTPUTS_MAX = (
    256  # instruments times channels: beyond that measuring costs more than mixing
)
_GATE = -70.0  # [LUFS] absolute gate of BS.1770-4: quieter blocks do not count
_RELATIVE = -10.0  # [LU] relative gate, from the mean of the other blocks


@dataclass(frozen=True, slots=True)
class InstrumentLevel:
    """The peak of one instrument as a ratio, and its integrated loudness [LUFS], in the file."""

    name: str
    peak: float
    loudness: float


class Balance:
    """Measures the level of one instrument by itself, before the limiter.

    The 400 ms blocks of BS.1770 are kept, because which of them pass its gates depends on the
    gain.
    """

    def __init__(
        self, name: str, mixer: Mixer, rate: float, n_channels: int, start: int, stop: int
    ) -> None:
        """Measure frames `start` to `stop`, counted from 0 at the first frame that `take`
        receives.
        """
        from ergon import _core

        self._name, self._mixer = name, mixer
        self._meter = _core.Meter(rate, n_channels)
        self._n_channels = n_channels
        self._step = (int(rate + 0.5) + 5) // 10
        self._start, self._stop = start, stop
        self._at = self._measured = 0
        self._blocks: list[float] = []

    def take(self, frames: NDArray[np.float64]) -> None:
        """Measure the next frames (n_frames, n_out)."""
        import numpy as np

        mixed = np.zeros((len(frames), self._n_channels))
        self._mixer.process(frames, mixed)
        kept = mixed[max(self._start - self._at, 0) : max(self._stop - self._at, 0)]
        self._at += len(frames)
        while len(kept):
            count = min(self._step - self._measured % self._step, len(kept))
            self._meter.process(np.ascontiguousarray(kept[:count]))
            kept = kept[count:]
            self._measured += count
            if self._measured % self._step == 0 and self._measured >= 4 * self._step:
                self._blocks.append(self._meter.momentary)

    def level(self, gain: float) -> InstrumentLevel:
        """The level in a file that has this gain (a ratio)."""
        import numpy as np

        blocks = np.array(self._blocks) + 20.0 * np.log10(max(gain, 1e-30))
        blocks = blocks[blocks > _GATE]
        if len(blocks):
            blocks = blocks[blocks > _mean(blocks) + _RELATIVE]
        loudness = _mean(blocks) if len(blocks) else -np.inf
        return InstrumentLevel(self._name, self._meter.peak * gain, float(loudness))


def dominant_instrument(levels: Sequence[InstrumentLevel]) -> tuple[InstrumentLevel, float] | None:
    """The instrument that hides all others, and how much louder it is than the second [LU]; or
    None.
    """
    heard = sorted(
        (one for one in levels if one.loudness > -math.inf), key=lambda one: one.loudness
    )
    if len(heard) < 2:
        return None
    loudest = heard[-1]
    above = loudest.loudness - heard[-2].loudness
    return (loudest, above) if above > DOMINANCE_LU else None


def _mean(blocks: NDArray[np.float64]) -> float:
    """The level of the mean power of blocks."""
    import numpy as np

    return float(10.0 * np.log10(np.mean(10.0 ** (blocks / 10.0))))
