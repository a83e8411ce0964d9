"""A simulation whose dear islands other processes compute, stretch by stretch.

    stretch 0 | stretch 1 | stretch 2 | …     a chain for each group of islands: sound and state
     arrived     arrived     asked for        of one stretch are what the next is asked for with

A request is a function of what it carries, so any worker computes it, again where one has died.
Home adds the sounds up in the plan's order, as it does those that it recalls or computes itself:
the samples are those of a render on one machine. What arrives is stored; a render that is stopped
goes on from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NotRequired, Protocol, TypedDict

from ergon.common.errors import ErgonError

from .resumed import STRETCH, is_dear

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Simulation, StorableIsland
    from ergon.exchange.stretch_store import StretchStore

# Stretches that are asked for before they are mixed. Sounds that wait are in memory: 1 MB each.
_LEAD = 3
_GROUPS_EACH = 2  # chains for each worker: one computes while the sound of the other travels


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
    """What a worker made of a request: for each island its sound (n_frames · n_out of f64, little
    end first) and its state; or a sentence why it computes none of it.

    Where the work `diverged` there is no sound. `worker` is its name, `seconds` what it took.
    """

    worker: str
    seconds: float
    sounds: list[bytes]
    states: list[bytes]
    refused: NotRequired[str]
    diverged: NotRequired[bool]


class Workers(Protocol):
    """What computes requests."""

    @property
    def count(self) -> int:
        """How many requests are computed at the same time."""

    def submit(self, request: Request) -> Future[Answer]:
        """Have a request computed, again where a worker dies."""

    def wait(self, futures: Sequence[Future[Answer]]) -> None:
        """Return when one of them has ended. Raises ClusterError where none will."""

    def answer(self, future: Future[Answer]) -> Answer:
        """The answer of one that has ended. Raises ClusterError."""

    def heard(self, answer: Answer, n_frames: int) -> None:
        """An answer was taken, which holds so many frames of all its islands."""


class ClusterError(ErgonError):
    """Workers cannot compute what is asked of them; what arrived from them is kept."""


@dataclass(slots=True)
class _Part:
    """An island with its number, the key up to where it is known, and its state there."""

    island: StorableIsland
    number: int
    state: bytes
    key: str = ""


@dataclass(slots=True)
class _Chain:
    """Islands that are computed together, and up to which frame they are known or asked for.

    `sounds` are those of each stretch that arrived, by its first frame.
    """

    parts: list[_Part]
    at: int = 0
    keys: list[str] = field(default_factory=list)
    asked: Future[Answer] | None = None
    sounds: dict[int, list[NDArray[np.float64]]] = field(default_factory=dict)
    states: dict[int, list[bytes]] = field(default_factory=dict)
    is_home: bool = False  # it diverged: home computes it, and says where

    @property
    def cost(self) -> float:
        return sum(part.island.cost for part in self.parts)


def grouped(costs: Sequence[float], count: int) -> list[list[int]]:
    """Numbers of costs in at most `count` groups, as even as the largest first makes them."""
    groups: list[tuple[float, list[int]]] = [(0.0, []) for _ in range(max(1, count))]
    for number in sorted(range(len(costs)), key=lambda i: (-costs[i], i)):
        least = min(range(len(groups)), key=lambda i: groups[i][0])
        whole, own = groups[least]
        groups[least] = whole + costs[number], [*own, number]
    return [sorted(own) for _, own in groups if own]


def chains(count: int, simulation: Simulation | None = None) -> int:
    """How many chains of work `count` workers have at most; or those of one simulation, 1 or more.

    Where nothing is dear enough, home has the work.
    """
    most = _GROUPS_EACH * count
    if simulation is None:
        return most
    return max(1, min(most, sum(map(is_dear, simulation.storable()))))


class RemoteSimulation:
    """The next `n_frames` frames of a simulation at frame 0, most of them computed by `workers`.

    Banks and islands that cost less than their sound's way are computed here.
    """

    def __init__(
        self,
        simulation: Simulation,
        workers: Workers,
        store: StretchStore | None,
        n_frames: int,
    ) -> None:
        """Group the islands that are dear enough."""
        self._simulation, self._workers, self._store = simulation, workers, store
        self._n_frames, self._at = n_frames, 0
        self.n_recalled = self.n_computed = 0
        dear = [(i, one) for i, one in enumerate(simulation.storable()) if is_dear(one)]
        groups = grouped([one.cost for _, one in dear], _GROUPS_EACH * workers.count)
        self._chains = []
        for group in groups:
            parts = []
            for number in group:
                index, island = dear[number]
                simulation.record(island)
                parts.append(_Part(island, index, simulation.recorded(island).state))
            self._chains.append(_Chain(parts))

    @property
    def n_out(self) -> int:
        """How many outputs a frame has."""
        return self._simulation.n_out

    @property
    def recalled(self) -> float:
        """The part of the frames of islands that was recalled (0 to 1)."""
        return self.n_recalled / max(1, self.n_recalled + self.n_computed)

    def process(self, out: NDArray[np.float64]) -> None:
        """Fill (n_frames, n_out) with the next frames. Raises DivergedError and ClusterError."""
        while len(out):
            if self._at % STRETCH == 0:
                self._begin()
            n_frames = min(len(out), STRETCH - self._at % STRETCH, self._n_frames - self._at)
            self._simulation.process(out[:n_frames])
            self._at += n_frames
            out = out[n_frames:]
            if self._at % STRETCH == 0 or self._at == self._n_frames:
                self._end()

    def _begin(self) -> None:
        """Have the sounds of the stretch that begins."""
        while True:
            for chain in self._chains:
                self._go_on(chain)
            missing = [c for c in self._chains if not c.is_home and self._at not in c.sounds]
            if not missing:
                break
            asked = [chain.asked for chain in self._chains if chain.asked is not None]
            self._workers.wait(asked)
        for chain in self._chains:
            for part, sound in zip(chain.parts, chain.sounds.pop(self._at, ()), strict=False):
                self._simulation.recall(part.island, sound)

    def _end(self) -> None:
        """Islands tell of themselves as they are now."""
        for chain in self._chains:
            for part, state in zip(chain.parts, chain.states.pop(self._at, ()), strict=False):
                self._simulation.set_state(part.island, state)
        if self._at == self._n_frames and self._store is not None:
            self._store.forget()

    def _go_on(self, chain: _Chain) -> None:
        """Take what arrived, and ask for the next stretch, unless that is far ahead."""
        if chain.asked is not None and chain.asked.done():
            answer, chain.asked = self._workers.answer(chain.asked), None
            self._take(chain, answer)
        while chain.asked is None and not chain.is_home and self._is_wanted(chain):
            stop = min(chain.at + STRETCH, self._n_frames)
            chain.keys = [
                self._simulation.island_key(part.island, chain.at, stop, part.key)
                for part in chain.parts
            ]
            if not self._recall(chain, stop):
                chain.asked = self._workers.submit(self._request(chain, stop))

    def _is_wanted(self, chain: _Chain) -> bool:
        return chain.at < min(self._n_frames, self._at + _LEAD * STRETCH)

    def _request(self, chain: _Chain, stop: int) -> Request:
        islands = [
            IslandRequest(number=part.number, before=part.key, key=key, state=part.state)
            for part, key in zip(chain.parts, chain.keys, strict=True)
        ]
        return Request(at=chain.at, stop=stop, islands=islands)

    def _recall(self, chain: _Chain, stop: int) -> bool:
        """Take the stretch from the store, if all of it is there."""
        if self._store is None or stop - chain.at < STRETCH:
            return False
        found = []
        for part, key in zip(chain.parts, chain.keys, strict=True):
            known = self._store.get(key)
            if known is None or len(known.sound) != STRETCH * part.island.n_out:
                return False
            found.append(known)
        self._keep(chain, stop, [one.sound for one in found], [one.state for one in found])
        self.n_recalled += STRETCH * len(found)
        return True

    def _take(self, chain: _Chain, answer: Answer) -> None:
        import numpy as np

        if refused := answer.get("refused"):
            raise ClusterError(f"worker {answer['worker']}: {refused}")
        if answer.get("diverged"):
            chain.is_home = True  # from the state at its end on, which `_end` gives back
            return
        stop = min(chain.at + STRETCH, self._n_frames)
        n_frames = stop - chain.at
        sizes = [8 * n_frames * part.island.n_out for part in chain.parts]
        if [len(sound) for sound in answer["sounds"]] != sizes or len(answer["states"]) != len(
            sizes
        ):
            raise ClusterError(f"worker {answer['worker']} sent sounds of another length")
        sounds = [np.frombuffer(one, dtype="<f8").astype(np.float64) for one in answer["sounds"]]
        if self._store is not None and n_frames == STRETCH:
            for key, sound, state in zip(chain.keys, sounds, answer["states"], strict=True):
                self._store.put(key, sound, state)
        self.n_computed += n_frames * len(sizes)
        self._workers.heard(answer, n_frames * len(sizes))
        self._keep(chain, stop, sounds, answer["states"])

    def _keep(
        self,
        chain: _Chain,
        stop: int,
        sounds: list[NDArray[np.float64]],
        states: list[bytes],
    ) -> None:
        chain.sounds[chain.at] = sounds
        chain.states[stop] = states
        for part, key, state in zip(chain.parts, chain.keys, states, strict=True):
            part.key, part.state = key, state
        chain.at = stop
