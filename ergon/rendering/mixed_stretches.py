"""Mixed stretches that earlier renders have computed: a render of known ones computes nothing.

    stretch 0 | stretch 1 | stretch 2 …     a hash of all that the mix depends on up to its end
     mixed       mixed       mixed          (n_frames, n_channels), before levels and the limiter

Islands are recalled one by one (`resumed`), and then mixed. An excerpt of a piece that did not
change, and a second render, take the mixed frames as they are. The samples are those of a render
that recalls nothing.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ergon import _core

from . import stretches

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from ergon.exchange.stretch_store import StretchStore

    from .staged import Mixer

# The search for silence that ended a render: the frame from which on, and the number of channels.
SilenceSearch = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a simulation reports: parts with finer frames, and links that made energy.

    It names modules, so it is that of one score only.
    """

    parts_finer: tuple[_core.FinerPart, ...] = ()
    energy_gains: tuple[_core.EnergyGain, ...] = ()

    @classmethod
    def from_simulation(cls, simulation: _core.Simulation) -> Outcome:
        """The reports of a simulation now."""
        return cls(tuple(simulation.finer()), tuple(simulation.gains()))

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to report."""
        return not self.parts_finer and not self.energy_gains

    def to_fields(self, score_hash: str) -> list[Any]:
        """The outcome in lists, as JSON writes it; `score_hash` is the hash of the score."""
        return [
            list(self.parts_finer),
            list(self.energy_gains),
            "" if self.is_empty else score_hash,
        ]

    @classmethod
    def from_fields(cls, outcome_fields: Sequence[Any], score_hash: str) -> Outcome | None:
        """The outcome in `outcome_fields`; None if it names modules of another score, whose names
        may differ. Raises ValueError, TypeError or LookupError where it is no outcome.
        """
        finer_parts, gains, stored_hash = outcome_fields
        outcome = cls(
            tuple(_core.FinerPart(*part_fields) for part_fields in finer_parts),
            tuple(_core.EnergyGain(*gain_fields) for gain_fields in gains),
        )
        return outcome if outcome.is_empty or stored_hash == score_hash else None

    def finer(self) -> list[_core.FinerPart]:
        """As `Simulation.finer`."""
        return list(self.parts_finer)

    def gains(self) -> list[_core.EnergyGain]:
        """As `Simulation.gains`."""
        return list(self.energy_gains)


@dataclass(frozen=True, slots=True)
class KnownMaster:
    """What depends on a whole piece: the frame at which it ends, its gain (a ratio), and the
    outcome.
    """

    piece_end: int
    gain: float
    outcome: Outcome


@dataclass(frozen=True, slots=True)
class _MixedStretch:
    """Mixed frames, and the outcome after them; `silence_search` if the render ended within the
    stretch.
    """

    frames: NDArray[np.float64]
    outcome: Outcome
    silence_search: SilenceSearch | None


@dataclass(frozen=True, slots=True)
class KnownMix:
    """Mixed frames from frame `first_frame` of the piece on, stretch by stretch, and the outcome.

    `master` is the end and the gain of the piece, if they are known before its frames are read.
    """

    first_frame: int
    frames: tuple[NDArray[np.float64], ...]
    outcome: Outcome
    master: KnownMaster | None = None

    @property
    def stop_frame(self) -> int:
        """The frame after the last."""
        return self.first_frame + sum(map(len, self.frames))

    def blocks(self, n_frames: int) -> Iterator[NDArray[np.float64]]:
        """All frames, at most `n_frames` at a time."""
        return blocks_of(self.frames, n_frames)


class MixedStretches:
    """The mix of a piece, by the hash of all that it depends on up to the end of each stretch.

    `keys` are these hashes, of stretches up to frame `n_frames`; `score_hash` is the hash of the
    score.
    """

    def __init__(
        self,
        store: StretchStore,
        keys: Sequence[str],
        *,
        n_frames: int,
        n_channels: int,
        score_hash: str,
        state_key: Callable[[int], str],
    ) -> None:
        """Read nothing yet; `state_key` gives the key of the mixer's state after a stretch."""
        self._store, self._keys, self._score_hash = store, keys, score_hash
        self._n_frames, self._n_channels = n_frames, n_channels
        self._state_key = state_key
        self._read_stretches: dict[
            int, _MixedStretch
        ] = {}  # stretches that `find_followed_mix` has read

    def find_followed_mix(
        self, start: int, stop: int, silence_search: SilenceSearch | None, frames_needed: int
    ) -> KnownMix | None:
        """The mix from the stretch of frame `start` on up to frame `stop` or later; None if any of
        it, or its outcome, is not known.

        If the sound is followed to its end, the mix may end sooner, by the same `silence_search`,
        but not before frame `frames_needed`.
        """
        stretch_frames = stretches.STRETCH_FRAMES
        first_index = start // stretch_frames
        has_ended = False
        known_stretches: list[_MixedStretch] = []
        outcome_before = Outcome() if first_index == 0 else None
        for stretch_index in range(first_index, (stop - 1) // stretch_frames + 1):
            stretch = self._read(stretch_index)
            if stretch is None:
                return None
            self._read_stretches[stretch_index] = stretch
            if known_stretches:
                outcome_before = known_stretches[-1].outcome
            known_stretches.append(stretch)
            known_stop = stretch_index * stretch_frames + len(stretch.frames)
            has_ended = has_ended or (
                silence_search is not None and stretch.silence_search == silence_search
            )
            if known_stop >= stop or (has_ended and known_stop >= frames_needed):
                break
            if known_stop < self._stop_frame(stretch_index):
                return None
        last_stretch = known_stretches[-1]
        if stop < known_stop and not has_ended:
            # What happened within the stretch may have happened after `stop`.
            if outcome_before is None:
                earlier_stretch = self._read(first_index - 1)
                outcome_before = None if earlier_stretch is None else earlier_stretch.outcome
            if outcome_before != last_stretch.outcome:
                return None
        known_frames = [stretch.frames for stretch in known_stretches]
        if silence_search is None:
            known_frames[-1] = known_frames[-1][: stop - known_stop + len(known_frames[-1])]
        return KnownMix(first_index * stretch_frames, tuple(known_frames), last_stretch.outcome)

    def find_mastered_mix(
        self, master: KnownMaster, start_frame: int, stop_frame: int
    ) -> KnownMix | None:
        """The mix from the stretch of frame `start_frame` on up to frame `stop_frame`, of a piece
        whose end, gain and outcome are known; None if any of it is not.
        """
        stretch_frames = stretches.STRETCH_FRAMES
        first_index, known_frames = start_frame // stretch_frames, []
        for index in range(first_index, (stop_frame - 1) // stretch_frames + 1):
            stretch = self._read(index)
            n_needed = min(stop_frame - index * stretch_frames, stretch_frames)
            if stretch is None or len(stretch.frames) < n_needed:
                return None
            known_frames.append(stretch.frames[:n_needed])
        return KnownMix(first_index * stretch_frames, tuple(known_frames), master.outcome, master)

    def n_leading_stretches(self) -> int:
        """How many stretches from the first one on are stored, and complete unless a render ended
        in them.
        """
        indices = range(self._n_frames // stretches.STRETCH_FRAMES)
        unknown = (index for index in indices if not self._store.has(self._keys[index]))
        return next(unknown, len(indices))

    def leading_frames(self, n_stretches: int) -> list[NDArray[np.float64]] | None:
        """The frames of the first stretches; None if any of them is not known."""
        known_stretches = [
            self._read_stretches.get(index) or self._read(index) for index in range(n_stretches)
        ]
        self._read_stretches = {}
        frames = [stretch.frames for stretch in known_stretches if stretch is not None]
        n_frames = n_stretches * stretches.STRETCH_FRAMES
        return frames if sum(map(len, frames)) == n_frames else None

    def has_mixer_state(self, n_stretches: int) -> bool:
        """Whether the state of a mixer after the first stretches is stored."""
        return self._store.has(self._state_key(n_stretches - 1))

    def mixer_state(self, n_stretches: int) -> bytes | None:
        """The state of a mixer after the first stretches; None if it is not known."""
        stored = self._store.get(self._state_key(n_stretches - 1))
        return None if stored is None else stored.state

    def put_mixer_state(self, n_stretches: int, mixer: Mixer) -> None:
        """Store the state of a mixer after the first stretches."""
        import numpy as np

        state_key = self._state_key(n_stretches - 1)
        state = None if self._store.has(state_key) else mixer.state()
        if state is not None:
            self._store.put(state_key, np.empty(0), state)

    def put(
        self,
        first_frame: int,
        blocks: Sequence[NDArray[np.float64]],
        outcome: Outcome,
        silence_search: SilenceSearch | None,
    ) -> bool:
        """Store the frames of `blocks` from frame `first_frame` on, where a stretch begins; False
        if the folder takes nothing.
        """
        stretch_index = first_frame // stretches.STRETCH_FRAMES
        stretch_before = (
            self._read(stretch_index) if self._store.has(self._keys[stretch_index]) else None
        )
        if stretch_before is not None and len(stretch_before.frames) >= sum(map(len, blocks)):
            if (
                silence_search in (None, stretch_before.silence_search)
                or stretch_before.outcome != outcome
            ):
                return True
            blocks = [stretch_before.frames]
        state = [*outcome.to_fields(self._score_hash), silence_search]
        return self._store.put(self._keys[stretch_index], blocks, json.dumps(state).encode())

    def _stop_frame(self, index: int) -> int:
        return min((index + 1) * stretches.STRETCH_FRAMES, self._n_frames)

    def _read(self, index: int) -> _MixedStretch | None:
        stored = self._store.get(self._keys[index])
        if stored is None or len(stored.sound) % self._n_channels:
            return None
        try:
            *fields, silence_search = json.loads(stored.state)
            outcome = Outcome.from_fields(fields, self._score_hash)
            silence_search = (
                None if silence_search is None else (int(silence_search[0]), int(silence_search[1]))
            )
        except (ValueError, TypeError, LookupError):
            return None
        if outcome is None:
            return None
        return _MixedStretch(stored.sound.reshape(-1, self._n_channels), outcome, silence_search)


class MixRecorder:
    """Stores the mix of a render, stretch by stretch, as it is computed.

    `outcomes` gets the outcome at the end of each stretch before its last frames come.
    """

    def __init__(self, store: MixedStretches, n_frames: int, frame: int = 0) -> None:
        """Begin at a frame of a piece of `n_frames`, where a stretch begins."""
        self.outcomes: dict[int, Outcome] = {}
        self._store, self._n_frames = store, n_frames
        self._frame = frame
        self._blocks: list[NDArray[np.float64]] = []
        self._store_accepts = True

    def take(self, mixed: NDArray[np.float64]) -> None:
        """Take the next mixed frames (n_frames, n_channels)."""
        while len(mixed) and self._store_accepts:
            start = self._frame - self._n_pending
            stop_frame = min(start + stretches.STRETCH_FRAMES, self._n_frames)
            if self._frame == stop_frame:
                self._put(self.outcomes.pop(stop_frame, None), None)
                continue
            taken_frames = mixed[: stop_frame - self._frame]
            self._blocks.append(taken_frames)
            self._frame += len(taken_frames)
            mixed = mixed[len(taken_frames) :]

    def end(self, outcome: Outcome, silence_search: SilenceSearch | None) -> None:
        """Store the last stretch if it is complete, or if the end `silence_search` of the render
        may have cut it.
        """
        is_complete = self._frame in self.outcomes
        if self._n_pending and self._store_accepts and (is_complete or silence_search is not None):
            self._put(self.outcomes.pop(self._frame, outcome), silence_search)

    @property
    def _n_pending(self) -> int:
        return sum(map(len, self._blocks))

    def _put(self, outcome: Outcome | None, silence_search: SilenceSearch | None) -> None:
        first_frame, blocks = self._frame - self._n_pending, self._blocks
        self._blocks = []
        if outcome is not None:
            self._store_accepts = self._store.put(first_frame, blocks, outcome, silence_search)


def blocks_of(
    mixed_frames: Sequence[NDArray[np.float64]], n_frames: int
) -> Iterator[NDArray[np.float64]]:
    """All frames of arrays (n_frames, n_channels), at most `n_frames` at a time."""
    for stretch in mixed_frames:
        for first_frame in range(0, len(stretch), n_frames):
            yield stretch[first_frame : first_frame + n_frames]


def stretch_key(kind: str, stop_frame: int, dependencies_hash: str) -> str:
    """The key of what is stored of a stretch that ends at frame `stop_frame`, from the hash of all
    else that it depends on.
    """
    return hashlib.sha256(f"{kind} {stop_frame} {dependencies_hash}".encode()).hexdigest()
