"""`ergon take list`: the takes in a folder."""

from __future__ import annotations

from pathlib import Path

import click

from ergon.common.terminal import printable

from . import options
from .console import Console, plural
from .outcome import Outcome, Refused
from .recording import NAMES_MAX, SUFFIX, read_quietly
from .units import seconds

_USUAL = "takes"


@click.command("list")
@click.argument("folder", metavar="[FOLDER]", required=False)
@options.speaking
def list_takes(console: Console, folder: str | None) -> None:
    """List the recordings in a folder and what they hold.

    Without FOLDER those of ./takes, or of this folder where there is no ./takes.
    """
    where = Path(folder) if folder is not None else Path(_USUAL)
    if folder is None and not where.is_dir():
        where = Path()
    if not where.is_dir():
        raise Refused(f"{where} is not a folder")
    paths = sorted(path for path in where.iterdir() if path.suffix.lower() == SUFFIX)
    for path in paths:
        _tell(console, path)
    if not paths:
        console.say(f"no recordings in {where}")


def _tell(console: Console, path: Path) -> None:
    try:
        recording = read_quietly(path)
    except Outcome as error:
        if console.json:
            console.record("take", file=str(path), error=error.message)
        else:
            console.data(f"{error.message}\n")
        return
    if console.json:
        console.record(
            "take",
            file=str(path),
            duration_s=recording.duration,
            axes=recording.names,
            events=len(recording.events),
            lost_bytes=recording.lost_bytes,
            finished=recording.finished,
        )
        return
    words = [", ".join(recording.names), seconds(recording.duration)]
    if recording.events:
        words.append(plural(len(recording.events), "event"))
    if recording.damage is not None:
        words.append("damaged" if recording.lost_bytes else "never finished")
    line = f"{path}: {', '.join(words)}"[:NAMES_MAX]
    console.data(printable(line) + "\n")
