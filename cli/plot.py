"""`ergon plot`: a gesture asked and done, or the sound of a render, as a picture."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.options import ReadOptions
from ergon.api.plot import NOTES_NAME, drawn_curves, struck_bars
from ergon.common.sound_files import is_sound

from . import options
from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ergon.scores.reading.load import Loaded
    from ergon.view.curve import Curve

_WIDTH_MAX = 160  # columns: wider is harder to read, not finer


@click.command()
@options.score
@click.argument("name", required=False)
@click.option("--key", metavar="KEY", help="Play NAME alone on this key instead of in the piece.")
@click.option("--svg", metavar="FILE", help="Write an SVG picture to this file; - is stdout.")
@click.option(
    "--width", type=click.IntRange(24, 1000), help="Width in characters. Default: the terminal's."
)
@click.option(
    "--height", type=click.IntRange(5, 1000), default=20, show_default=True, help="Height in lines."
)
@options.force
@options.trust
@options.with_console
def plot(
    console: Console,
    score_path: str,
    name: str | None,
    key: str | None,
    svg: str | None,
    width: int | None,
    height: int,
    force: bool,
    trust: bool,
) -> None:
    """Draw a gesture as written and as played, in the terminal or as SVG.

    NAME is a gesture, a take or a player of the score: what is drawn is its first time in the
    piece, or for a player the whole part. `notes` draws what is struck, a line for each note. SCORE
    may also be a WAV, FLAC or AIFF file, without NAME: then its waveform and spectrogram are
    drawn.
    """
    if is_sound(Path(score_path)):
        _plot_sound(console, Path(score_path), svg, width, height, force)
        return
    loaded = score.read(score_path, ReadOptions(trust=trust), console)
    if name == NOTES_NAME:
        _plot_notes(console, loaded, svg, width, height, force)
        return
    curves, plot_title = drawn_curves(loaded, name, key, console)
    if console.json:
        for curve in curves:
            positions_mm = [None if position != position else position for position in curve.x]
            console.record(
                "curve", name=curve.name, title=plot_title, t_s=curve.t, x_mm=positions_mm
            )
    elif svg is None:
        console.data(f"{plot_title}\n{_plot_text(curves, width, height, 'position [mm]')}")
    if svg is not None:
        from ergon.view.svg import plot as draw

        picture = draw(curves, title=plot_title, x_label="position [mm]")
        _write(console, svg, picture, force, loaded.inputs)


def _plot_notes(
    console: Console,
    loaded: Loaded,
    svg: str | None,
    width: int | None,
    height: int,
    force: bool,
) -> None:
    """Draw the notes of a piece: a line for each, as high as its pitch."""
    from ergon.view.curve import Curve
    from ergon.view.roll import note_heights_and_lanes, notes_svg

    notes, bars, plot_title = struck_bars(loaded, console)
    if console.json:
        for note in notes:
            console.record("note", **asdict(note))
    if svg is not None:
        _write(console, svg, notes_svg(bars, title=plot_title), force, loaded.inputs)
    elif not console.json:
        keys, lanes = note_heights_and_lanes(bars)
        instants = [instant for note in notes for instant in (note.begin, note.end, note.end)]
        curve_heights = [key_or_gap for key in keys for key_or_gap in (key, key, nan)]
        axis_label = "time [s]; upwards keys of MIDI, 60 is C4"
        if lanes:
            axis_label += "; without a pitch: "
            axis_label += ", ".join(f"{name} at {key:g}" for name, key in lanes.items())
        curve = Curve(NOTES_NAME, instants, curve_heights)
        curve_text = _plot_text([curve], width, height, axis_label)
        console.data(f"{plot_title}\n{curve_text}")


def _plot_sound(
    console: Console,
    path: Path,
    svg: str | None,
    picture_width: int | None,
    picture_height: int,
    force: bool,
) -> None:
    from ergon.exchange.sound import read_blocks, read_info
    from ergon.exchange.wave_header import NotWaveError

    try:
        wave_info = read_info(path)
    except NotWaveError as error:
        raise Refused(f"{path}: {error}") from None
    if wave_info.damage is not None:
        console.warn(f"{path}: {wave_info.damage}")
    rate = float(wave_info.format.rate)
    if svg is not None:
        from ergon.view.sound import picture

        title = wave_info.title or path.name
        picture_text = picture(read_blocks(path), wave_info.n_frames, rate, title)
        _write(console, svg, picture_text, force, (path,))
        return
    from ergon.view.sound import envelope

    curves = envelope(read_blocks(path), wave_info.n_frames, rate)
    console.data(f"{path}\n{_plot_text(curves, picture_width, picture_height, 'mean of channels')}")


def _plot_text(
    curves: Sequence[Curve], picture_width: int | None, picture_height: int, axis_label: str
) -> str:
    from ergon.view.braille import plot as draw

    n_columns = picture_width or min(shutil.get_terminal_size().columns, _WIDTH_MAX)
    return draw(curves, width=n_columns, height=picture_height, x_label=axis_label)


def _write(
    console: Console,
    output_target: str,
    picture_text: str,
    force: bool,
    input_files: Sequence[Path],
) -> None:
    from ergon.exchange.safe import write_text

    write_text(output_target, picture_text, force=force, inputs=input_files)
    if output_target != "-":
        console.say(f"wrote {output_target}")
