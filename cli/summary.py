"""What a render says at its end, and before it begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ergon.exchange.wave_header import BYTES

from .console import Console, plural
from .units import decibels, level, octets, seconds

if TYPE_CHECKING:
    from ergon._core import Network, Simulation
    from ergon.rendering.render import Order, Rendered
    from ergon.scores.staging.stage import Stage

_SHORT = 12  # digits of a hash that a person compares


def rendered(
    console: Console, done: Rendered, order: Order, plan_s: float, network: Network
) -> None:
    """One line, or one JSON record; one more for every stem."""
    duration = order.n_frames / order.format.rate
    # What was simulated: a part of a piece is cut from the whole.
    speed = order.stop / order.format.rate / done.wall if done.wall > 0 else 0.0
    mix = done.mix
    peak = decibels(mix.peak)
    if console.json:
        console.record(
            "rendered",
            file=mix.path,
            frames=order.n_frames,
            channels=order.format.n_channels,
            rate_hz=order.format.rate,
            wall_s=done.wall,
            plan_s=plan_s,
            x_real_time=speed,
            peak_dbfs=peak,
            sha256=mix.sha256,
            modules=network.n_mat + network.n_lia,
            threads=order.threads,
        )
        for stem in done.stems:
            console.record(
                "stem", file=stem.path, peak_dbfs=decibels(stem.peak), sha256=stem.sha256
            )
        return
    channels = plural(order.format.n_channels, "channel")
    name = "stdout" if mix.path == "-" else mix.path
    normalised = order.level.normalise is not None
    gain = f" (normalised by {decibels(mix.gain):+.1f} dB)" if normalised else ""
    digits = mix.sha256 if console.verbose else mix.sha256[:_SHORT]
    console.say(
        f"{name}: {seconds(duration)}, {channels}, {speed:.3g} × real time, "
        f"peak {level(peak, 'dBFS')}{gain}, loudness {level(mix.loudness, 'LUFS')}, "
        f"no late blocks, sha256 {digits}"
    )
    for stem in done.stems:
        console.say(f"{stem.path}: peak {level(decibels(stem.peak), 'dBFS')}")
    if done.stems and done.stems[0].gain != mix.gain:
        lower = decibels(done.stems[0].gain / mix.gain)
        console.warn(f"stems are {lower:.1f} dB against the mix, or one of them would clip")
    if order.format.bits != "float":
        for file in (mix, *done.stems):
            if file.peak > 1:
                console.warn(f"{file.path} clips: its peak is {decibels(file.peak):+.1f} dBFS")


def finer(console: Console, simulation: Simulation) -> None:
    """Say of which parts frames were computed finer, one line or record for each."""
    for part, frames, most in simulation.finer():
        if console.json:
            console.record("finer", part=part, frames=frames, most=most)
            continue
        were = "was" if frames == 1 else "were"
        console.say(
            f"{part}: {plural(frames, 'frame')} {were} computed finer, up to {most} times: "
            "there its links stiffen beyond what a frame bears"
        )


def dry_run(console: Console, stage: Stage, order: Order) -> None:
    """What a render would write, and whether its scheme is stable."""
    certificate = stage.network.certify(stage.rate)
    n_files = 1 + (len(stage.stems()) if order.stems is not None else 0)
    size = order.n_frames * order.format.n_channels * BYTES[order.format.bits] * n_files
    held = 0
    if order.level.normalise is not None:
        held = order.stop * order.format.n_channels * 8 * n_files
    # λmax reaches 4 where the scheme diverges (Jury): how much stiffer everything may become.
    margin = 4 / certificate.lambda_max if certificate.lambda_max > 0 else float("inf")
    if console.json:
        console.record(
            "plan",
            file=order.target,
            frames=order.n_frames,
            simulated_frames=order.stop,
            channels=order.format.n_channels,
            rate_hz=order.format.rate,
            bits=order.format.bits,
            files=n_files,
            disk_bytes=size,
            temporary_bytes=held,
            modules=stage.network.n_mat + stage.network.n_lia,
            lambda_max=certificate.lambda_max,
            margin=margin,
            certificate=certificate.word,
        )
        return
    channels, bits = plural(order.format.n_channels, "channel"), order.format.bits
    form = f"{order.format.rate} Hz, " + ("32-bit float" if bits == "float" else f"{bits} bits")
    steps = order.stop * (stage.network.n_mat + stage.network.n_lia)
    lines = [
        f"{order.target}: {seconds(order.n_frames / order.format.rate)}, {channels}, {form}",
        f"disk: {octets(size)} in {plural(n_files, 'file')}, {octets(held)} more while it runs",
        f"cost: {plural(stage.network.n_mat, 'MAT')} and {plural(stage.network.n_lia, 'LIA')} for "
        f"{order.stop:,} frames, {steps:.3g} module-steps",
        f"stability: {certificate.word} ({certificate.method}); everything could be "
        f"{margin:.3g} times as stiff",
    ]
    console.data("\n".join(lines) + "\n")
