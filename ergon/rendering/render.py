"""A staged piece into WAV files: simulate, mix, set the level, write; all of it or nothing.

    simulation ─ frames ─┬─ mixer ─ (held on disk until the peak is known) ─ gain ─ limiter ─ file
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
from ergon.exchange.safe import FileGroup, check_target, file_group

from .ahead import ahead
from .balance import MEASURED_OUTPUTS_MAX, Balance
from .filmed import FilmedSimulation
from .job import RenderedFile, RenderedFiles, RenderJob
from .level import ArrayWriter, FrameSpool, MasterChain, Writer, ceiling_gain
from .memory import memory_of
from .mixed_stretches import KnownMix, MixRecorder, Outcome
from .remote import RemoteSimulation
from .resumed import ResumedSimulation
from .staged import Mixer, Simulation, Staged

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(slots=True)
class _Track:
    """One output file in the making: its mixer, the spool of its frames, and its master chain."""

    path: str
    mixer: Mixer
    # Once the length of the file is known: the job, and the first frame that comes.
    begin: Callable[[RenderJob, int], MasterChain]
    held: FrameSpool | None
    finish: MasterChain | None = None

    def take(self, block: NDArray[np.float64]) -> None:
        """Take the next mixed frames: into the spool, or through the chain at once."""
        to = self.held or self.finish
        assert to is not None
        to.take(block)


def stem_paths(folder: Path, names: Sequence[str], suffix: str) -> list[Path]:
    """`01_ada.wav`, `02_remi.wav` …, in the order of the piece."""
    safe = ["".join(c if c.isalnum() or c in "-_." else "_" for c in name) for name in names]
    return [folder / f"{index:02}_{name}{suffix}" for index, name in enumerate(safe, 1)]


def render(stage: Staged, job: RenderJob, progress: Callable[[int], None]) -> RenderedFiles:
    """Write the files of `job`; `progress` is called with the number of simulated frames.

    Raises FileRefusedError before any work when a file may not be written, DivergedError from
    the engine when a part goes non-finite; neither leaves a file.
    """
    start = time.perf_counter()
    highpass, reference = job.level.highpass, job.level.reference
    stems = []
    if job.stems is not None:
        stems = list(stage.stems(highpass=highpass, reference=reference))
    suffix = sound.suffix_of(job.target)
    paths = stem_paths(job.stems, [name for name, _ in stems], suffix) if job.stems else []
    for path in paths:
        check_target(path, force=job.force, inputs=job.inputs)
    with contextlib.ExitStack() as stack:
        files = stack.enter_context(file_group(force=job.force, inputs=job.inputs))
        mixers = [
            (job.target, stage.mixer(highpass=highpass, reference=reference), job.level.limit)
        ]
        # Stems are not limited: what a limiter does to a sum cannot be divided among its terms.
        mixers += [(str(path), mixer, None) for path, (_, mixer) in zip(paths, stems, strict=True)]
        tracks = []
        for name, mixer, limit in mixers:
            file = files.open(name, binary=True)

            def written_to(
                of: RenderJob,
                first: int,
                name: str = name,
                file: BinaryIO = file,
                limit: float | None = limit,
            ) -> MasterChain:
                writer = sound.writer(name, file, of.format, of.n_frames, of.stamp)
                return _chain(writer, stage, of, limit, first)

            tracks.append(_track(stack, job, name, mixer, written_to))
        balances = _balances(stage, job)
        filmed = _filmed(files, stage, job, reference)
        if filmed is not None:
            job, written = _fill(stage, job, tracks, progress, balances, filmed)
            filmed.finish()
            recalled, outcome = 0.0, None
        else:
            job, written, recalled, outcome = _recalled_or_computed(
                stage, job, tracks, progress, balances
            )
    wall = time.perf_counter() - start
    levels = tuple(balance.level(written[0].gain, job.stop) for balance in balances)
    stems_written = tuple(written[1:])
    return RenderedFiles(written[0], stems_written, wall, job.n_frames, levels, recalled, outcome)


def _recalled_or_computed(
    stage: Staged,
    job: RenderJob,
    tracks: Sequence[_Track],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
) -> tuple[RenderJob, list[RenderedFile], float, Outcome | None]:
    """Fill the files with what is known, or compute it. Returns the job, whose end is known then,
    the files, the share that was recalled, and the outcome if nothing was computed.
    """
    memory = memory_of(stage, job)
    if memory is None:
        resumed = _resumed(stage, job)
        job, written = _fill(stage, job, tracks, progress, balances, resumed)
        return job, written, 0.0 if resumed is None else resumed.recalled, None
    is_alone = len(tracks) == 1
    known = memory.known_mix(job, balances) if is_alone else None
    if known is not None:
        fade = _silence_detector(job, stage.rate)
        job, written = _fill_known(job, tracks[0], known, fade, progress)
        return job, written, 1.0, known.outcome
    computing = memory.computing(job, balances, records=is_alone)
    job, written = _fill(
        stage, job, tracks, progress, computing.balances, computing.simulation, computing.recorder
    )
    computing.finish(job)
    return job, written, computing.simulation.recalled, None


def _resumed(stage: Staged, job: RenderJob) -> ResumedSimulation | RemoteSimulation | None:
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
    return ResumedSimulation(simulation, job.stretches, stage.n_frames)


def _filmed(
    files: FileGroup, stage: Staged, job: RenderJob, reference: float | None
) -> FilmedSimulation | None:
    """The simulation with its motion recorded, if `job` asks for it. It recalls nothing, because a
    recalled island does not move.
    """
    simulation = stage.simulation
    if job.film is None or not isinstance(simulation, _core.Simulation):
        return None
    file = files.open(job.film.path, binary=True)
    return FilmedSimulation(simulation, job.film, stage.mixer(reference=reference), file)


def _balances(stage: Staged, job: RenderJob) -> list[Balance]:
    """A balance for each instrument, if there are several and not too many."""
    if not job.measures_instruments:
        return []
    stems = stage.stems(highpass=job.level.highpass, reference=job.level.reference)
    if not 1 < len(stems) <= MEASURED_OUTPUTS_MAX // max(1, stage.n_channels):
        return []
    return [
        Balance(name, mixer, stage.rate, stage.n_channels, job.start, job.stop)
        for name, mixer in stems
    ]


def render_array(
    stage: Staged, job: RenderJob, progress: Callable[[int], None]
) -> tuple[NDArray[np.float64], RenderedFile, Outcome | None]:
    """The mix of `job` as (n_frames, n_channels), its measures, and the outcome if it is recalled;
    no file is written.

    The format of `job` has to be "double". Raises DivergedError.
    """
    import numpy as np

    made: list[NDArray[np.float64]] = []

    def written_to(of: RenderJob, first: int) -> MasterChain:
        made.append(np.zeros((of.n_frames, of.format.n_channels)))
        return _chain(ArrayWriter(of.format, made[0]), stage, of, of.level.limit, first)

    mixer = stage.mixer(highpass=job.level.highpass, reference=job.level.reference)
    with contextlib.ExitStack() as stack:
        track = _track(stack, job, "-", mixer, written_to)
        _, (done,), _, outcome = _recalled_or_computed(stage, job, [track], progress, ())
    return made[0], done, outcome


def _fill(
    stage: Staged,
    job: RenderJob,
    tracks: Sequence[_Track],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
    simulation: Simulation | None,
    recorder: MixRecorder | None = None,
) -> tuple[RenderJob, list[RenderedFile]]:
    """Compute the files; returns them and the job, whose end is known then."""
    if job.fades_from is None:
        for track in tracks:
            track.finish = track.begin(job, 0)
    stop = _simulate(
        stage, simulation or stage.simulation, job, tracks, progress, balances, recorder
    )
    job = replace(job, stop=stop)
    for track in tracks:
        track.finish = track.finish or track.begin(job, 0)
    _release(job, tracks)
    return job, [_close(track) for track in tracks]


def _fill_known(
    job: RenderJob,
    track: _Track,
    known: KnownMix,
    fade: _core.SilenceDetector | None,
    progress: Callable[[int], None],
) -> tuple[RenderJob, list[RenderedFile]]:
    """Fill a file with mixed frames that are known, and compute nothing."""
    if track.held is not None:
        track.held.begin(known.first)
    if job.fades_from is None:
        track.finish = track.begin(job, known.first)
    at, stop = known.first, job.stop
    for mixed in known.blocks(job.block):
        folded = _fold(mixed, job.format.n_channels)
        end = None if fade is None else fade.take(folded)
        track.take(folded)
        at += len(mixed)
        progress(min(at, job.stop))
        if end is not None:
            stop = min(max(end, job.start), job.stop)
            break
    job = replace(job, stop=stop)
    track.finish = track.finish or track.begin(job, known.first)
    _release(job, [track])
    return job, [_close(track)]


def _silence_detector(job: RenderJob, rate: float) -> _core.SilenceDetector | None:
    if job.fades_from is None:
        return None
    return _core.SilenceDetector(rate, job.format.n_channels, job.fades_from)


def _chain(
    writer: Writer, stage: Staged, job: RenderJob, limit: float | None, first: int
) -> MasterChain:
    chain = MasterChain(writer, stage.rate, job.start, job.stop, limit, job.silences, first)
    chain.gain = job.level.gain
    return chain


def _track(
    stack: contextlib.ExitStack,
    job: RenderJob,
    path: str,
    mixer: Mixer,
    begin: Callable[[RenderJob, int], MasterChain],
) -> _Track:
    held = None
    if job.level.normalise is not None or job.fades_from is not None:
        folder = None if path == "-" else Path(path).resolve().parent
        n_channels = job.format.n_channels
        held = stack.enter_context(FrameSpool(folder, n_channels, job.start, job.stop))
    return _Track(path, mixer, begin, held)


def _simulate(
    stage: Staged,
    simulation: Simulation,
    job: RenderJob,
    tracks: Sequence[_Track],
    progress: Callable[[int], None],
    balances: Sequence[Balance],
    recorder: MixRecorder | None,
) -> int:
    """Mix all frames; returns the frame at which the files end."""
    import numpy as np

    at = 0
    # A limiter looks ahead, so it needs frames past the cut.
    latencies = (track.finish.latency for track in tracks if track.finish is not None)
    last = min(stage.n_frames, job.stop + max(latencies, default=0))
    fade = _silence_detector(job, stage.rate)
    blocks = frames_of(simulation, last, job.block)
    # A filmed simulation goes on after the sound has faded, so no block may be abandoned midway.
    # Other processes are not waited for in a thread that Ctrl-C does not reach.
    is_ahead = job.threads > 1 and job.film is None and job.workers is None
    with contextlib.closing(ahead(blocks) if is_ahead else blocks) as coming:
        for frames in coming:
            end = None
            for track in tracks:
                mixed = np.zeros((len(frames), stage.n_channels))
                track.mixer.process(frames, mixed)
                if recorder is not None and track is tracks[0]:
                    recorder.take(mixed)
                folded = _fold(mixed, job.format.n_channels)
                if fade is not None and track is tracks[0]:
                    end = fade.take(folded)
                track.take(folded)
            for balance in balances:
                balance.take(frames)
            at += len(frames)
            progress(at)
            if end is not None:
                return min(max(end, job.start), job.stop)
    return job.stop


def frames_of(
    simulation: Simulation, stop: int, block: int
) -> Generator[NDArray[np.float64], None, None]:
    """The next `stop` frames in blocks; each is a new array, since another thread may hold it."""
    import numpy as np

    for at in range(0, stop, block):
        frames = np.zeros((min(block, stop - at), simulation.n_out))
        simulation.process(frames)
        yield frames


def _fold(mixed: NDArray[np.float64], n_channels: int) -> NDArray[np.float64]:
    """Add channel c to channel c mod n_channels, so that fewer loudspeakers lose nothing."""
    import numpy as np

    if mixed.shape[1] == n_channels:
        return mixed
    folded = np.zeros((len(mixed), n_channels))
    for channel in range(mixed.shape[1]):
        folded[:, channel % n_channels] += mixed[:, channel]
    return folded


def _release(job: RenderJob, tracks: Sequence[_Track]) -> None:
    """The second pass, over spooled frames. With normalisation, the peak of the mix sets the gain.

    All stems share one gain, so that they still add up; it is that of the mix unless one of them
    would clip.
    """
    if job.level.normalise is not None:
        _normalise(job, job.level.normalise, tracks)
    for track in tracks:
        if track.held is not None and track.finish is not None:
            for block in track.held.blocks(job.block):
                track.finish.take(block)


def _normalise(job: RenderJob, target: float, tracks: Sequence[_Track]) -> None:
    target = target or 1.0
    mix, *stems = (track.held.peak if track.held else 0.0 for track in tracks)
    gain = target / mix if mix > 0 else 1.0
    clips = job.format.bits != "float"
    shared = min(gain, ceiling_gain(max(stems, default=0.0), target)) if clips else gain
    for index, track in enumerate(tracks):
        if track.finish is not None:
            track.finish.gain = shared if index else gain


def _close(track: _Track) -> RenderedFile:
    finish = track.finish
    assert finish is not None
    finish.close()
    return RenderedFile(track.path, finish.peak, finish.loudness, finish.gain, finish.sha256)
