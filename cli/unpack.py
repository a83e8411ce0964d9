"""`ergon unpack`: the files of a pack in a folder."""

from __future__ import annotations

import click

from . import options
from .console import Console


@click.command()
@click.argument("file", metavar="FILE.ergonpack")
@click.option("-o", "--output", metavar="FOLDER", help="A new folder. Default: FILE here.")
@options.with_console
def unpack(console: Console, file: str, output: str | None) -> None:
    """Write the files of a pack into a new folder.

    There they can be changed. The folder appears when it is whole, and one that exists is left as
    it is, unless it is empty.
    """
    from ergon.api.packs import unpack as unpack_files

    score = unpack_files(file, output)
    if console.json:
        console.record("unpacked", score=str(score))
        return
    console.say(f"the score is {score}")
