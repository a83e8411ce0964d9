"""What a render takes from earlier ones, and what it leaves for later ones.

Four things are stored by the hash of all that they depend on: the sound of each island
(`resumed`), the mix (`mixed_stretches`), its end and its gain (`known_masters`), and how loud each
instrument is (`known_levels`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from ergon import _core

from . import stretches
from .known_levels import KnownLevels
from .known_masters import KnownMasters
from .mixed_stretches import (
    KnownMix,
    MixedStretches,
    MixRecorder,
    Outcome,
    blocks_of,
    stretch_key,
)
from .resumed import ResumedSimulation
from .staged import KeyedStage, Mixer, Staged

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.exchange.stretch_store import StretchStore

    from .balance import Balance
    from .job import RenderJob

_WORK_SECONDS_MIN = 0.25  # s on one core: a shorter render is not worth any files
_LIMITER_LOOK_AHEAD_SECONDS = 0.01  # [s] at least what a limiter sees ahead of the last frame


@dataclass(slots=True)
class ComputedRender:
    """A render that is computed: its simulation, what it measures itself, and what it stores.

    `known_frames` are mixed frames, stretch by stretch, before those that are computed.
    """

    simulation: ResumedSimulation
    balances: list[Balance]
    recorder: MixRecorder | None
    known_frames: Sequence[NDArray[np.float64]]
    _memory: RenderMemory
    _all_balances: Sequence[Balance]
    _balance_numbers: list[int]

    @property
    def n_known(self) -> int:
        """The frame before which nothing is computed."""
        return sum(map(len, self.known_frames))

    def known_blocks(self, n_frames: int) -> Iterator[NDArray[np.float64]]:
        """The known frames, at most `n_frames` at a time."""
        return blocks_of(self.known_frames, n_frames)

    def take(self, mixed: NDArray[np.float64]) -> None:
        """Store the next mixed frames (n_frames, n_channels)."""
        if self.recorder is not None:
            self.recorder.take(mixed)

    def end_block(self, stop_frame: int, mixer: Mixer) -> None:
        """Store states where a stretch ends: `mixer` and balances have all before `stop_frame`."""
        if self.recorder is not None and stop_frame % stretches.STRETCH_FRAMES == 0:
            self._memory.put_states(
                stop_frame // stretches.STRETCH_FRAMES,
                mixer,
                self._all_balances,
                self._balance_numbers,
            )

    def finish(self, job: RenderJob, n_simulated: int) -> None:
        """Store the results known after a number of computed frames of the job."""
        if self.recorder is not None:
            self.recorder.end(Outcome.from_simulation(self._memory.simulation), job.silence_search)
        self._memory.levels.put(self._all_balances, self._balance_numbers, n_simulated)
        self._memory.store.remove_oldest()


class RenderMemory:
    """Earlier renders of a staged piece."""

    def __init__(
        self, stage: KeyedStage, job: RenderJob, store: StretchStore, simulation: _core.Simulation
    ) -> None:
        """Compute the keys of all stretches."""
        self.store, self.simulation = store, simulation
        self._n_frames, self._rate = stage.n_frames, stage.rate
        stretch_frames = stretches.STRETCH_FRAMES
        stops = [*range(stretch_frames, stage.n_frames, stretch_frames), stage.n_frames]
        highpass, reference = job.level.highpass, job.level.reference
        mix_keys, level_keys = [], []
        all_taps = simulation.output_keys(stops)
        for stop_frame, taps in zip(stops, all_taps, strict=True):
            mix_hash = stage.mix_key(taps, highpass=highpass, reference=reference)
            stems = stage.stem_keys(taps, highpass=highpass, reference=reference)
            mix_keys.append(stretch_key("mix", stop_frame, mix_hash))
            level_keys.append([stretch_key("levels", stop_frame, stem) for stem in stems])

        def mixer_key(stretch_index: int) -> str:
            mix_hash = stage.mix_key(
                all_taps[stretch_index], highpass=highpass, reference=reference, with_silent=True
            )
            return stretch_key("mixer", stops[stretch_index], mix_hash)

        def balance_keys(stretch_index: int) -> list[str]:
            stems = stage.stem_keys(
                all_taps[stretch_index], highpass=highpass, reference=reference, with_silent=True
            )
            return [stretch_key("balance", stops[stretch_index], stem) for stem in stems]

        self._mixed_stretches = MixedStretches(
            store,
            mix_keys,
            n_frames=stage.n_frames,
            n_channels=stage.n_channels,
            score_hash=job.stamp.score,
            state_key=mixer_key,
        )
        self.levels = KnownLevels(store, level_keys, balance_keys)
        self.masters = KnownMasters(
            store, mix_keys[-1], n_frames=stage.n_frames, score=job.stamp.score
        )

    def known_mix(self, job: RenderJob, balances: Sequence[Balance]) -> KnownMix | None:
        """All that is heard of a job, with the levels in `balances`; None if any is not known."""
        recalled_mix = self._known_with_master(job) or self._followed_mix(job)
        if recalled_mix is None or self.levels.recall(
            balances, min(job.stop, recalled_mix.stop_frame)
        ):
            return None
        return recalled_mix

    def _known_with_master(self, job: RenderJob) -> KnownMix | None:
        """The frames of a job alone, if the end and the gain of the piece are known."""
        master = self.masters.get(job)
        if master is None:
            return None
        start_frame, stop_frame = job.start, min(job.stop, master.piece_end)
        if job.level.limit is not None:
            # What a limiter does depends on all that came before.
            start_frame, stop_frame = (
                0,
                min(self._n_frames, stop_frame + ceil(_LIMITER_LOOK_AHEAD_SECONDS * self._rate)),
            )
        return self._mixed_stretches.find_mastered_mix(master, start_frame, stop_frame)

    def _followed_mix(self, job: RenderJob) -> KnownMix | None:
        """The frames that a job follows to find the end and the gain of the piece, or its own."""
        start_frame, stop_frame = job.start, job.stop
        if job.level.limit is not None or job.level.is_levelled or job.silence_search is not None:
            # What limiter, level and search do depends on all that came before.
            start_frame, stop_frame = (
                0,
                min(self._n_frames, stop_frame + ceil(_LIMITER_LOOK_AHEAD_SECONDS * self._rate)),
            )
        last_frame = max(stop_frame, job.simulated_frames(self._n_frames))
        # A part may sound on after the piece has faded out.
        return self._mixed_stretches.find_followed_mix(
            start_frame, last_frame, job.silence_search, 0 if job.has_open_end else stop_frame
        )

    def begin_computing(
        self, job: RenderJob, balances: Sequence[Balance], mixer: Mixer | None
    ) -> ComputedRender:
        """How to compute a job, with what is known of its parts; a `mixer` that mixes all of it is
        brought to the first frame that is computed, and its mix is stored if the job asks for that.
        """
        last_frame = job.simulated_frames(self._n_frames)
        simulation = ResumedSimulation(self.simulation, self.store, self._n_frames, last_frame)
        balance_numbers = self.levels.recall(balances, job.stop)
        unknown_balances = [balances[number] for number in balance_numbers]
        if mixer is None:
            return ComputedRender(
                simulation, unknown_balances, None, (), self, balances, balance_numbers
            )
        known_frames: Sequence[NDArray[np.float64]] = ()
        for n_stretches in range(
            min(
                self._mixed_stretches.n_leading_stretches(),
                (last_frame - 1) // stretches.STRETCH_FRAMES,
            ),
            0,
            -1,
        ):
            is_stored = self._mixed_stretches.has_mixer_state(
                n_stretches
            ) and simulation.has_states(n_stretches)
            if is_stored and self.levels.has_states(balance_numbers, n_stretches):
                known_frames = self._resume(
                    n_stretches, simulation, mixer, unknown_balances, balance_numbers
                )
                break
        recorder = None
        if job.stores_mix:
            recorder = MixRecorder(
                self._mixed_stretches, self._n_frames, sum(map(len, known_frames))
            )
            simulation.outcomes = recorder.outcomes
        return ComputedRender(
            simulation, unknown_balances, recorder, known_frames, self, balances, balance_numbers
        )

    def _resume(
        self,
        n_stretches: int,
        simulation: ResumedSimulation,
        mixer: Mixer,
        balances: Sequence[Balance],
        balance_numbers: Sequence[int],
    ) -> Sequence[NDArray[np.float64]]:
        """Bring everything to the end of the first stretches; their frames, or none if any part of
        that cannot be read.
        """
        known_frames, mix_state = (
            self._mixed_stretches.leading_frames(n_stretches),
            self._mixed_stretches.mixer_state(n_stretches),
        )
        levels = self.levels.states(balance_numbers, n_stretches)
        if (
            known_frames is None
            or mix_state is None
            or levels is None
            or not simulation.resume(n_stretches)
        ):
            return ()
        mixer.set_state(mix_state)
        for balance, known_level in zip(balances, levels, strict=True):
            balance.resume(known_level.sound, known_level.state)
        return known_frames

    def put_states(
        self, n_stretches: int, mixer: Mixer, balances: Sequence[Balance], numbers: Sequence[int]
    ) -> None:
        """Store what a later render needs in order to go on after the first stretches."""
        self._mixed_stretches.put_mixer_state(n_stretches, mixer)
        self.levels.put_states(balances, numbers, n_stretches)


def memory_of_job(stage: Staged, job: RenderJob) -> RenderMemory | None:
    """The memory of a job; None if there is no store, or too little to compute."""
    simulation = stage.simulation
    # With frozen parts, the simulation reads frames from files, and there is nothing to store.
    if job.stretches is None or job.workers is not None:
        return None
    if not isinstance(simulation, _core.Simulation) or not isinstance(stage, KeyedStage):
        return None
    frame_cost = sum(island.cost for island in simulation.storable()) + 2.0 * stage.mix_cost
    if 1e-9 * stage.n_frames * frame_cost < _WORK_SECONDS_MIN:
        return None
    return RenderMemory(stage, job, job.stretches, simulation)
