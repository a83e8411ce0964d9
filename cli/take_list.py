"""`ergon take list`: the takes in a folder."""

from __future__ import annotations

from pathlib import Path

import click

from ergon.common.terminal import printable

from . import options
from .console import Console, plural
from .outcome import Outcome, Refused
from .recording import NAMES_MAX, SUFFIX, read_quietly
from .units import seconds_text

_DEFAULT_FOLDER = "takes"


@click.command("list")
@click.argument("folder", metavar="[FOLDER]", required=False)
@options.with_console
def list_takes(console: Console, folder: str | None) -> None:
    """List the recordings in a folder and what they hold.

    Without FOLDER, list ./takes, or the current folder if ./takes does not exist.
    """
    take_folder = Path(folder) if folder is not None else Path(_DEFAULT_FOLDER)
    if folder is None and not take_folder.is_dir():
        take_folder = Path()
    if not take_folder.is_dir():
        raise Refused(f"{take_folder} is not a folder")
    paths = sorted(path for path in take_folder.iterdir() if path.suffix.lower() == SUFFIX)
    for path in paths:
        _tell(console, path)
    if not paths:
        console.say(f"no recordings in {take_folder}")


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
    recording_words = [", ".join(recording.names), seconds_text(recording.duration)]
    if recording.events:
        recording_words.append(plural(len(recording.events), "event"))
    if recording.damage is not None:
        recording_words.append("damaged" if recording.lost_bytes else "never finished")
    line = f"{path}: {', '.join(recording_words)}"[:NAMES_MAX]
    console.data(printable(line) + "\n")
