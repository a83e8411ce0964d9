"""A simulation whose expensive islands other processes compute, stretch by stretch.

    stretch 0 | stretch 1 | stretch 2 | …     one chain for each group of islands: the state at
    arrived     arrived     requested         the end of a stretch goes into the next request

A request depends only on what it carries, so any worker can compute it, and another one can
repeat it if a worker dies. This process adds the sounds up in the plan's order, whether they
were received, recalled or computed here, so the samples are those of a render on one machine.
Sounds that arrive are stored: a render that was stopped continues from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NotRequired, Protocol, TypedDict

from ergon.common.errors import ErgonError

from . import stretches
from .stretches import StretchedSimulation, is_expensive

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Simulation, StorableIsland
    from ergon.exchange.stretch_store import StretchStore

# Stretches that are requested before they are mixed. A sound that waits takes 1 MB of memory.
_LEAD_STRETCHES = 3
_CHAINS_PER_WORKER = 2  # chains for each worker: one computes while the sound of the other travels


class IslandRequest(TypedDict):
    """An island: its number in `Simulation.storable`, its keys before and after the stretch, and
    its state before it."""

    number: int
    before: str
    key: str
    state: bytes


class Request(TypedDict):
    """A stretch of some islands: frames `at` to `stop`."""

    at: int
    stop: int
    islands: list[IslandRequest]


class Answer(TypedDict):
    """The answer of a worker: for each island its sound (n_frames · n_out of f64, little-endian)
    and its state; or `refused`, a sentence that says why it computes none of them.

    If the work `diverged` there is no sound. `worker` is the worker's name, `seconds` the time
    it took.
    """

    worker: str
    seconds: float
    sounds: list[bytes]
    states: list[bytes]
    refused: NotRequired[str]
    diverged: NotRequired[bool]


class Workers(Protocol):
    """Processes that compute requests."""

    @property
    def count(self) -> int:
        """How many requests are computed at the same time."""

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request computed, and computed again if a worker dies."""

    def wait(self, futures: Sequence[Future[Answer]]) -> None:
        """Return when one of the futures has ended. Raises ClusterError if none will."""

    def answer(self, future: Future[Answer]) -> Answer:
        """The answer of a future that has ended. Raises ClusterError."""

    def receive(self, answer: Answer, n_frames: int) -> None:
        """Note that an answer is used; `n_frames` is summed over its islands."""


class ClusterError(ErgonError):
    """Workers cannot compute what is asked of them; what arrived from them is kept."""


@dataclass(slots=True)
class _ChainIsland:
    """An island, its number, and the key and the state at the end of its last known stretch."""

    island: StorableIsland
    number: int
    state: bytes
    key: str = ""


@dataclass(slots=True)
class _IslandChain:
    """Islands that are computed together, and the frame up to which they are known.

    `sounds` are those of each stretch that arrived, by its first frame.
    """

    parts: list[_ChainIsland]
    frame: int = 0
    keys: list[str] = field(default_factory=list)
    pending_answer: Future[Answer] | None = None
    sounds: dict[int, list[NDArray[np.float64]]] = field(default_factory=dict)
    states: dict[int, list[bytes]] = field(default_factory=dict)
    is_local: bool = False  # after a divergence this process computes the chain

    @property
    def cost(self) -> float:
        return sum(part.island.cost for part in self.parts)


def group_by_cost(costs: Sequence[float], group_count: int) -> list[list[int]]:
    """Indices of costs in at most `group_count` groups: each cost, largest first, goes to the
    cheapest group.
    """
    cost_groups: list[tuple[float, list[int]]] = [(0.0, []) for _ in range(max(1, group_count))]
    for cost_index in sorted(range(len(costs)), key=lambda i: (-costs[i], i)):
        cheapest_group = min(range(len(cost_groups)), key=lambda i: cost_groups[i][0])
        group_cost, cost_indices = cost_groups[cheapest_group]
        cost_groups[cheapest_group] = group_cost + costs[cost_index], [*cost_indices, cost_index]
    return [sorted(cost_indices) for _, cost_indices in cost_groups if cost_indices]


def chain_count(process_count: int, simulation: Simulation | None = None) -> int:
    """The largest number of chains for `process_count` workers; with a simulation, the number of
    its chains, at least 1.

    If no island is expensive enough, this process does the work.
    """
    count_max = _CHAINS_PER_WORKER * process_count
    if simulation is None:
        return count_max
    return max(1, min(count_max, sum(map(is_expensive, simulation.storable()))))


