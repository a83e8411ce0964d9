"""A score into samples: as an array, or as WAV files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ergon.common.report import Report
from ergon.common.shown_paths import is_from_pack
from ergon.exchange.sound import check_ending
from ergon.exchange.wave_header import Bits, Stamp, WaveFormat

from . import score as scores
from .chosen_routes import choose_routes
from .errors import OptionError, ScoreError
from .layouts import chunks_of_layout
from .options import FileOptions, RenderOptions
from .pictures import Picture, audio_html

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Network
    from ergon.live.recorded import HandRecording
    from ergon.notation.text.errors import Diagnostic
    from ergon.rendering.job import RenderedFiles, RenderJob
    from ergon.scores.reading.load import Loaded
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Reports, Stage

    from .cluster import Cluster

_FAINT_PEAK = 0.01  # -40 dBFS
_UNNAMED_SCORE = "piece.yaml"  # a score of which only the text is known


@dataclass(frozen=True, slots=True)
class Render:
    """The sound of a score in memory.

    `frames` (n_frames, n_channels) are the samples, 1.0 at full scale, at `rate` [Hz]. `peak` is
    the largest absolute sample, `true_peak` that between samples too, `loudness` the integrated
    loudness [LUFS], `gain` the ratio by which the mix was multiplied.
    """

    frames: NDArray[np.float64]
    rate: float
    peak: float
    loudness: float
    gain: float
    true_peak: float

    def plot(self, title: str = "") -> Picture:
        """Waveform and spectrogram of the mean of all channels."""
        from ergon.view.sound import picture

        return Picture(picture([self.frames], len(self.frames), self.rate, title))

    def _repr_html_(self) -> str:
        return audio_html(self.frames, self.rate) + self.plot().svg


@dataclass(frozen=True, slots=True)
class PreparedRender:
    """A score ready to be rendered."""

    loaded: Loaded
    stage: Stage
    job: RenderJob
    plan_s: float
    options: RenderOptions = field(default_factory=RenderOptions)


@dataclass(frozen=True, slots=True)
class Completed:
    """Files that were written, with the job and network behind them, and what the simulation
    reports.
    """

    files: RenderedFiles
    job: RenderJob
    plan_s: float
    network: Network
    reports: Reports
    faint: tuple[Diagnostic, ...] = ()  # W324, W325: a file that is silent, or nearly


def faint_diagnostics(piece: Piece, bits: Bits, peak: float) -> list[Diagnostic]:
    """W324 for a silent file, W325 for one whose highest peak lies below -40 dBFS.

    A file of floats without a master is a measurement: any level is allowed.
    """
    from ergon.notation.text.errors import Diagnostic

    mix_place = piece.mix.place or piece.place
    if _is_silent(bits, peak):
        help_text = "`ergon check --simulate` says what moves and what touches"
        return [Diagnostic("W324", "the file is silent", mix_place, None, help_text)]
    if peak >= _FAINT_PEAK or (bits == "float" and piece.mix.master is None):
        return []
    message = f"the highest peak of the file is {20.0 * math.log10(peak):.1f} dBFS, below -40 dBFS"
    help_text = (
        "raise the gain of its routes, or let the master do it: `master: {loudness: -20LUFS}`"
    )
    return [Diagnostic("W325", message, mix_place, None, help_text)]


def _is_silent(bits: Bits, peak: float) -> bool:
    """Whether every sample is 0; for whole numbers, whether the highest peak is rounded to 0."""
    import numpy as np

    from ergon import _core

    if not isinstance(bits, int):
        return peak == 0.0
    return not _core.pcm(np.array([[peak], [-peak]]), 1.0, 16 if bits == 16 else 24).any()


def render(
    score: str | Path | None = None,
    options: RenderOptions | None = None,
    *,
    text: str | None = None,
    report: Report | None = None,
) -> Render:
    """The sound of a score in memory: the samples of `render_to_file` before they are rounded.

    A `text` is the text of the score; files that it names are then looked for beside `score`, or in
    the working folder.
    `report` hears of warnings and of progress. Raises ScoreError, DivergedError and OptionError.
    """
    from ergon.rendering.render import render_array

    options, report = options or RenderOptions(), report or Report()
    if text is not None:
        options = replace(options, text=text)
    if score is None:
        if options.text is None:
            raise OptionError("score", "name a score, or give its text: render(text=…)")
        score = _UNNAMED_SCORE
    loaded = scores.read(score, options, report)
    prepared = prepare(loaded, "-", options, report)
    job = replace(prepared.job, format=replace(prepared.job.format, bits="double"))
    with (
        _job_with_workers(prepared, job, report) as job,
        _render_progress(prepared, "rendering", report) as progress,
    ):
        frames, outcome, prepared.stage.reports = render_array(prepared.stage, job, progress)
    levels = outcome.peak, outcome.loudness, outcome.gain, outcome.true_peak
    return Render(frames, prepared.stage.rate, *levels)


def prepare(loaded: Loaded, target: str, options: RenderOptions, report: Report) -> PreparedRender:
    """Plan and stage a score, and decide what is written to `target`."""
    check_ending(target)
    file_options = options if isinstance(options, FileOptions) else FileOptions()
    if file_options.see not in (None, "all"):
        raise OptionError("see", "the only possible value is all", value=file_options.see)
    if file_options.see and not file_options.motion:
        raise OptionError("see", "this needs a motion file; add the option motion")
    if file_options.wet and file_options.stems is None:
        raise OptionError("wet", "this is about stems; add the option stems")
    if options.on is not None:
        check_shared(options)
    recorded = _read_hand_recording(loaded, options, report)
    loaded, complete_piece = _with_inputs(loaded, options), loaded.piece
    loaded = choose_routes(loaded, options.only, options.except_)
    staged_score = scores.stage_piece(
        loaded,
        options,
        report,
        rate=options.rate,
        threads=options.threads,
        real_hands=None if recorded is None else recorded.positions,
        is_seen=file_options.see is not None,
        recalls_sound=True,
        complete=complete_piece,
    )
    job = job_of(staged_score.piece, staged_score.stage, target, options)
    job = replace(job, inputs=(*loaded.inputs, *options.files))
    if recorded is not None:
        job = replace(job, level=recorded.level)
    elif options.input is not None and not job.level.is_levelled:
        job = replace(job, level=scores.played_level(staged_score.piece))
    if file_options.motion:
        from .film import film

        job = replace(job, motion=film(staged_score.stage, job))
    return PreparedRender(loaded, staged_score.stage, job, staged_score.plan_s, options)


def write(prepared: PreparedRender, report: Report, cluster: Cluster | None = None) -> Completed:
    """Compute the files of a prepared score, with the help of a `cluster` that is open.

    Raises DivergedError, FileRefusedError and ClusterError.
    """
    from ergon.rendering.render import render_files

    stage, job = prepared.stage, prepared.job
    task = f"rendering {Path(job.target).name}"
    with (
        _job_with_workers(prepared, job, report, cluster) as job,
        _render_progress(prepared, task, report) as progress,
    ):
        rendered = render_files(stage, job, progress)
        stage.reports = rendered.outcome
    job = replace(job, stop=job.start + rendered.n_frames)
    faint_warnings = tuple(faint_diagnostics(stage.piece, job.format.bits, rendered.mix.peak))
    scores.show(report, prepared.loaded, faint_warnings)
    reports = stage.simulation if stage.reports is None else stage.reports
    return Completed(rendered, job, prepared.plan_s, stage.network, reports, faint_warnings)


def check_shared(options: RenderOptions) -> None:
    """Refuse options that other processes cannot serve. Raises OptionError."""
    is_motion = isinstance(options, FileOptions) and options.motion
    excluded_options = {
        "hands": options.hands is not None,
        "input": options.input is not None,
        "motion": is_motion,
        "only": options.only is not None,
        "except_": options.except_ is not None,
        "trust": options.trust,
    }
    for name, is_given in excluded_options.items():
        if is_given:
            raise OptionError("on", "; leave one of the two out", excludes=name)


@contextmanager
def _job_with_workers(
    prepared: PreparedRender, job: RenderJob, report: Report, cluster: Cluster | None = None
) -> Iterator[RenderJob]:
    """The job, with the processes that share its work if there are any."""
    cluster_address = prepared.options.on
    if cluster_address is None:
        yield job
        return
    from .cluster import job_of, open_cluster, share_work

    options = prepared.options
    cluster_job = job_of(prepared.loaded, prepared.stage, options.rate, options.seed)
    with (
        open_cluster(cluster_address, report)
        if cluster is None
        else nullcontext(cluster) as workers
    ):
        yield replace(job, workers=share_work(workers, cluster_job))


def job_of(piece: Piece, stage: Stage, target: str, options: RenderOptions) -> RenderJob:
    """What is written, from the options and the score. Raises OptionError."""
    from ergon.exchange.stretch_store import user_store
    from ergon.rendering.edges import Edges
    from ergon.rendering.job import RenderJob

    bits: Bits = options.bits or piece.render.bits
    n_channels = options.channels or piece.render.channels or stage.n_channels
    start_frame = (
        0 if options.from_ is None else _frame_of_position(piece, stage, options.from_, "from_")
    )
    stop_frame = (
        stage.n_frames
        if options.until is None
        else _frame_of_position(piece, stage, options.until, "until")
    )
    stop_frame = min(stop_frame, stage.n_frames)
    if not stage.n_frames:
        job_reason = (
            "the piece has no length: nothing in it is struck or played, and a take that drives a "
            "module does not count; write how long it is heard, such as `render: {tail: 2s}`"
        )
        raise ScoreError((), reason=job_reason)
    if start_frame >= stop_frame:
        end = scores.where(piece, stage.n_frames / stage.rate)
        option = "from_" if options.until is None else "until"
        raise OptionError(option, f"the part to render is empty; the piece ends at {end}")
    file_options = options if isinstance(options, FileOptions) else FileOptions()
    return RenderJob(
        target=target,
        format=WaveFormat(scores.integer_rate(stage.rate), n_channels, bits),
        start=start_frame,
        stop=stop_frame,
        level=scores.level_of(piece, bits),
        stamp=Stamp(
            piece.title,
            scores.digest(piece),
            stage.plan.hash if stage.plan else "",
            chunks_of_layout(piece.mix.layout, n_channels, piece.title),
            tuple(scores.mark_frames(piece, stage.rate, start_frame)),
        ),
        stems=None if file_options.stems is None else Path(file_options.stems),
        splits_stems=file_options.wet,
        block_frames=options.block,
        threads=options.threads,
        force=file_options.force,
        fades_from=stage.fade_start,
        is_part=options.until is not None,
        # The end of a written `tail` stays: a performance ends so, and a render is equal to it.
        edges=Edges(start_frame > 0, options.until is not None),
        stretches=user_store(),
        # A draft leaves out what takes about as long as mixing.
        stores_mix=not options.draft,
        measures_instruments=not options.draft,
    )


def target(score: str | Path, loaded: Loaded, out: str | Path | None) -> str:
    """The WAV file to write: as asked, as the score says, or SCORE.wav in the current folder.

    Nothing is written beside a score that ships, and a score from a pack chooses no name.
    """
    from ergon.notation.text.files import is_shipped

    if out is not None:
        return str(out)
    piece = scores.piece_of(loaded)
    is_stdin = str(score) == scores.STDIN
    names_its_file = not is_shipped(Path(score)) and not is_from_pack(score)
    if piece.render.file is not None and names_its_file:
        # Paths are relative to the file that names them.
        folder = Path() if is_stdin else Path(score).parent
        return str(folder / piece.render.file)
    if is_stdin:
        raise OptionError("output", "a score from stdin has no name for the WAV file; name one")
    return Path(score).with_suffix(".wav").name


@contextmanager
def _render_progress(
    prepared: PreparedRender, task: str, report: Report
) -> Iterator[Callable[[int], None]]:
    """Show progress, and report faults as `computing` does."""
    stage = prepared.stage
    n_frames = prepared.job.simulated_frames(stage.n_frames)
    with (
        scores.computing(stage, prepared.loaded, report),
        report.progress(task, n_frames, stage.rate) as progress,
    ):
        yield progress.update


def _with_inputs(loaded: Loaded, render_options: RenderOptions) -> Loaded:
    """The score, with its inputs taken from the file `input`. Raises OptionError."""
    if render_options.input is None:
        return loaded
    piece = scores.piece_of(loaded)
    path = Path(render_options.input)
    card_takes = {name for name, take in piece.takes.items() if take.card_channel}
    if not card_takes:
        raise OptionError("input", "this score has no inputs; leave the option out")
    if path.suffix.lower() != ".wav" or not path.is_file():
        raise OptionError("input", "this is not a .wav file that exists", value=str(path))
    takes = {
        name: replace(take, path=path, channel=None) if name in card_takes else take
        for name, take in piece.takes.items()
    }
    return replace(loaded, piece=replace(piece, takes=takes))


def _read_hand_recording(
    loaded: Loaded, render_options: RenderOptions, report: Report
) -> HandRecording | None:
    """The recorded hands, if a recording is given. Raises OptionError."""
    if render_options.hands is None:
        return None
    from ergon.live.recorded import RecordingMismatchError, read_hand_recording

    piece = scores.piece_of(loaded)
    piece_at_rate = (
        piece if render_options.rate is None else replace(piece, rate=render_options.rate)
    )
    try:
        hand_recording = read_hand_recording(Path(render_options.hands), piece_at_rate)
    except RecordingMismatchError as error:
        raise OptionError("hands", str(error)) from None
    for warning in hand_recording.warnings:
        report.warn(f"{render_options.hands}: {warning}")
    return hand_recording


def _frame_of_position(piece: Piece, stage: Stage, position: str, option: str) -> int:
    """The frame of a position: an instant t falls on sample floor(t·rate + ½)."""
    return int(scores.instant(piece, position, option) * stage.rate + 0.5)
