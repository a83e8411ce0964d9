"""What a render takes from earlier ones, and what it leaves for later ones.

Four things are stored by the hash of all that they depend on: the sound of each island
(`resumed`), the mix (`mixed_stretches`), its end and its gain (`known_masters`), and how loud each
instrument is (`known_levels`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

from ergon import _core

from . import stretches
from .known_levels import KnownLevels
from .known_masters import KnownMasters
from .mixed_stretches import KnownMix, MixedStretches, MixRecorder, Outcome, key_of
from .resumed import ResumedSimulation
from .staged import KeyedStage, Staged

if TYPE_CHECKING:
    from ergon.exchange.stretch_store import StretchStore

    from .balance import Balance
    from .job import RenderJob

_WORK_MIN = 0.25  # s on one core: a shorter render is not worth any files
_LOOK_AHEAD = 0.01  # [s] at least what a limiter sees ahead of the last frame


@dataclass(slots=True)
class ComputedRender:
    """A render that is computed: its simulation, what it measures itself, and what it stores."""

    simulation: ResumedSimulation
    balances: list[Balance]
    recorder: MixRecorder | None
    _memory: RenderMemory
    _all_balances: Sequence[Balance]
    _numbers: list[int]

    def finish(self, job: RenderJob, n_simulated: int) -> None:
        """Store what is known once so many frames of the job are computed."""
        if self.recorder is not None:
            self.recorder.end(Outcome.from_simulation(self._memory.simulation), job.ending)
        self._memory.levels.put(self._all_balances, self._numbers, n_simulated)
        self._memory.store.forget()


class RenderMemory:
    """Earlier renders of a staged piece."""

    def __init__(
        self, stage: KeyedStage, job: RenderJob, store: StretchStore, simulation: _core.Simulation
    ) -> None:
        """Compute the keys of all stretches."""
        self.store, self.simulation = store, simulation
        self._n_frames, self._rate = stage.n_frames, stage.rate
        step = stretches.STRETCH_FRAMES
        stops = [*range(step, stage.n_frames, step), stage.n_frames]
        highpass, reference = job.level.highpass, job.level.reference
        mixes, levels = [], []
        for stop, taps in zip(stops, simulation.output_keys(stops), strict=True):
            mix = stage.mix_key(taps, highpass=highpass, reference=reference)
            stems = stage.stem_keys(taps, highpass=highpass, reference=reference)
            mixes.append(key_of("mix", stop, mix))
            levels.append([key_of("levels", stop, stem) for stem in stems])
        self._mixed = MixedStretches(
            store,
            mixes,
            n_frames=stage.n_frames,
            n_channels=stage.n_channels,
            score=job.stamp.score,
        )
        self.levels = KnownLevels(store, levels)
        self.masters = KnownMasters(
            store, mixes[-1], n_frames=stage.n_frames, score=job.stamp.score
        )

    def known_mix(self, job: RenderJob, balances: Sequence[Balance]) -> KnownMix | None:
        """All that is heard of a job, with the levels in `balances`; None if any is not known."""
        recalled_mix = self._known_with_master(job) or self._followed_mix(job)
        if recalled_mix is None or self.levels.recall(balances, min(job.stop, recalled_mix.stop)):
            return None
        return recalled_mix

    def _known_with_master(self, job: RenderJob) -> KnownMix | None:
        """The frames of a job alone, if the end and the gain of the piece are known."""
        master = self.masters.get(job)
        if master is None:
            return None
        start, stop = job.start, min(job.stop, master.piece_end)
        if job.level.limit is not None:
            # What a limiter does depends on all that came before.
            start, stop = 0, min(self._n_frames, stop + ceil(_LOOK_AHEAD * self._rate))
        return self._mixed.known_with(master, start, stop)

    def _followed_mix(self, job: RenderJob) -> KnownMix | None:
        """The frames that a job follows to find the end and the gain of the piece, or its own."""
        start, stop = job.start, job.stop
        if job.level.limit is not None or job.level.is_levelled or job.ending is not None:
            # What limiter, level and search do depends on all that came before.
            start, stop = 0, min(self._n_frames, stop + ceil(_LOOK_AHEAD * self._rate))
        last_frame = max(stop, job.simulated_frames(self._n_frames))
        # A part may sound on after the piece has faded out.
        return self._mixed.known(start, last_frame, job.ending, 0 if job.has_open_end else stop)

    def computing(
        self, job: RenderJob, balances: Sequence[Balance], *, records: bool
    ) -> ComputedRender:
        """How to compute a job, with what is known of its parts; `records`: its mix is stored."""
        recorder = MixRecorder(self._mixed, self._n_frames) if records else None
        outcomes = None if recorder is None else recorder.outcomes
        last_frame = job.simulated_frames(self._n_frames)
        simulation = ResumedSimulation(
            self.simulation, self.store, self._n_frames, last_frame, outcomes
        )
        numbers = self.levels.recall(balances, job.stop)
        part_balances = [balances[number] for number in numbers]
        return ComputedRender(simulation, part_balances, recorder, self, balances, numbers)


def memory_of(stage: Staged, job: RenderJob) -> RenderMemory | None:
    """The memory of a job; None if there is no store, or too little to compute."""
    simulation = stage.simulation
    # With frozen parts, the simulation reads frames from files, and there is nothing to store.
    if job.stretches is None or job.workers is not None:
        return None
    if not isinstance(simulation, _core.Simulation) or not isinstance(stage, KeyedStage):
        return None
    frame_cost = sum(island.cost for island in simulation.storable()) + 2.0 * stage.mix_cost
    if 1e-9 * stage.n_frames * frame_cost < _WORK_MIN:
        return None
    return RenderMemory(stage, job, job.stretches, simulation)
