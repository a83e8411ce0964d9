"""`ergon take trim`: a part of a recording."""

from __future__ import annotations

import math
from pathlib import Path

import click

from . import options, recording
from .console import Console
from .outcome import Refused


@click.command()
@click.argument("file", metavar="FILE")
@click.argument("start", metavar="FROM")
@click.argument("stop", metavar="TO")
@options.target("The new recording, a .take file.")
@options.dry_run
@options.force
@options.with_console
def trim(
    console: Console,
    file: str,
    start: str,
    stop: str,
    output: str | None,
    dry: bool,
    force: bool,
) -> None:
    """Write a part of a recording as a recording of its own.

    FROM and TO are seconds from its beginning, such as 0.4s 12.5s; `end` is its end. Rows keep
    their place in the piece, and events between them are kept. The new
    file is whole, also where FILE is damaged.
    """
    if output is None:
        raise Refused("name the file to write, by -o NEW.take")
    path = Path(file)
    begin_seconds, end_seconds = _seconds(start, "FROM"), _seconds(stop, "TO")
    if not begin_seconds < end_seconds:
        raise Refused(f"nothing lies between {start} and {stop}")
    # Read the header alone: ticks are counted from the first row, wherever in the piece that was.
    header = recording.read_quietly(path, (0, 0))
    rate = header.rate / header.frames
    tick_range = _first_tick(begin_seconds, rate), _first_tick(end_seconds, rate)
    trimmed = recording.read(console, path, tick_range)
    if not len(trimmed.ticks()):
        raise Refused(f"{path}: nothing is recorded from {start} to {stop}")
    recording.write(console, trimmed, recording.target(output, path), force=force, dry=dry)


def _seconds(time_text: str, option_name: str) -> float:
    from ergon.notation.tables.quantities import INSTANT, quantity
    from ergon.notation.text.errors import TextError

    if time_text == "end" and option_name == "TO":
        return math.inf
    try:
        return quantity(time_text, INSTANT)
    except TextError as error:
        raise Refused(f"{option_name}: {error.message}") from None


def _first_tick(instant: float, rate: float) -> int:
    """The first tick that is not before an instant; rounding errors are allowed for."""
    tick_max = (1 << 64) - 1
    return tick_max if instant * rate >= tick_max else math.ceil(instant * rate - 1e-6)
