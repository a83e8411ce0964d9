"""A simulation that recalls what an earlier render of the same islands has computed.

    stretch 0 | stretch 1 | stretch 2 | …        each island by itself
     recalled    recalled   computed, from the state that is kept with stretch 1

Islands do not touch each other: if the events of an island did not change, its sound did not
either. If they changed, the stretches before the change can still be recalled. The samples are
those of a render that recalls nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Simulation, StorableIsland
    from ergon.exchange.stretch_store import StretchStore

STRETCH_FRAMES = 1 << 17  # frames, 3 s at 44.1 kHz: an edit costs half as much again on the average
# Reading and writing a sample of an output takes some 20 ns: what takes less to compute is
# computed.
_NS_PER_SAMPLE = 100.0
_WORK_MIN = 1.0  # s on one core: a shorter render is not worth any files
_OUTPUTS_MAX = 64  # of one island: 64 MiB of sound in memory, and in one file


@dataclass(slots=True)
class _Part:
    """An island, the key of the current stretch, and the state after the last one if it was
    recalled.
    """

    island: StorableIsland
    key: str = ""
    is_recalled: bool = False
    state: bytes | None = None


class ResumedSimulation:
    """The next `n_frames` frames of a simulation at frame 0; known stretches are recalled.

    `n_recalled` and `n_computed` count the frames of islands that were worth looking up.
    """

    def __init__(self, simulation: Simulation, store: StretchStore, n_frames: int) -> None:
        """Find the islands that are expensive enough."""
        self._simulation = simulation
        self._store = store
        self._n_frames = n_frames
        self._at = 0
        self._parts = [_Part(island) for island in simulation.storable() if is_dear(island)]
        if 1e-9 * n_frames * sum(part.island.cost for part in self._parts) < _WORK_MIN:
            self._parts = []
        self._is_kept = True
        self.n_recalled = self.n_computed = 0

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""
        return self._simulation.n_out

    @property
    def recalled(self) -> float:
        """The share of the islands' frames that was recalled (0 to 1)."""
        return self.n_recalled / max(1, self.n_recalled + self.n_computed)

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError."""
        while len(out):
            if self._at % STRETCH_FRAMES == 0:
                self._begin(self._at + STRETCH_FRAMES)
            n_frames = min(len(out), STRETCH_FRAMES - self._at % STRETCH_FRAMES)
            self._simulation.process(out[:n_frames])
            self._at += n_frames
            out = out[n_frames:]
            if self._at % STRETCH_FRAMES == 0:
                self._end()

    def _begin(self, stop: int) -> None:
        """Recall the islands whose stretch up to `stop` is known; compute the others."""
        is_whole = stop <= self._n_frames
        for part in self._parts:
            if is_whole:
                part.key = self._simulation.island_key(part.island, self._at, stop, part.key)
            # The last stretch is always computed, so that reports of the islands are available at
            # the end.
            known = self._store.get(part.key) if stop < self._n_frames else None
            n_samples = STRETCH_FRAMES * part.island.n_out
            if known is not None and len(known.sound) == n_samples:
                self._simulation.recall(part.island, known.sound)
                part.is_recalled, part.state = True, known.state
                self.n_recalled += STRETCH_FRAMES
                continue
            if part.state is not None:
                self._simulation.set_state(part.island, part.state)
            part.is_recalled, part.state = False, None
            if is_whole and self._is_kept:
                self._simulation.record(part.island)
            self.n_computed += min(stop, self._n_frames) - (stop - STRETCH_FRAMES)

    def _end(self) -> None:
        """Keep what was computed."""
        for part in self._parts:
            if part.is_recalled or not self._is_kept:
                continue
            stretch = self._simulation.recorded(part.island)
            # A folder that takes nothing now will take nothing later.
            self._is_kept = self._store.put(part.key, stretch.sound, stretch.state)
        if self._at + STRETCH_FRAMES > self._n_frames:
            self._store.forget()


def is_dear(island: StorableIsland) -> bool:
    """Whether computing an island takes longer than reading and writing its sound."""
    return island.n_out <= _OUTPUTS_MAX and island.cost >= _NS_PER_SAMPLE * max(1, island.n_out)
