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

from . import stretches
from .mixed_stretches import Outcome
from .stretches import StretchedSimulation, is_expensive

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Simulation, StorableIsland
    from ergon.exchange.stretch_store import Stretch, StretchStore

# Reading and writing a sample takes some 20 ns, and computing it several times what the table of
# costs says, where contacts open and close: 122 s of 23 struck islands of 20 to 60 ns took 30 s.
_COST_SHARE_MIN = 0.15
_UNHEARD_FRAMES = 4096  # frames that are computed at once; divides a stretch
_WORK_SECONDS_MIN = 1.0  # s on one core: a shorter render is not worth any files


@dataclass(slots=True)
class _StoredIsland:
    """An island, the key of its current stretch, and its state after that stretch if this is
    recalled.
    """

    island: StorableIsland
    key: str = ""
    is_recalled: bool = False
    state: bytes | None = None


class ResumedSimulation(StretchedSimulation):
    """The next `n_frames` frames of a simulation at frame 0; known stretches are recalled."""

    def __init__(
        self,
        simulation: Simulation,
        store: StretchStore,
        n_frames: int,
        last_frame: int,
        outcomes: dict[int, Outcome] | None = None,
    ) -> None:
        """Find the islands that are expensive enough.

        The simulation may be left from frame `last_frame` on. A stretch that ends after it is
        computed, not recalled, because a recalled stretch reports only at its end.
        `outcomes` gets what the simulation reports at the end of each stretch, by its frame.
        """
        super().__init__(simulation, n_frames)
        self._store, self._last_frame, self.outcomes = store, last_frame, outcomes
        self._islands = [
            _StoredIsland(island)
            for island in simulation.storable()
            if is_expensive(island, _COST_SHARE_MIN)
        ]
        if 1e-9 * n_frames * sum(part.island.cost for part in self._islands) < _WORK_SECONDS_MIN:
            self._islands = []
        self._store_accepts = True
        # The stretches before the first one that is asked for.
        self._stretches_before: list[Stretch] = []
        self._n_to_skip = 0

    def has_states(self, n_stretches: int) -> bool:
        """Whether the states of all islands after the first stretches are stored."""
        return all(self._store.has(key) for key in self._end_keys(n_stretches))

    def resume(self, n_stretches: int) -> bool:
        """Go on after the first stretches, which are not heard any more; False if a state of an
        island after them is not known. The samples are those of a render from frame 0.
        """
        keys = self._end_keys(n_stretches)
        known_stretches = [self._store.get(key) for key in keys]
        n_frames = stretches.STRETCH_FRAMES
        for stored_island, stretch, stretch_key in zip(
            self._islands, known_stretches, keys, strict=True
        ):
            if stretch is None or len(stretch.sound) != n_frames * stored_island.island.n_out:
                return False
            stored_island.key = stretch_key
        self._stretches_before = [stretch for stretch in known_stretches if stretch is not None]
        self._frame = n_stretches * n_frames
        self._n_to_skip = self._frame
        return True

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError."""
        if self._n_to_skip:
            self._skip()
        super().process(out)

    def _end_keys(self, n_stretches: int) -> list[str]:
        """For each island, the key of its stretch number `n_stretches` - 1."""
        stretch_frames = stretches.STRETCH_FRAMES
        stretch_keys = []
        for stored_island in self._islands:
            stretch_key = ""
            for start_frame in range(0, n_stretches * stretch_frames, stretch_frames):
                stretch_key = self._simulation.island_key(
                    stored_island.island, start_frame, start_frame + stretch_frames, stretch_key
                )
            stretch_keys.append(stretch_key)
        return stretch_keys

    def _skip(self) -> None:
        """Bring the simulation to the first frame that is asked for.

        Islands that are not stored are computed. The last stretch is recalled, because rates of
        change depend on the frames before.
        """
        import numpy as np

        stretch_frames, n_to_skip, self._n_to_skip = stretches.STRETCH_FRAMES, self._n_to_skip, 0
        for stored_island in self._islands:
            self._simulation.silence(stored_island.island)
        unheard_frames = np.empty((min(stretch_frames, _UNHEARD_FRAMES), self.n_out))
        for first_frame in range(0, n_to_skip, len(unheard_frames)):
            if first_frame == n_to_skip - stretch_frames:
                for stored_island, stretch in zip(
                    self._islands, self._stretches_before, strict=True
                ):
                    self._simulation.recall(stored_island.island, stretch.sound)
            self._simulation.process(unheard_frames)
        for stored_island, stretch in zip(self._islands, self._stretches_before, strict=True):
            self._simulation.set_state(stored_island.island, stretch.state)
        self.n_recalled += n_to_skip * len(self._islands)
        self._stretches_before = []

    def _begin_stretch(self) -> None:
        """Recall the islands whose stretch is known; compute the others."""
        stop_frame = min(self._frame + stretches.STRETCH_FRAMES, self._n_frames)
        n_frames = stop_frame - self._frame
        for stored_island in self._islands:
            stored_island.is_recalled, stored_island.state = False, None
            if n_frames <= 0:
                continue
            stored_island.key = self._simulation.island_key(
                stored_island.island, self._frame, stop_frame, stored_island.key
            )
            known_stretch = (
                self._store.get(stored_island.key) if stop_frame <= self._last_frame else None
            )
            if (
                known_stretch is not None
                and len(known_stretch.sound) == n_frames * stored_island.island.n_out
            ):
                self._simulation.recall(stored_island.island, known_stretch.sound)
                stored_island.is_recalled, stored_island.state = True, known_stretch.state
                self.n_recalled += n_frames
                continue
            if self._store_accepts:
                self._simulation.record(stored_island.island)
            self.n_computed += n_frames

    def _end_stretch(self) -> None:
        """Keep what was computed of a complete stretch; the last one ends with the piece."""
        for stored_island in self._islands:
            if stored_island.is_recalled and stored_island.state is not None:
                # What the simulation reports is then that of a render which recalls nothing.
                self._simulation.set_state(stored_island.island, stored_island.state)
        if self.outcomes is not None:
            self.outcomes[self._frame] = Outcome.from_simulation(self._simulation)
        if self._frame > self._n_frames:
            return
        for stored_island in self._islands:
            if stored_island.is_recalled or not self._store_accepts:
                continue
            stretch = self._simulation.recorded(stored_island.island)
            # A folder that takes nothing now will take nothing later.
            self._store_accepts = self._store.put(stored_island.key, stretch.sound, stretch.state)
        if self._frame == self._n_frames:
            self._store.remove_oldest()
