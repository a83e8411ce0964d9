"""The summaries of a render: what was written, and under --dry-run what would be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ergon.exchange.wave_header import BYTES_BY_FORM
from ergon.rendering.balance import dominant_instrument
from ergon.rendering.loudness import TRUE_PEAK_DB_MAX

from .console import Console, plural
from .units import decibels, level_text, loudness_of, octets_text, seconds_text

if TYPE_CHECKING:
    from ergon.api.render import Completed
    from ergon.rendering.job import RenderedFile, RenderJob
    from ergon.rendering.level import Level
    from ergon.scores.staging.stage import Reports, Stage

_QUIETER_LU_MIN = 0.5  # [LU] below what was asked for: worth a line
_HASH_DIGITS_SHOWN = 12  # digits of a hash that are shown
_GUARANTEES = ("proved", "guarded", "tried")  # from the strongest to the weakest
# The scheme diverges at this λmax (Jury): the ratio is how much stiffer everything may become.
_LAMBDA_LIMIT = 4.0


def print_rendered(console: Console, completed: Completed) -> None:
    """One line, or one JSON record, for the mix; one more for each instrument, motion file and
    stem.
    """
    # The speed counts all simulated frames: a part of a piece is cut from the whole.
    files, rate = completed.files, completed.job.format.rate
    speed = files.n_simulated / rate / files.wall_seconds if files.wall_seconds > 0 else 0.0
    if console.json:
        _record_rendered(console, completed, speed)
        return
    _say_rendered(console, completed, speed)
    _warn_of_levels(console, completed)


def _record_rendered(console: Console, completed: Completed, speed: float) -> None:
    """The JSON records of a render, whose `speed` is a multiple of real time."""
    render_files, job, network = completed.files, completed.job, completed.network
    mix = render_files.mix
    console.record(
        "rendered",
        file=mix.path,
        frames=job.n_frames,
        channels=job.format.n_channels,
        rate_hz=job.format.rate,
        wall_s=render_files.wall_seconds,
        plan_s=completed.plan_s,
        x_real_time=speed,
        peak_dbfs=decibels(mix.peak),
        true_peak_dbtp=decibels(mix.true_peak),
        loudness_lufs=mix.loudness,
        gain_db=decibels(mix.gain),
        sha256=mix.sha256,
        modules=network.n_mat + network.n_lia,
        threads=job.threads,
        recalled=render_files.recalled_share,
    )
    for instrument in render_files.instruments:
        peak, loudness = decibels(instrument.peak), instrument.loudness
        console.record("instrument", name=instrument.name, peak_dbfs=peak, loudness_lufs=loudness)
    if job.motion is not None:
        duration = job.motion.last_sample_frame / job.format.rate
        console.record("motion", file=str(job.motion.path), duration_s=duration)
    for stem in render_files.stems:
        console.record(
            "stem",
            file=stem.path,
            peak_dbfs=decibels(stem.peak),
            true_peak_dbtp=decibels(stem.true_peak),
            loudness_lufs=stem.loudness,
            gain_db=decibels(stem.gain),
            sha256=stem.sha256,
        )


def _say_rendered(console: Console, completed: Completed, speed: float) -> None:
    """The lines of a render, whose `speed` is a multiple of real time, with what is unbalanced."""
    render_files, job = completed.files, completed.job
    mix, duration = render_files.mix, job.n_frames / job.format.rate
    peak = decibels(mix.peak)
    channels_text = plural(job.format.n_channels, "channel")
    gain_text = f", gain {decibels(mix.gain):+.1f} dB" if job.level.is_levelled else ""
    recalled_text = (
        f" ({render_files.recalled_share:.0%} recalled)" if render_files.recalled_share > 0 else ""
    )
    loudness_text = loudness_of(mix.loudness, mix.peak, duration)
    shown_hash = mix.sha256 if console.verbose else mix.sha256[:_HASH_DIGITS_SHOWN]
    console.say(
        f"{_name_of(mix)}: {seconds_text(duration)}, {channels_text}, {speed:.3g} × real "
        f"time{recalled_text}, peak {level_text(peak, 'dBFS')}, true peak "
        f"{level_text(decibels(mix.true_peak), 'dBTP')}, "
        f"loudness {loudness_text}{gain_text}, sha256 {shown_hash}"
    )
    if job.start == 0 and not job.is_part:
        _say_if_quieter(console, job.level, mix)
    for instrument in render_files.instruments:
        console.say(
            f"{instrument.name}: peak {level_text(decibels(instrument.peak), 'dBFS')}, "
            f"loudness {loudness_of(instrument.loudness, instrument.peak, duration)}"
        )
    if (dominant := dominant_instrument(render_files.instruments)) is not None:
        loudest, loudness_above = dominant
        console.warn(
            f"{loudest.name} is {loudness_above:.0f} dB louder than every other instrument; "
            "lower the gain of its route, or raise the others'"
        )
    if job.motion is not None:
        motion_length = seconds_text(job.motion.last_sample_frame / job.format.rate)
        console.say(f"{job.motion.path}: what moves, {motion_length}")
    for stem in render_files.stems:
        console.say(f"{stem.path}: peak {level_text(decibels(stem.peak), 'dBFS')}")


def _warn_of_levels(console: Console, completed: Completed) -> None:
    """Warn of stems below the mix, of silence, and of files that clip."""
    render_files, mix = completed.files, completed.files.mix
    if render_files.stems and render_files.stems[0].gain != mix.gain:
        stem_db = decibels(render_files.stems[0].gain / mix.gain)
        console.warn(f"stems are {stem_db:+.1f} dB against the mix, where one of them would clip")
    if mix.peak == 0 and not completed.faint:  # a journal's render has no place in a score
        name = _name_of(mix)
        console.warn(f"{name} is silent; `ergon check --simulate` says what moves and what touches")
    if completed.job.format.bits != "float":
        for file in (mix, *render_files.stems):
            if file.peak > 1:
                clip_text = f"{file.path} clips: its peak is {decibels(file.peak):+.1f} dBFS"
                console.warn(
                    f"{clip_text}; lower the gain of its routes, or limit it in the master"
                )


def _name_of(mix: RenderedFile) -> str:
    return "stdout" if mix.path == "-" else mix.path


def _say_if_quieter(console: Console, level_asked: Level, mix: RenderedFile) -> None:
    """Say why the file of a whole piece is not as loud as its master asks."""
    if level_asked.loudness is None or mix.loudness == -math.inf:
        return
    loudness_below = level_asked.loudness - mix.loudness
    if loudness_below >= _QUIETER_LU_MIN and level_asked.limit is None:
        console.say(
            f"{mix.path} is {loudness_below:.1f} dB below the {level_asked.loudness:g} LUFS of its "
            f"master, since the highest peak of the piece is at {TRUE_PEAK_DB_MAX:g} dBTP; `limit: "
            "-2dB` in the master lets it be louder"
        )


def _guarantee(stage: Stage) -> str:
    """The weakest guarantee of stability among the parts of the plan that is rendered."""
    rows = stage.plan.rows() if stage.plan is not None else []
    guarantees = [row.guarantee for row in rows if row.guarantee is not None]
    return max(guarantees, key=_GUARANTEES.index, default=_GUARANTEES[0])


def _lambda_max(stage: Stage) -> float | None:
    """λmax of all modules stepped once a frame; None if that would diverge, so that the plan takes
    modes, other methods or more steps.
    """
    from ergon import _core

    try:
        return stage.network.certify(stage.rate).lambda_max
    except _core.EngineError:
        return None


def _plain_stability(margin: float | None) -> str:
    if margin is None:
        return "module by module, once a frame, it would diverge"
    return f"module by module, once a frame, everything could be {margin:.3g} times as stiff"


def print_finer_steps(console: Console, reports: Reports) -> None:
    """Say for which parts frames were computed in finer steps, one line or record for each."""
    for part_name, finer_frames, largest in reports.finer():
        if console.json:
            console.record("finer", part=part_name, frames=finer_frames, most=largest)
            continue
        were = "was" if finer_frames == 1 else "were"
        console.say(
            f"{part_name}: {plural(finer_frames, 'frame')} {were} computed finer, up to {largest} "
            "times: there its links are too stiff for one frame"
        )


def dry_run(console: Console, stage: Stage, job: RenderJob) -> None:
    """Say what a render would write, and how sure it is that its plan is stable."""
    guarantee = _guarantee(stage)
    n_files = 1 + (len(stage.stems(is_split=job.splits_stems)) if job.stems is not None else 0)
    output_bytes = job.n_frames * job.format.n_channels * BYTES_BY_FORM[job.format.bits] * n_files
    simulated = job.simulated_frames(stage.n_frames)
    n_bytes_kept = 0
    if job.level.is_levelled:
        n_bytes_kept = simulated * job.format.n_channels * 8 * n_files
    lambda_max = _lambda_max(stage)
    margin = None if lambda_max is None else _LAMBDA_LIMIT / lambda_max if lambda_max else math.inf
    if console.json:
        console.record(
            "plan",
            file=job.target,
            frames=job.n_frames,
            simulated_frames=simulated,
            channels=job.format.n_channels,
            rate_hz=job.format.rate,
            bits=job.format.bits,
            files=n_files,
            disk_bytes=output_bytes,
            temporary_bytes=n_bytes_kept,
            modules=stage.network.n_mat + stage.network.n_lia,
            lambda_max=lambda_max,
            margin=margin,
            certificate=guarantee,
        )
        return
    channels_text, bits = plural(job.format.n_channels, "channel"), job.format.bits
    format_text = f"{job.format.rate} Hz, " + (
        "32-bit float" if bits == "float" else f"{bits} bits"
    )
    bound_text = "at most " if job.has_open_end else ""
    n_module_steps = simulated * (stage.network.n_mat + stage.network.n_lia)
    job_lines = [
        f"{job.target}: {bound_text}{seconds_text(job.n_frames / job.format.rate)}, "
        f"{channels_text}, {format_text}",
        f"disk: {octets_text(output_bytes)} in {plural(n_files, 'file')}, "
        f"{octets_text(n_bytes_kept)} more while it runs",
        f"cost: {plural(stage.network.n_mat, 'MAT')} and {plural(stage.network.n_lia, 'LIA')} for "
        f"{simulated:,} frames, {n_module_steps:.3g} module-steps",
        f"stability: {guarantee}, as planned; {_plain_stability(margin)}",
    ]
    console.data("\n".join(job_lines) + "\n")
