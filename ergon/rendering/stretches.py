"""A simulation in stretches of equal length, whose islands may come from elsewhere."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Simulation, StorableIsland

STRETCH_FRAMES = 1 << 17  # frames, 3 s at 44.1 kHz: an edit costs half as much again on the average
# What takes less to compute is computed, not sent by another process.
_NS_PER_SAMPLE = 100.0
_STORED_OUTPUTS_MAX = 64  # outputs of one island: 64 MiB of sound


class StretchedSimulation(ABC):
    """The next `n_frames` frames of a simulation at frame 0, stretch by stretch.

    `n_recalled` and `n_computed` count the frames of islands that were worth looking up.
    """

    def __init__(self, simulation: Simulation, n_frames: int) -> None:
        """Begin at frame 0."""
        self._simulation, self._n_frames, self._frame = simulation, n_frames, 0
        self.n_recalled = self.n_computed = 0

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""
        return self._simulation.n_out

    @property
    def recalled_share(self) -> float:
        """The share of the islands' frames that was recalled (0 to 1)."""
        return self.n_recalled / max(1, self.n_recalled + self.n_computed)

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError and what
        `_begin_stretch` raises.
        """
        while len(out):
            if self._frame % STRETCH_FRAMES == 0:
                self._begin_stretch()
            stop_frame = (self._frame // STRETCH_FRAMES + 1) * STRETCH_FRAMES
            if self._frame < self._n_frames:
                stop_frame = min(stop_frame, self._n_frames)
            n_frames = min(len(out), stop_frame - self._frame)
            self._simulation.process(out[:n_frames])
            self._frame += n_frames
            out = out[n_frames:]
            if self._frame == stop_frame:
                self._end_stretch()

    @abstractmethod
    def _begin_stretch(self) -> None:
        """Give the simulation what is known of the stretch that begins."""

    @abstractmethod
    def _end_stretch(self) -> None:
        """Keep what was computed of the stretch that ended."""


def is_expensive(island: StorableIsland, cost_share: float = 1.0) -> bool:
    """Whether computing an island takes longer than this share of what another process needs to
    send its sound.
    """
    cost_min = cost_share * _NS_PER_SAMPLE * max(1, island.n_out)
    return island.n_out <= _STORED_OUTPUTS_MAX and island.cost >= cost_min
