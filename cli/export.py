"""`ergon export`: a piece for an audio workstation, or its parts for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ergon.api.errors import OptionError
from ergon.api.options import FileOptions
from ergon.workshop.api.exchanging import FORMATS
from ergon.workshop.api.export import ExportedPart, ExportOptions

from . import options
from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from ergon.exchange.wave_header import Bits

# The endings of the files, and the options that each format allows.
_ENDING_BY_FORMAT = {"modal": ".csv", "faust": ".dsp", "mdl": ".mdl", "csound": ".csd"}
# The output is a folder: a new one may not have the ending of one of the written files.
_FILE_ENDINGS = {*_ENDING_BY_FORMAT.values(), ".wav", ".mid"}
_OPTIONS_BY_FORMAT = {
    "daw": ("--no-stems", "--wet", "--bits"),
    "modal": ("PART", "--upto"),
    "faust": ("PART", "--upto"),
    "mdl": ("PART",),
    "csound": ("PART", "--upto"),
}


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
@click.option(
    "--wet",
    is_flag=True,
    default=None,
    help="Of daw: write two stems of what rooms hear: dry, and the answer of the rooms.",
)
@options.bits
@options.from_dataclass(ExportOptions, "upto")
@options.force
@options.trust
@options.with_console
def export(
    console: Console,
    score_path: str,
    parts: tuple[str, ...],
    to: str,
    output: Path,
    stems: bool | None,
    wet: bool | None,
    bits: Bits | None,
    upto: str | None,
    force: bool,
    trust: bool,
) -> None:
    """Write a piece, or its parts, for other programs.

    daw: tempo.mid holds tempo, meters, markers and the notes of each instrument; marks.csv the
    marks in bars and seconds; mix.wav and stems/ the sound. All begin at the beginning of the
    piece: drag them to zero, or open project.rpp, which lines them up in REAPER. A tempo map that
    MIDI cannot represent is left out with a warning, and the project too.

    modal: PART.csv of each instrument and key: its modes, and how much of a stroke is heard of
    each.

    faust: SCORE.dsp, or PART.dsp of each part that is named: masses, springs, dampers, contacts
    and laws, stepped sample by sample. With --upto, and of a part with a MODES, a resonator for
    each mode.

    mdl: SCORE.mdl, or PART.mdl of each part that is named: a model of mi-gen, which `ergon import`
    reads.

    csound: SCORE.csd, or PART.csd of each part that is named: a resonator for each mode, and the
    strikes.
    """
    value_by_option = {
        "PART": parts or None,
        "--no-stems": stems,
        "--wet": wet,
        "--bits": bits,
        "--upto": upto,
    }
    for name, value in value_by_option.items():
        if value is not None and name not in _OPTIONS_BY_FORMAT[to]:
            raise Refused(f"{name} cannot be used with --to {to}; leave it out")
    if output.suffix in _FILE_ENDINGS and not output.is_dir():
        raise Refused(
            f"-o: {output} has the name of a file; name a folder, for example {output.stem}"
        )
    if to == "daw":
        from .export_daw import export_daw

        is_rendered = stems is not False
        file_options = FileOptions(
            stems=output / "stems" if is_rendered else None,
            wet=bool(wet),
            bits=bits,
            force=force,
            trust=trust,
        )
        export_daw(console, score_path, output, file_options, is_rendered=is_rendered)
        return
    exported_options = ExportOptions(parts=parts, upto=upto, trust=trust)
    try:
        exported = FORMATS[to](score_path, exported_options, report=console)
    except OptionError as error:
        if error.option != "parts":
            raise
        raise Refused(f"PART: {error.reason}") from None
    _write(console, exported, output, _ENDING_BY_FORMAT[to], force)


def _write(
    console: Console,
    exported: Sequence[ExportedPart],
    output_folder: Path,
    ending: str,
    force: bool,
) -> None:
    """Write a file for each part; none if one of them cannot be written."""
    from ergon.exchange.safe import file_group

    if not exported:
        raise Refused("nothing in this score moves")
    part_by_path = {output_folder / f"{part.part}{ending}": part for part in exported}
    inputs = {file for part in exported for file in part.inputs}
    with file_group(force=force, inputs=inputs) as files:
        for path, exported_part in part_by_path.items():
            files.write(path, exported_part.text.encode())
    for path, exported_part in part_by_path.items():
        for warning in exported_part.warnings:
            console.warn(f"{exported_part.part}: {warning}")
        console.wrote(path)
