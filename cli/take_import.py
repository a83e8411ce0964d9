"""`ergon take import`: a movement from elsewhere as a recording."""

from __future__ import annotations

from pathlib import Path

import click

from . import options, recording
from .console import Console
from .options import Quantity
from .outcome import Refused


@click.command("import")
@click.argument("file", metavar="FILE")
@options.target("The new recording, a .take file.")
@click.option(
    "--channel",
    "channels",
    multiple=True,
    metavar="NAME",
    help="Column that becomes an axis, or a point and an axis, such as RWRI.z or RWRI.auto; "
    "repeatable. Not needed where there is one column.",
)
@click.option(
    "--rate",
    metavar="RATE",
    help="Samples a second, for a file without a column t [s], such as 1kHz.",
)
@click.option(
    "--unit",
    type=Quantity("SIZE"),
    help="What 1.0 means in a file without units (BVH, SDIF, tables; WAV: 1m), such as 1cm.",
)
@click.option(
    "--audio",
    metavar="RATE",
    default="44100Hz",
    show_default=True,
    help="Audio rate of the recording.",
)
@click.option(
    "--tick",
    "frames",
    type=click.IntRange(1, 2_000_000),
    metavar="FRAMES",
    help="Audio frames of a tick. Default: the number nearest to a millisecond.",
)
@options.dry_run
@options.force
@options.with_console
def import_take(
    console: Console,
    file: str,
    output: str | None,
    channels: tuple[str, ...],
    rate: str | None,
    unit: float | None,
    audio: str,
    frames: int | None,
    dry: bool,
    force: bool,
) -> None:
    """Make a recording of a movement in a table, WAV or motion capture.

    Of a table (CSV, TSV, npz) a channel is a column; its name has a unit (`t [s],x [mm]`). Of
    motion capture (C3D, BVH, TRC, TSV of Qualisys, CSV of OptiTrack) it is a point and an axis:
    `RWRI.x`, or `RWRI.auto` for the straight line that its path is nearest to; positions count from
    the first. Of SDIF it is a column of a matrix. `ergon take info` lists them. Positions between
    the samples are those of the spline that a score would play. A score can play such files as they
    are, too.
    """
    from ergon.exchange.recording import NotRecordingError, recording_of_movements
    from ergon.scores.gesture.take_file import TakeError
    from ergon.scores.gesture.takes import read

    if output is None:
        raise Refused("name the file to write, by -o NEW.take")
    path = Path(file)
    if path.suffix.lower() == ".gms":
        raise Refused(
            f"{file}: GMS files are not read yet: ACROE describes what they hold, and ergon's "
            "authors have no table of their bytes; export CSV from the program that made it"
        )
    if path.suffix.lower() == recording.SUFFIX:
        raise Refused(f"{file} is a recording already")
    sample_rate = None if rate is None else _hertz(rate, "--rate")
    audio_rate = _hertz(audio, "--audio")
    samples_by_name = {}
    try:
        for channel_name in channels or (None,):
            samples = read(path, channel_name, rate=sample_rate, unit=unit)
            if samples.damage is not None:
                console.warn(f"{file}: {samples.damage}")
            samples_by_name[channel_name or path.stem] = samples.t, samples.x
        take = recording_of_movements(
            samples_by_name,
            rate=audio_rate,
            frames=frames or max(1, round(audio_rate / 1000)),
            source=path.name,
        )
    except TakeError as error:
        hint = f"; did you mean '{error.suggestion}'?" if error.suggestion else ""
        raise Refused(f"{error.message}{hint}") from None
    except NotRecordingError as error:
        raise Refused(f"{file}: {error}") from None
    recording.write(console, take, recording.target(output, path), force=force, dry=dry)


def _hertz(rate_text: str, option: str) -> float:
    from ergon.notation.tables.quantities import FREQUENCY, quantity
    from ergon.notation.text.errors import TextError

    try:
        return quantity(rate_text, FREQUENCY)
    except TextError as error:
        raise Refused(f"{option}: {error.message}") from None
