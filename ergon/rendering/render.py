"""A staged piece into WAV files: simulate, mix, set the level, write; all of it or nothing.

    simulation ─ frames ─┬─ mixer ─ (held on disk until the gain is known) ─ gain ─ limiter ─ file
                         └─ mixer of every stem ─ …

The bytes do not depend on the size of blocks or on the number of threads.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from ergon import _core
from ergon.exchange import sound
from ergon.exchange.safe import FileGroup, FileRefusedError, check_target, file_group

from . import stretches
from .ahead import computed_ahead
from .balance import MEASURED_OUTPUTS_MAX, Balance
from .filmed import FilmedSimulation
from .job import RenderedFile, RenderedFiles, RenderJob
from .level import ArrayWriter, MasterChain
from .limiting import FrameLimiter, StemLimiter
from .memory import ComputedRender, RenderMemory, memory_of_job
from .mixed_stretches import KnownMaster, KnownMix, Outcome
from .remote import RemoteSimulation
from .resumed import ResumedSimulation
from .staged import Mixer, Simulation, Staged
from .tracks import (
    OutputTrack,
    close_track,
    master_chain,
    mix_limiter,
    open_track,
    write_spooled_tracks,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class _FilledFiles:
    """Rendered files, and their job after the end of the piece was found.

    Beside them: the share that was recalled, and the outcome if nothing has to be computed.
    """

    job: RenderJob
    files: list[RenderedFile]
    n_simulated: int
    piece_end: int
    recalled_share: float = 0.0
    outcome: Outcome | None = None


def stem_paths(folder: Path, names: Sequence[str], suffix: str) -> list[Path]:
    """`01_ada.wav`, `02_remi.wav` …, in the order of the piece."""
    safe_names = [
        "".join(
            character if character.isalnum() or character in "-_." else "_" for character in name
        )
        for name in names
    ]
    return [folder / f"{index:02}_{name}{suffix}" for index, name in enumerate(safe_names, 1)]


def render_files(stage: Staged, job: RenderJob, progress: Callable[[int], None]) -> RenderedFiles:
    """Write the files of `job`; `progress` is called with the number of simulated frames.

    Raises FileRefusedError before any work when a file may not be written, DivergedError from
    the engine when a part goes non-finite; neither leaves a file.
    """
    start_time = time.perf_counter()
    highpass, reference = job.level.highpass, job.level.reference
    stems = []
    if job.stems is not None:
        stems = list(stage.stems(highpass=highpass, reference=reference, is_split=job.splits_stems))
    suffix = sound.suffix_of(job.target)
    paths = stem_paths(job.stems, [name for name, _ in stems], suffix) if job.stems else []
    for path in paths:
        check_target(path, force=job.force, inputs=job.inputs)
    with contextlib.ExitStack() as stack:
        output_files = stack.enter_context(file_group(force=job.force, inputs=job.inputs))
        limiter = mix_limiter(stage, job)
        mixers: list[tuple[str, Mixer, FrameLimiter | None, tuple[str, ...]]] = [
            (job.target, stage.mixer(highpass=highpass, reference=reference), limiter, ())
        ]
        for path, (stem, mixer) in zip(paths, stems, strict=True):
            stem_limiter = None if limiter is None else StemLimiter(limiter, job.format.n_channels)
            mixers.append(
                (str(path), mixer, stem_limiter, _channel_names(stem, job.format.n_channels))
            )
        tracks, opened_files = [], []
        for output_name, mixer, track_limiter, channel_names in mixers:
            open_file = output_files.open(output_name, binary=True)
            opened_files.append(open_file)

            def begin_chain(
                job: RenderJob,
                first_frame: int,
                output_name: str = output_name,
                output_file: BinaryIO = open_file,
                track_limiter: FrameLimiter | None = track_limiter,
                channel_names: tuple[str, ...] = channel_names,
            ) -> MasterChain:
                stamp = replace(job.stamp, tracks=channel_names)
                writer = sound.writer(output_name, output_file, job.format, job.n_frames, stamp)
                return master_chain(writer, stage, job, track_limiter, first_frame)

            tracks.append(open_track(stack, job, output_name, mixer, begin_chain))
        balances = _instrument_balances(stage, job)
        filmed_simulation = _filmed_simulation(output_files, stage, job, reference)
        if filmed_simulation is not None:
            filled_files = _compute_files(stage, job, tracks, progress, balances, filmed_simulation)
            filmed_simulation.finish()
        else:
            filled_files = _recalled_or_computed(stage, job, tracks, progress, balances)
        for open_file, rendered in zip(opened_files, filled_files.files, strict=True):
            output_files.note_samples_hash(open_file, rendered.sha256)
    wall_seconds = time.perf_counter() - start_time
    mix, *other_files = filled_files.files
    levels = tuple(balance.level(mix.gain, filled_files.job.stop) for balance in balances)
    return RenderedFiles(
        mix,
        tuple(other_files),
        wall_seconds,
        filled_files.job.n_frames,
        filled_files.n_simulated,
        levels,
        filled_files.recalled_share,
        filled_files.outcome,
    )


def _channel_names(stem: str, n_channels: int) -> tuple[str, ...]:
    """Names of the channels of a stem, for workstations."""
    if n_channels == 1:
        return (stem,)
    return tuple(f"{stem} {number}" for number in range(1, n_channels + 1))


def _recalled_or_computed(
    stage: Staged,
    job: RenderJob,
    tracks: Sequence[OutputTrack],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
) -> _FilledFiles:
    """Fill the files with what is known, or compute it."""
    memory = memory_of_job(stage, job)
    if memory is None:
        resumed_simulation = _resumed_simulation(stage, job)
        filled_files = _compute_files(stage, job, tracks, progress, balances, resumed_simulation)
        return replace(
            filled_files,
            recalled_share=0.0 if resumed_simulation is None else resumed_simulation.recalled_share,
        )
    is_alone = len(tracks) == 1
    known_mix = memory.known_mix(job, balances) if is_alone else None
    if known_mix is not None:
        filled_files = _fill_with_known_mix(stage, job, tracks[0], known_mix, progress)
        if known_mix.master is None:
            _store_found_master(memory, job, filled_files, known_mix.outcome)
        return filled_files
    computing = memory.begin_computing(job, balances, tracks[0].mixer if is_alone else None)
    filled_files = _compute_files(
        stage, job, tracks, progress, computing.balances, computing.simulation, computing
    )
    _store_found_master(memory, job, filled_files, Outcome.from_simulation(memory.simulation))
    computing.finish(job, filled_files.n_simulated)
    return replace(filled_files, recalled_share=computing.simulation.recalled_share)


def _store_found_master(
    memory: RenderMemory, job: RenderJob, filled: _FilledFiles, outcome: Outcome
) -> None:
    """Store the end and the gain of a piece that `job` has followed."""
    memory.masters.put(job, KnownMaster(filled.piece_end, filled.files[0].gain, outcome))


def _resumed_simulation(
    stage: Staged, job: RenderJob
) -> ResumedSimulation | RemoteSimulation | None:
    """The simulation with stretches from earlier renders or other processes; None if neither is
    used.
    """
    simulation = stage.simulation
    # With frozen parts, the simulation reads frames from files, and there is nothing to store.
    if not isinstance(simulation, _core.Simulation):
        return None
    if job.workers is not None:
        return RemoteSimulation(simulation, job.workers, job.stretches, stage.n_frames)
    if job.stretches is None:
        return None
    return ResumedSimulation(
        simulation, job.stretches, stage.n_frames, job.simulated_frames(stage.n_frames)
    )


def _filmed_simulation(
    files: FileGroup, stage: Staged, job: RenderJob, reference: float | None
) -> FilmedSimulation | None:
    """The simulation with its motion recorded, if `job` asks for it. It recalls nothing, because a
    recalled island does not move.
    """
    simulation = stage.simulation
    if job.motion is None or not isinstance(simulation, _core.Simulation):
        return None
    file = files.open(job.motion.path, binary=True)
    return FilmedSimulation(simulation, job.motion, stage.mixer(reference=reference), file)


def _instrument_balances(stage: Staged, job: RenderJob) -> list[Balance]:
    """A balance for each instrument, if there are several and not too many."""
    if not job.measures_instruments:
        return []
    stems = stage.measured_stems(highpass=job.level.highpass, reference=job.level.reference)
    if not 1 < len(stems) <= MEASURED_OUTPUTS_MAX // max(1, stage.n_channels):
        return []
    return [
        Balance(name, mixer, stage.rate, stage.n_channels, job.start, job.stop, unit)
        for name, mixer, unit in stems
    ]


def render_array(
    stage: Staged, job: RenderJob, progress: Callable[[int], None]
) -> tuple[NDArray[np.float64], RenderedFile, Outcome | None]:
    """The mix of `job` as (n_frames, n_channels), its measures, and the outcome if it is recalled;
    no file is written.

    The format of `job` has to be "double". Raises DivergedError.
    """
    import numpy as np

    written_frames: list[NDArray[np.float64]] = []

    def begin_chain(written_job: RenderJob, first_frame: int) -> MasterChain:
        written_frames.append(np.zeros((written_job.n_frames, written_job.format.n_channels)))
        return master_chain(
            ArrayWriter(written_job.format, written_frames[0]),
            stage,
            written_job,
            mix_limiter(stage, written_job),
            first_frame,
        )

    mixer = stage.mixer(highpass=job.level.highpass, reference=job.level.reference)
    with contextlib.ExitStack() as stack:
        track = open_track(stack, job, "-", mixer, begin_chain)
        filled_files = _recalled_or_computed(stage, job, [track], progress, ())
    return written_frames[0], filled_files.files[0], filled_files.outcome


def _compute_files(
    stage: Staged,
    job: RenderJob,
    tracks: Sequence[OutputTrack],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
    simulation: Simulation | None,
    computing: ComputedRender | None = None,
) -> _FilledFiles:
    """Compute the files."""
    if not job.has_open_end:
        for track in tracks:
            track.chain = track.begin_chain(job, 0)
    piece_end, n_simulated = _simulate(
        stage, simulation or stage.simulation, job, tracks, progress, balances, computing
    )
    return _finished_files(stage, job, tracks, 0, piece_end, n_simulated)


def _fill_with_known_mix(
    stage: Staged,
    job: RenderJob,
    track: OutputTrack,
    known_mix: KnownMix,
    progress: Callable[[int], None],
) -> _FilledFiles:
    """Fill a file with mixed frames that are known, and compute nothing."""
    if known_mix.master is not None:
        return _fill_with_master(stage, job, track, known_mix, known_mix.master, progress)
    if not job.has_open_end:
        track.chain = track.begin_chain(job, known_mix.first_frame)
    mixed_frame, end = known_mix.first_frame, None
    n_frames = job.simulated_frames(stage.n_frames)
    silence_detector = _silence_detector(stage, job)
    for mixed in known_mix.blocks(job.block_frames):
        folded = _folded_mix(mixed, job.format.n_channels)
        if silence_detector is not None and end is None:
            end = silence_detector.take(folded)
        track.take(folded)
        mixed_frame += len(mixed)
        progress(min(mixed_frame, n_frames))
        if end is not None and job.has_open_end:
            break
    piece_end = mixed_frame if end is None else end
    filled_files = _finished_files(
        stage, job, [track], known_mix.first_frame, piece_end, mixed_frame - known_mix.first_frame
    )
    return replace(filled_files, recalled_share=1.0, outcome=known_mix.outcome)


def _fill_with_master(
    stage: Staged,
    job: RenderJob,
    track: OutputTrack,
    known_mix: KnownMix,
    master: KnownMaster,
    progress: Callable[[int], None],
) -> _FilledFiles:
    """Fill a file in one pass, for the end of the piece and its gain are known."""
    track.spool = None
    ended_job = _job_with_end(job, master.piece_end)
    track.chain = track.begin_chain(ended_job, known_mix.first_frame)
    track.chain.gain = master.gain
    mixed_frame = known_mix.first_frame
    for mixed in known_mix.blocks(job.block_frames):
        track.take(_folded_mix(mixed, job.format.n_channels))
        mixed_frame += len(mixed)
        progress(mixed_frame)
    n_frames = mixed_frame - known_mix.first_frame
    filled_files = _finished_files(
        stage, ended_job, [track], known_mix.first_frame, master.piece_end, n_frames
    )
    return replace(filled_files, recalled_share=1.0, outcome=known_mix.outcome)


def _job_with_end(job: RenderJob, piece_end: int) -> RenderJob:
    """The job of a piece that ends at frame `piece_end`. Raises FileRefusedError if the part to
    render begins later.
    """
    if not job.has_open_end:
        return job
    if piece_end <= job.start:
        begin, end = (f"{frame / job.format.rate:.3g} s" for frame in (job.start, piece_end))
        message = f"the part to render begins at {begin}, and the sound ends at {end}"
        raise FileRefusedError(f"{job.target}: {message}")
    return replace(job, stop=min(piece_end, job.stop))


def _finished_files(
    stage: Staged,
    job: RenderJob,
    tracks: Sequence[OutputTrack],
    first_frame: int,
    piece_end: int,
    n_simulated: int,
) -> _FilledFiles:
    """The files, once all of `n_simulated` frames from frame `first_frame` on are mixed."""
    job = _job_with_end(job, piece_end)
    for track in tracks:
        track.chain = track.chain or track.begin_chain(job, first_frame)
    write_spooled_tracks(stage, job, tracks, piece_end)
    return _FilledFiles(job, [close_track(track) for track in tracks], n_simulated, piece_end)


def _silence_detector(stage: Staged, job: RenderJob) -> _core.SilenceDetector | None:
    if job.silence_search is None:
        return None
    fades_from, n_channels = job.silence_search
    return _core.SilenceDetector(stage.rate, n_channels, fades_from)


def _simulate(
    stage: Staged,
    simulation: Simulation,
    job: RenderJob,
    tracks: Sequence[OutputTrack],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
    computing: ComputedRender | None,
) -> tuple[int, int]:
    """Mix all frames that are not known; returns the frame at which the piece ends, as far as that
    was computed, and the number of frames that were.
    """
    done_frames = 0
    # A limiter looks ahead, so it needs frames past the cut.
    latencies = (track.chain.latency for track in tracks if track.chain is not None)
    frames_needed = min(stage.n_frames, job.stop + max(latencies, default=0))
    last_frame = max(frames_needed, job.simulated_frames(stage.n_frames))
    silence_detector, piece_end = _silence_detector(stage, job), None
    n_known = 0 if computing is None else computing.n_known
    known_blocks = () if computing is None else computing.known_blocks(job.block_frames)
    blocks = frames_of(simulation, last_frame - n_known, job.block_frames)
    new_block = _BlockAllocator(stage.n_channels, last_frame)
    # A filmed simulation goes on after the sound has faded, so no block may be abandoned midway.
    # Other processes are not waited for in a thread that Ctrl-C does not reach.
    is_ahead = job.threads > 1 and job.motion is None and job.workers is None
    with contextlib.closing(computed_ahead(blocks) if is_ahead else blocks) as coming_blocks:
        for mixed in known_blocks:
            folded = _folded_mix(mixed, job.format.n_channels)
            if silence_detector is not None and piece_end is None:
                piece_end = silence_detector.take(folded)
            tracks[0].take(folded)
            done_frames += len(mixed)
            progress(done_frames)
        for coming_frames in coming_blocks:
            for track in tracks:
                mixed = new_block(len(coming_frames))
                track.mixer.process(coming_frames, mixed)
                if computing is not None and track is tracks[0]:
                    computing.take(mixed)
                folded = _folded_mix(mixed, job.format.n_channels)
                if silence_detector is not None and piece_end is None and track is tracks[0]:
                    piece_end = silence_detector.take(folded)
                track.take(folded)
            for balance in balances:
                balance.take(coming_frames)
            done_frames += len(coming_frames)
            progress(done_frames)
            if computing is not None:
                computing.end_block(done_frames, tracks[0].mixer)
            if piece_end is not None and (job.has_open_end or done_frames >= frames_needed):
                break
    return done_frames if piece_end is None else piece_end, done_frames


def frames_of(
    simulation: Simulation, stop_frame: int, block_frames: int
) -> Generator[NDArray[np.float64], None, None]:
    """Blocks up to frame `stop_frame`; each is a new array, since another thread may hold it."""
    import numpy as np

    for first_frame in range(0, stop_frame, block_frames):
        frames = np.empty((min(block_frames, stop_frame - first_frame), simulation.n_out))
        simulation.process(frames)
        yield frames


class _BlockAllocator:
    """New arrays for mixed frames, cut from large ones: the system gives memory in large pages."""

    def __init__(self, n_channels: int, n_frames: int) -> None:
        """Arrays for `n_frames`, or a part of them, at a time."""
        import numpy as np

        self._frames_left: NDArray[np.float64] = np.empty((0, n_channels))
        self._n_frames = min(n_frames, stretches.STRETCH_FRAMES)

    def __call__(self, n_frames: int) -> NDArray[np.float64]:
        """An array (n_frames, n_channels) that nobody else uses."""
        import numpy as np

        if len(self._frames_left) < n_frames:
            n_channels = self._frames_left.shape[1]
            self._frames_left = np.empty((max(n_frames, self._n_frames), n_channels))
        block, self._frames_left = self._frames_left[:n_frames], self._frames_left[n_frames:]
        return block


def _folded_mix(mixed: NDArray[np.float64], n_channels: int) -> NDArray[np.float64]:
    """Add channel c to channel c mod n_channels, so that fewer loudspeakers lose nothing."""
    import numpy as np

    if mixed.shape[1] == n_channels:
        return mixed
    folded = np.zeros((len(mixed), n_channels))
    for channel in range(mixed.shape[1]):
        folded[:, channel % n_channels] += mixed[:, channel]
    return folded
