"""`ergon export`: a piece for an audio workstation, or its parts for other programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from math import log2
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api import score
from ergon.api.errors import OptionError
from ergon.workshop.api.export import (
    ExportedPart,
    ExportOptions,
    faust_programs,
    mi_gen_models,
    mode_tables,
)
from ergon.workshop.api.export_csound import csound_orchestras

from . import options
from .console import Console
from .outcome import Refused
from .summary import print_finer_steps, print_rendered

if TYPE_CHECKING:
    from ergon.exchange.midi import Meter, NoteTrack
    from ergon.exchange.wave_header import Bits
    from ergon.scores.reading.piece import Piece
    from ergon.scores.staging.stage import Stage

# The functions that write the files of parts, the endings of the files, and the options that each
# format allows.
FORMATS: Mapping[str, Callable[..., Sequence[ExportedPart]]] = {
    "modal": mode_tables,
    "faust": faust_programs,
    "mdl": mi_gen_models,
    "csound": csound_orchestras,
}
_ENDINGS = {"modal": ".csv", "faust": ".dsp", "mdl": ".mdl", "csound": ".csd"}
# The output is a folder: a new one may not have the ending of one of the written files.
_FILES = {*_ENDINGS.values(), ".wav", ".mid"}
_OPTIONS = {
    "daw": ("--no-stems", "--bits"),
    "modal": ("PART", "--upto"),
    "faust": ("PART", "--upto"),
    "mdl": ("PART",),
    "csound": ("PART", "--upto"),
}
_DRUMS, _FIRST_DRUM = 9, 36  # channel from 0, and key of the first one
_CHANNELS = [channel for channel in range(16) if channel != _DRUMS]
_AFTER = 3600.0  # [s] of the tempo map that are written beyond the end of a piece


@click.command()
@options.score
@click.argument("parts", metavar="[PART]...", nargs=-1)
@click.option(
    "--to",
    type=click.Choice(["daw", *FORMATS]),
    default="daw",
    show_default=True,
    help="What the files are for: a workstation, tables of modes (CSV), programs of Faust, "
    "models of mi-gen, orchestras of Csound.",
)
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
    default=None,
    help="Of daw: whether to render the mix, and one file for each player.",
)
@options.bits
@click.option(
    "--upto",
    metavar="FREQUENCY",
    help="Of modal and csound: the highest mode (20kHz). Of faust: banks of the modes up to it.",
)
@options.force
@options.trust
@options.speaking
def export(
    console: Console,
    score_path: str,
    parts: tuple[str, ...],
    to: str,
    output: Path,
    stems: bool | None,
    bits: Bits | None,
    upto: str | None,
    force: bool,
    trust: bool,
) -> None:
    """Write a piece, or its parts, for other programs.

    daw: tempo.mid holds tempo, meters, markers and the notes of each instrument; marks.csv the
    marks in bars and seconds; mix.wav and stems/ the sound. All begin at the beginning of the
    piece: drag them to zero. A tempo map that MIDI cannot represent is left out with a warning.

    modal: PART.csv of each instrument and key: its modes, and how much of a stroke is heard of
    each.

    faust: SCORE.dsp, or PART.dsp of each part that is named: masses, springs, dampers, contacts
    and laws, stepped sample by sample. With --upto, and of a part with a MODES, a resonator for
    each mode.

    mdl: SCORE.mdl, or PART.mdl of each part that is named: a model of mi-gen, which `ergon import`
    reads.

    csound: PART.csd of each part: a resonator for each of its modes, and its strikes.
    """
    arguments = {"PART": parts or None, "--no-stems": stems, "--bits": bits, "--upto": upto}
    for name, value in arguments.items():
        if value is not None and name not in _OPTIONS[to]:
            raise Refused(f"{name} cannot be used with --to {to}; leave it out")
    if output.suffix in _FILES and not output.is_dir():
        raise Refused(
            f"-o: {output} has the name of a file; name a folder, for example {output.stem}"
        )
    if to == "daw":
        _for_workstation(console, score_path, output, stems is not False, bits, force, trust)
        return
    asked = ExportOptions(parts=parts, upto=upto, trust=trust)
    try:
        exported = FORMATS[to](score_path, asked, report=console)
    except OptionError as error:
        if error.option != "parts":
            raise
        raise Refused(f"PART: {error.reason}") from None
    _write(console, exported, output, _ENDINGS[to], force)


def _write(
    console: Console, exported: Sequence[ExportedPart], output: Path, ending: str, force: bool
) -> None:
    """Write a file for each part; none if one of them cannot be written."""
    from ergon.exchange.safe import file_group

    if not exported:
        raise Refused("nothing in this score moves")
    paths = {output / f"{part.part}{ending}": part for part in exported}
    inputs = {file for part in exported for file in part.inputs}
    with file_group(force=force, inputs=inputs) as files:
        for path, part in paths.items():
            files.write(path, part.text.encode())
    for path, part in paths.items():
        for warning in part.warnings:
            console.warn(f"{part.part}: {warning}")
        _say(console, path)


def _for_workstation(
    console: Console,
    score_path: str,
    output: Path,
    stems: bool,
    bits: Bits | None,
    force: bool,
    trust: bool,
) -> None:
    from ergon.api.options import FileOptions
    from ergon.api.render import prepare, write
    from ergon.exchange.markers import markers_csv
    from ergon.exchange.safe import check_target, file_group

    asked = FileOptions(stems=output / "stems", bits=bits, force=force, trust=trust)
    loaded = score.read(score_path, asked, console)
    prepared = prepare(loaded, str(output / "mix.wav"), asked, console) if stems else None
    stage = (prepared or score.stage_piece(loaded, None, console)).stage
    piece, end = stage.piece, stage.n_analysed_frames / stage.rate
    tempo_path, marks_path = output / "tempo.mid", output / "marks.csv"
    for path in (tempo_path, marks_path):
        check_target(path, force=force, inputs=loaded.inputs)
    tempo = piece.tempo_map
    marks = [
        (name, score.where(piece, tempo.seconds(beats)), tempo.seconds(beats))
        for name, beats in score.marks_of(piece)
    ]
    files = {marks_path: markers_csv(marks).encode()}
    try:
        files = {tempo_path: _tempo_file(piece, end, _note_tracks(stage)), **files}
    except ValueError as error:
        console.warn(f"{error}; {tempo_path} is left out, and the other files are written")
    done = None
    # What is small is on the disk before the sound, and gets its names after it: all or nothing.
    with file_group(force=force, inputs=loaded.inputs) as small:
        for path, content in files.items():
            small.write(path, content)
        if prepared is not None:
            done = write(prepared, console)
    for path in files:
        _say(console, path)
    if done is not None:
        print_rendered(console, done)
        print_finer_steps(console, done.reports)


def _tempo_file(piece: Piece, end: float, tracks: Sequence[NoteTrack]) -> bytes:
    """The tempo map and the notes as MIDI, up to `end` [s], or up to the last change of tempo
    within an hour after that. Raises ValueError where MIDI has no such tempo or meter.
    """
    from ergon.exchange.midi import Marker, tempo_file

    tempo = piece.tempo_map
    ramps = [tempo.after(beat, entry.over) for beat, entry in tempo.placed if entry.over]
    written = max([tempo.beats(end), *ramps, *(beat for beat, _ in tempo.placed)])
    length = min(written, tempo.beats(end + _AFTER))  # a ramp may last for years
    markers = [Marker(name, beats) for name, beats in score.marks_of(piece)]
    return tempo_file(tempo.seconds, length, _meters(piece), markers, piece.title, tracks)


def _note_tracks(stage: Stage) -> list[NoteTrack]:
    """A track for each instrument that is struck, at the nearest keys; those without a pitch share
    the channel of drums, each at a key of its own.
    """
    from ergon.exchange.midi import Note, NoteTrack
    from ergon.scores.staging.struck_notes import struck_notes

    tempo = stage.piece.tempo_map
    notes: dict[str, list[Note]] = {}
    drums: dict[str, int] = {}  # by instrument: its key
    for note in struck_notes(stage):
        if note.pitch is None:
            key = drums.setdefault(note.instrument, _FIRST_DRUM + len(drums))
        else:
            key = round(69.0 + 12.0 * log2(note.pitch / 440.0))
        notes.setdefault(note.instrument, []).append(
            Note(
                tempo.beats(note.begin),
                tempo.beats(note.end),
                min(127, max(0, key)),
                max(1, round(127.0 * note.strength)),
            )
        )
    channels = cycle(_CHANNELS)
    return [
        NoteTrack(name, _DRUMS if name in drums else next(channels), part_notes)
        for name, part_notes in notes.items()
    ]


def _meters(piece: Piece) -> list[Meter]:
    from ergon.exchange.midi import Meter

    changes = piece.tempo_map.bars.changes()
    return [Meter(beat, meter.beats, meter.unit) for beat, _, meter in changes]


def _say(console: Console, path: Path) -> None:
    if console.json:
        console.record("wrote", file=str(path))
    else:
        console.say(f"wrote {path}")
