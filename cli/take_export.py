"""`ergon take export`: a recording for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from . import options, recording
from .console import Console
from .outcome import Refused

if TYPE_CHECKING:
    from typing import BinaryIO

    from ergon._core import Recording

_FORMS = (".csv", ".npz", ".wav")


@click.command()
@click.argument("file", metavar="FILE")
@options.target("The file to write: .csv, .npz or .wav, by its ending; - writes CSV to stdout.")
@options.dry_run
@options.force
@options.with_console
def export(console: Console, file: str, output: str | None, dry: bool, force: bool) -> None:
    """Write a recording as CSV, npz or WAV.

    CSV and npz hold every number of every tick, with units in the header: t from the first tick,
    position consumed, force felt, force sent, flags, the device's clock. WAV holds positions at
    the audio rate, a channel for each axis, 1.0 for 1 m.
    """
    from ergon.exchange.recording import NotRecordingError
    from ergon.exchange.safe import check_target, open_for_writing

    if output is None:
        raise Refused("name the file to write, by -o x.csv, x.npz or x.wav")
    file_ending = ".csv" if output == "-" else Path(output).suffix.lower()
    if file_ending not in _FORMS:
        raise Refused(f"{output}: a recording is exported as {', '.join(_FORMS)}")
    input_files = (Path(file),)
    take = recording.read(console, Path(file))
    if dry:
        check_target(Path(output), force=force, inputs=input_files)
    else:
        try:
            with open_for_writing(
                output, binary=file_ending != ".csv", force=force, inputs=input_files
            ) as output_file:
                _write(output_file, take, file_ending)
        except NotRecordingError as error:
            raise Refused(f"{file}: {error}") from None
    if output != "-":
        recording.say(console, Path(output), take, dry=dry)


def _write(output_file: BinaryIO, take: Recording, file_ending: str) -> None:
    from ergon.exchange.recording import csv_rows, write_npz, write_wav

    if file_ending == ".npz":
        write_npz(output_file, take)
    elif file_ending == ".wav":
        write_wav(output_file, take)
    else:
        for text in csv_rows(take):
            output_file.write(text.encode())
