"""`ergon export`: tempo map, marks and stems for a workstation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.options import ReadOptions

from . import options
from .console import Console
from .outcome import Refused
from .summary import finer, rendered

if TYPE_CHECKING:
    from ergon.exchange.midi import Meter
    from ergon.exchange.wave_header import Bits
    from ergon.scores.reading.piece import Piece

_AFTER = 3600.0  # [s] of the tempo map that are written beyond the end of a piece


@click.command()
@options.score
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    required=True,
    help="The folder to write into.",
)
@click.option(
    "--stems/--no-stems",
    default=True,
    help="Whether to render the mix, and one file for each player.",
)
@options.bits
@options.force
@options.trust
@options.speaking
def export(
    console: Console,
    score_path: str,
    output: Path,
    stems: bool,
    bits: Bits | None,
    force: bool,
    trust: bool,
) -> None:
    """Write tempo map, marks and stems for other programs.

    tempo.mid holds tempo, meters and markers; marks.csv the marks in bars and seconds; mix.wav and
    stems/ the sound. All begin at the beginning of the piece: drag them to zero.
    """
    from ergon.exchange.markers import markers_csv
    from ergon.exchange.safe import check_target, writing

    loaded = score.read(score_path, ReadOptions(trust=trust), console)
    staged = score.stage_piece(loaded, None, console)
    piece = staged.piece
    end = staged.stage.n_looked_at / staged.stage.rate
    tempo_path, marks_path = output / "tempo.mid", output / "marks.csv"
    for path in (tempo_path, marks_path):
        check_target(path, force=force, inputs=loaded.inputs)
    tempo = piece.tempo_map
    marks = [
        (name, score.where(piece, tempo.seconds(beats)), tempo.seconds(beats))
        for name, beats in score.marks_of(piece)
    ]
    files = {
        tempo_path: _tempo_file(piece, end),
        marks_path: markers_csv(marks).encode(),
    }
    for path, content in files.items():
        with writing(path, binary=True, force=force) as file:
            file.write(content)
        _say(console, path)
    if stems:
        from ergon.api.render import FileOptions, Prepared, job_of, write

        asked = FileOptions(stems=output / "stems", bits=bits, force=force)
        job = job_of(piece, staged.stage, str(output / "mix.wav"), asked)
        job = replace(job, inputs=loaded.inputs)
        done = write(Prepared(loaded, staged.stage, job, staged.plan_s), console)
        rendered(console, done)
        finer(console, done.simulation)


def _tempo_file(piece: Piece, end: float) -> bytes:
    """The tempo map up to `end` [s], or to the end of its last ramp within an hour after that."""
    from ergon.exchange.midi import Marker, tempo_file

    tempo = piece.tempo_map
    ramps = [tempo.after(tempo.resolve(e.at), e.over) for e in piece.tempo if e.over is not None]
    written = max([tempo.beats(end), *ramps, *(tempo.resolve(e.at) for e in piece.tempo)])
    length = min(written, tempo.beats(end + _AFTER))  # a ramp may last for years
    markers = [Marker(name, beats) for name, beats in score.marks_of(piece)]
    try:
        return tempo_file(tempo.seconds, length, _meters(piece), markers, piece.title)
    except ValueError as error:
        raise Refused(str(error)) from None


def _meters(piece: Piece) -> list[Meter]:
    from ergon.exchange.midi import Meter

    changes = piece.tempo_map.bars.changes()
    return [Meter(beat, meter.beats, meter.unit) for beat, _, meter in changes]


def _say(console: Console, path: Path) -> None:
    if console.json:
        console.record("wrote", file=str(path))
    else:
        console.say(f"wrote {path}")
