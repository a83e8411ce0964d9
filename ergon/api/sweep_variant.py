"""One variant of a sweep, computed by a process that may run on another machine.

Arguments and results are plain data: bytes, texts and numbers.
"""

from __future__ import annotations

import io
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypedDict

from ergon.common.errors import ErgonError
from ergon.common.report import Report

from . import score as scores
from .errors import DivergedError
from .options import RenderOptions
from .render import prepare
from .score_bundle import ScoreBundle, unpack, with_local_paths

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .render import PreparedRender

Figures = dict[str, float | None]


class Outcome(TypedDict):
    """What became of a variant: its figures and sound file, or why there is none.

    `status` is "ok", "refused" or "diverged"; `sound` is empty where it was not asked for.
    """

    status: str
    reason: str
    figures: Figures
    sound: bytes


def compute_variant(content: ScoreBundle, options: dict[str, Any], name: str) -> Outcome:
    """Render a variant with `options` as RenderOptions; `name` is its sound file, "" for none."""
    with unpack(content) as path:
        try:
            figures, sound_data = _computed_variant(str(path), RenderOptions(**options), name)
        except ErgonError as error:
            status = "diverged" if isinstance(error, DivergedError) else "refused"
            reason = with_local_paths(str(error), path, content)
            return Outcome(status=status, reason=reason, figures={}, sound=b"")
    return Outcome(status="ok", reason="", figures=figures, sound=sound_data)


def compute_on_worker(
    version: list[Any], content: ScoreBundle, options: dict[str, Any], name: str
) -> Outcome:
    """Compute a variant on a worker of a cluster. Raises ClusterError if its ergon is another
    version.
    """
    from . import cluster_worker

    cluster_worker.check_version(version)
    with cluster_worker.staging_lock:
        return compute_variant(content, options, name)


def _computed_variant(
    path: str, render_options: RenderOptions, file_name: str
) -> tuple[Figures, bytes]:
    from ergon.rendering.measures import measure_sound
    from ergon.rendering.render import render_array

    loaded = scores.read(path, render_options)
    prepared = prepare(loaded, file_name or "-", render_options, Report())
    stage = prepared.stage
    job = replace(prepared.job, format=replace(prepared.job.format, bits="double"), stretches=None)
    start_time, start_cpu = time.perf_counter(), time.process_time()
    with scores.computing(stage, loaded, Report()):
        mix_frames, outcome, _ = render_array(stage, job, lambda _: None)
    cpu_seconds, wall_seconds = time.process_time() - start_cpu, time.perf_counter() - start_time
    sound_measures = measure_sound(mix_frames, stage.rate)
    plan_rows = stage.plan.rows() if stage.plan is not None else []
    errors = [row.error_db for row in plan_rows if row.error_db is not None]
    audible_differences = [row.audible for row in plan_rows if row.audible is not None]
    cents = [
        abs(difference.cents) for difference in audible_differences if difference.cents is not None
    ]
    figures: Figures = {
        "seconds": len(mix_frames) / stage.rate,
        "loudness_lufs": outcome.loudness,
        "peak_db": _level_db(outcome.peak),
        "centroid_hz": sound_measures.centroid,
        "pitch_hz": sound_measures.pitch,
        "partial_hz": sound_measures.partial,
        "t60_s": sound_measures.t60,
        "cpu_s": cpu_seconds,
        "x_real_time": len(mix_frames) / stage.rate / wall_seconds,
        "plan_cost": sum(row.cost for row in plan_rows),
        "error_db": max(errors, default=None),
        "error_cents": max(cents, default=None),
    }
    return figures, _sound_file_bytes(file_name, prepared, mix_frames) if file_name else b""


def _sound_file_bytes(
    file_name: str, prepared: PreparedRender, mix_frames: NDArray[np.float64]
) -> bytes:
    """The bytes of the file that `ergon render` writes."""
    from ergon import _core
    from ergon.exchange import sound

    job, wave_file = prepared.job, io.BytesIO()
    writer = sound.writer(file_name, wave_file, job.format, len(mix_frames), job.stamp)
    bits = job.format.bits
    samples: Any = mix_frames
    if bits == "float":
        samples = _core.single(mix_frames, 1.0)
    elif bits != "double":
        samples = _core.pcm(mix_frames, 1.0, 16 if bits == 16 else 24)
    writer.write(samples)
    writer.close()
    return wave_file.getvalue()


def _level_db(ratio: float) -> float | None:
    return 20.0 * math.log10(ratio) if ratio > 0.0 else None
