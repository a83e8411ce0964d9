"""`ergon layout noise`: each loudspeaker in turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from . import options
from .console import Console, plural
from .outcome import DeviceMissing, Refused
from .units import seconds_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon.instruments.model import Layout

_SILENCE_SECONDS = 0.25  # [s] of silence after each burst


@click.command()
@click.argument("name", metavar="LAYOUT")
@options.target("The WAV file to write.")
@click.option(
    "--audio", metavar="WHERE", help="Play it: jack[:PORTS], pulse[:SINK], file:PATH, null or auto."
)
@click.option(
    "--seconds",
    type=options.Number(0.05, 60, "DURATION"),
    default=1.0,
    show_default=True,
    help="How long each sounds.",
)
@click.option("--level", default="-20dB", show_default=True, help="Its rms below full scale.")
@click.option(
    "--rate",
    type=options.Number(8_000, 192_000, "RATE"),
    default=48_000,
    show_default=True,
    help="[Hz]",
)
@options.force
@options.with_console
def noise(
    console: Console,
    name: str,
    output: str | None,
    audio: str | None,
    seconds: float,
    level: str,
    rate: float,
    force: bool,
) -> None:
    """Noise from each loudspeaker in turn, as a file (-o) or live (--audio).

    It is pink, and the same samples each time. A file says where its loudspeakers are (ADM).
    """
    from ergon.api.layouts import read_layout
    from ergon.space.noise import pink_noise_burst

    if (output is None) == (audio is None):
        raise Refused("give -o FILE.wav or --audio auto")
    ratio = _ratio(level)
    layout = read_layout(name, console)
    if not rate.is_integer():
        raise Refused(f"--rate: a file has whole frames a second, not {rate:g}")
    rate = int(rate)
    noise_frames = pink_noise_burst(seconds, rate, ratio)
    if output is not None:
        _write(console, layout, output, noise_frames, rate, force=force)
    else:
        _play(console, layout, audio or "auto", noise_frames, rate)


def _write(
    console: Console,
    layout: Layout,
    output_path: str,
    noise_frames: NDArray[np.float64],
    rate: int,
    *,
    force: bool,
) -> None:
    import numpy as np

    from ergon import _core
    from ergon.api.layouts import chunks_of_layout
    from ergon.exchange import sound as sound_files
    from ergon.exchange.safe import open_for_writing
    from ergon.exchange.wave_header import Stamp, WaveFormat

    n_speakers = len(layout.speakers)
    n_channels = layout.n_channels
    n_silent_frames = int(_SILENCE_SECONDS * rate)
    n_frames_each = len(noise_frames) + n_silent_frames
    wave_format = WaveFormat(rate, n_channels, 24)
    title = f"noise, {layout.title or layout.path.stem}"
    stamp = Stamp(title, chunks=chunks_of_layout(layout, n_channels, title))
    sound_files.check_format(output_path, wave_format)
    with open_for_writing(output_path, binary=True, force=force, inputs=(layout.path,)) as file:
        writer = sound_files.writer(
            output_path, file, wave_format, n_speakers * n_frames_each, stamp
        )
        for channel in sorted(layout.channels):
            frames = np.zeros((n_frames_each, n_channels))
            frames[: len(noise_frames), channel] = noise_frames
            writer.write(_core.pcm(frames, 1.0, 24))
        writer.close()
    total_seconds = n_speakers * n_frames_each / rate
    if console.json:
        console.record("wrote", file=output_path, channels=n_channels, seconds=total_seconds)
    else:
        console.say(
            f"wrote {output_path}: {plural(n_channels, 'channel')}, {seconds_text(total_seconds)}"
        )


def _play(
    console: Console, layout: Layout, audio: str, noise_frames: NDArray[np.float64], rate: int
) -> None:
    import numpy as np

    from ergon import _core
    from ergon.space.directions import angles

    for channel_index, place in sorted(zip(layout.channels, layout.speakers, strict=True)):
        azimuth, elevation, _ = angles(place)
        console.say(f"{channel_index + 1}: azimuth {azimuth:.0f}°, elevation {elevation:.0f}°")
        played_frames = np.zeros(
            (len(noise_frames) + int(_SILENCE_SECONDS * rate), layout.n_channels), np.float32
        )
        played_frames[: len(noise_frames), channel_index] = noise_frames
        try:
            _core.play_frames(played_frames, rate, audio)
        except _core.EngineError as error:
            outcome_class = Refused if error.module == "record" else DeviceMissing
            raise outcome_class(f"--audio {audio}: {error}") from None


def _ratio(level_text: str) -> float:
    from ergon.notation.tables.quantities import gain
    from ergon.notation.text.errors import TextError

    try:
        amplitude_ratio = gain(level_text)
    except TextError as error:
        raise Refused(f"--level: {error.message}") from None
    if amplitude_ratio > 0.5:
        raise Refused("--level: noise louder than -6dB would clip; write -20dB")
    return amplitude_ratio
