"""`ergon fold`: a sound file of many channels for two ears, stereo, Ambisonics or another room."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options
from .console import Console, plural
from .outcome import check_stdout
from .units import decibels, level_text, seconds_text

if TYPE_CHECKING:
    from ergon.exchange.wave_header import Bits


@click.command()
@click.argument("source", metavar="IN.wav")
@click.option(
    "--to",
    required=True,
    metavar="WHERE",
    help="binaural, stereo, ambix1 … ambix7 (ACN, SN3D), or a layout: a file, or one that ships.",
)
@click.option(
    "--layout",
    metavar="WHAT",
    help="What IN.wav holds: a layout, or ambix1 … ambix7. Without it as the file says (ADM).",
)
@click.option("--head", metavar="FILE.sofa", help="Another head for binaural sound.")
@click.option(
    "--gain",
    metavar="LEVEL",
    help="Gain, such as -6dB. Without it, none, or as much down as keeps it from clipping.",
)
@options.target("The file to write; - is stdout. Default: IN-WHERE.wav in the current folder.")
@options.bits
@options.force
@options.with_console
def fold(
    console: Console,
    source: str,
    to: str,
    layout: str | None,
    head: str | None,
    gain: str | None,
    output: str | None,
    bits: Bits | None,
    force: bool,
) -> None:
    """Fold a sound file of many channels for other ears.

    Loudspeakers become two ears by the filters of a head, stereo by constant power, Ambisonics as
    plane waves, and other loudspeakers by VBAP; Ambisonics is decoded by AllRAD. Files may be of
    any length; the same input gives the same bytes.
    """
    from ergon.api.fold import FoldOptions, fold_file

    check_stdout(output, is_json=console.json)
    output_path = output or f"{Path(source).stem}-{Path(to).stem}.wav"
    fold_options = FoldOptions(layout=layout, head=head, gain=gain, bits=bits, force=force)
    folded = fold_file(source, output_path, to, fold_options, report=console)
    if gain is None and folded.gain < 1.0:
        console.warn(
            f"{folded.path} is turned down by {-decibels(folded.gain):.2f} dB, for it would clip; "
            "--bits float keeps its level"
        )
    if console.json:
        console.record(
            "folded",
            file=folded.path,
            channels=folded.n_channels,
            frames=folded.n_frames,
            peak=folded.peak,
            true_peak_dbtp=decibels(folded.true_peak),
            gain_db=decibels(folded.gain),
            sha256=folded.sha256,
        )
    else:
        peaks_text = f"peak {level_text(decibels(folded.peak), 'dBFS')}"
        if folded.peak:
            peaks_text += f", true peak {level_text(decibels(folded.true_peak), 'dBTP')}"
        channels_text = plural(folded.n_channels, "channel")
        duration_text = seconds_text(folded.n_frames / folded.rate)
        console.say(f"{folded.path}: {channels_text}, {duration_text}, {peaks_text}")