class RemoteSimulation(StretchedSimulation):
    """The next `n_frames` frames of a simulation at frame 0, most of them computed by `workers`.

    Banks, and islands that cost less than the transfer of their sound, are computed here.
    """

    def __init__(
        self,
        simulation: Simulation,
        workers: Workers,
        store: StretchStore | None,
        n_frames: int,
    ) -> None:
        """Group the islands that are expensive enough."""
        super().__init__(simulation, n_frames)
        self._workers, self._store = workers, store
        costly_islands = [
            (costly_index, island)
            for costly_index, island in enumerate(simulation.storable())
            if is_expensive(island)
        ]
        groups = group_by_cost(
            [island.cost for _, island in costly_islands], _CHAINS_PER_WORKER * workers.count
        )
        self._chains = []
        for group in groups:
            chain_parts = []
            for costly_index in group:
                number, island = costly_islands[costly_index]
                simulation.record(island)
                chain_parts.append(_ChainIsland(island, number, simulation.recorded(island).state))
            self._chains.append(_IslandChain(chain_parts))

    def _begin_stretch(self) -> None:
        """Get the sounds of the stretch that begins; wait for those that are missing."""
        while True:
            for chain in self._chains:
                self._receive_and_request(chain)
            missing_chains = [
                chain
                for chain in self._chains
                if not chain.is_local and self._frame not in chain.sounds
            ]
            if not missing_chains:
                break
            requests = [
                chain.pending_answer for chain in self._chains if chain.pending_answer is not None
            ]
            self._workers.wait(requests)
        for chain in self._chains:
            for part, sound in zip(chain.parts, chain.sounds.pop(self._frame, ()), strict=False):
                self._simulation.recall(part.island, sound)

    def _end_stretch(self) -> None:
        """Give the islands of the simulation their state after the stretch."""
        for chain in self._chains:
            for part, state in zip(chain.parts, chain.states.pop(self._frame, ()), strict=False):
                self._simulation.set_state(part.island, state)
        if self._frame == self._n_frames and self._store is not None:
            self._store.remove_oldest()

    def _receive_and_request(self, chain: _IslandChain) -> None:
        """Take what arrived, and request the next stretch, unless it is too far ahead."""
        if chain.pending_answer is not None and chain.pending_answer.done():
            answer, chain.pending_answer = self._workers.answer(chain.pending_answer), None
            self._take_answer(chain, answer)
        while chain.pending_answer is None and not chain.is_local and self._is_wanted(chain):
            stop_frame = min(chain.frame + stretches.STRETCH_FRAMES, self._n_frames)
            chain.keys = [
                self._simulation.island_key(part.island, chain.frame, stop_frame, part.key)
                for part in chain.parts
            ]
            if not self._recall(chain, stop_frame):
                chain.pending_answer = self._workers.submit(self._request(chain, stop_frame))

    def _is_wanted(self, chain: _IslandChain) -> bool:
        return chain.frame < min(
            self._n_frames, self._frame + _LEAD_STRETCHES * stretches.STRETCH_FRAMES
        )

    def _request(self, chain: _IslandChain, stop_frame: int) -> Request:
        islands = [
            IslandRequest(number=part.number, before=part.key, key=key, state=part.state)
            for part, key in zip(chain.parts, chain.keys, strict=True)
        ]
        return Request(at=chain.frame, stop=stop_frame, islands=islands)

    def _recall(self, chain: _IslandChain, stop_frame: int) -> bool:
        """Take the stretch from the store, if all of it is there."""
        if self._store is None or stop_frame - chain.frame < stretches.STRETCH_FRAMES:
            return False
        known_stretches = []
        for part, key in zip(chain.parts, chain.keys, strict=True):
            known_stretch = self._store.get(key)
            if (
                known_stretch is None
                or len(known_stretch.sound) != stretches.STRETCH_FRAMES * part.island.n_out
            ):
                return False
            known_stretches.append(known_stretch)
        self._advance(
            chain,
            stop_frame,
            [island_stretch.sound for island_stretch in known_stretches],
            [island_stretch.state for island_stretch in known_stretches],
        )
        self.n_recalled += stretches.STRETCH_FRAMES * len(known_stretches)
        return True

    def _take_answer(self, chain: _IslandChain, answer: Answer) -> None:
        import numpy as np

        if refusal := answer.get("refused"):
            raise ClusterError(f"worker {answer['worker']}: {refusal}")
        if answer.get("diverged"):
            chain.is_local = True  # it continues from the state that `_end_stretch` restores
            return
        stop_frame = min(chain.frame + stretches.STRETCH_FRAMES, self._n_frames)
        n_frames = stop_frame - chain.frame
        sound_sizes = [8 * n_frames * part.island.n_out for part in chain.parts]
        if [len(sound) for sound in answer["sounds"]] != sound_sizes or len(
            answer["states"]
        ) != len(sound_sizes):
            raise ClusterError(f"worker {answer['worker']} sent sounds of another length")
        sounds = [
            np.frombuffer(sound_bytes, dtype="<f8").astype(np.float64)
            for sound_bytes in answer["sounds"]
        ]
        if self._store is not None and n_frames == stretches.STRETCH_FRAMES:
            for key, sound, state in zip(chain.keys, sounds, answer["states"], strict=True):
                self._store.put(key, sound, state)
        self.n_computed += n_frames * len(sound_sizes)
        self._workers.receive(answer, n_frames * len(sound_sizes))
        self._advance(chain, stop_frame, sounds, answer["states"])

    def _advance(
        self,
        chain: _IslandChain,
        stop: int,
        sounds: list[NDArray[np.float64]],
        states: list[bytes],
    ) -> None:
        chain.sounds[chain.frame] = sounds
        chain.states[stop] = states
        for part, key, state in zip(chain.parts, chain.keys, states, strict=True):
            part.key, part.state = key, state
        chain.frame = stop
