"""Files in the making: frames held until a gain is known, and what is done to them last."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .job import RenderedFile, RenderJob
from .level import FrameSpool, MasterChain, Writer, ceiling_gain
from .limiting import FrameLimiter, MixLimiter
from .measured_level import MeasuredLevel
from .staged import Mixer, Staged

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(slots=True)
class OutputTrack:
    """One output file in the making: its mixer, the spool of its frames, and its master chain."""

    path: str
    mixer: Mixer
    # Once the length of the file is known: the job, and the first frame that comes.
    begin_chain: Callable[[RenderJob, int], MasterChain]
    spool: FrameSpool | None
    chain: MasterChain | None = None

    def take(self, block: NDArray[np.float64]) -> None:
        """Take the next mixed frames: into the spool, or through the chain at once."""
        receiver = self.spool or self.chain
        assert receiver is not None
        receiver.take(block)


def mix_limiter(stage: Staged, job: RenderJob) -> MixLimiter | None:
    """The limiter of the mix, if the score has one."""
    limit = job.level.limit
    return None if limit is None else MixLimiter(stage.rate, job.format.n_channels, limit)


def master_chain(
    writer: Writer, stage: Staged, job: RenderJob, limiter: FrameLimiter | None, first_frame: int
) -> MasterChain:
    """What is done before a writer to frames of the piece from `first_frame` on."""
    chain = MasterChain(
        writer, stage.rate, job.start, job.stop, limiter, job.silences, first_frame, job.edges
    )
    chain.gain = job.level.gain
    return chain


def open_track(
    stack: contextlib.ExitStack,
    job: RenderJob,
    path: str,
    mixer: Mixer,
    begin_chain: Callable[[RenderJob, int], MasterChain],
) -> OutputTrack:
    """A file at `path`, whose frames are held until `stack` closes, if it has to wait for its gain
    or its length.
    """
    spool = None
    if job.level.is_levelled or job.has_open_end:
        folder = None if path == "-" else Path(path).resolve().parent
        spool = stack.enter_context(FrameSpool(folder, job.format.n_channels))
    return OutputTrack(path, mixer, begin_chain, spool)


def write_spooled_tracks(
    stage: Staged, job: RenderJob, tracks: Sequence[OutputTrack], piece_end: int
) -> None:
    """The second pass, over spooled frames, once the frame at which the piece ends is known.

    The tracks go side by side, for stems follow the limiter of the mix.
    """
    if any(track.spool is None for track in tracks):
        return
    if job.level.is_levelled:
        _set_track_gains(stage, job, tracks, piece_end)
    spools = (track.spool.blocks(job.block_frames) for track in tracks if track.spool is not None)
    for blocks in zip(*spools, strict=True):
        for track, block in zip(tracks, blocks, strict=True):
            if track.chain is not None:
                track.chain.take(block)


def _set_track_gains(
    stage: Staged, job: RenderJob, tracks: Sequence[OutputTrack], piece_end: int
) -> None:
    """The gain of the mix for all tracks; all stems share a smaller one if one of them would clip,
    so that they still add up. What a limiter does to the mix is done to them too.
    """
    mix, *stems = [track.spool for track in tracks if track.spool is not None]
    mix_gain = _measured_gain(stage, job, mix, piece_end)
    shared_gain = mix_gain
    if job.format.bits != "float" and job.level.limit is None:
        ceiling = job.level.normalise or 1.0
        shared_gain = min(
            mix_gain, ceiling_gain(max((stem.peak for stem in stems), default=0.0), ceiling)
        )
    for index, track in enumerate(tracks):
        if track.chain is not None:
            track.chain.gain = shared_gain if index else mix_gain


def _measured_gain(stage: Staged, job: RenderJob, mix: FrameSpool, piece_end: int) -> float:
    level_meter = MeasuredLevel(job.level, stage.rate, job.format.n_channels)
    if job.level.loudness is None and piece_end >= mix.n_frames:
        return level_meter.gain_of_peak(mix.peak)
    frames_left = piece_end
    for block in mix.blocks(job.block_frames):
        level_meter.take(block[:frames_left])
        frames_left = max(frames_left - len(block), 0)
    return level_meter.gain()


def close_track(track: OutputTrack) -> RenderedFile:
    """End a file."""
    chain = track.chain
    assert chain is not None
    chain.close()
    return RenderedFile(
        track.path, chain.peak, chain.loudness, chain.gain, chain.sha256, chain.true_peak
    )
