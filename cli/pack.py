"""`ergon pack`: a score, and all files that it reads, as one file."""

from __future__ import annotations

import click

from ergon.api.options import ReadOptions

from . import options
from .console import Console, plural
from .outcome import check_stdout
from .units import octets_text


@click.command()
@options.score
@options.target("The pack to write; - is stdout. Default: SCORE.ergonpack here.")
@options.force
@options.trust
@options.with_console
def pack(console: Console, score_path: str, output: str | None, force: bool, trust: bool) -> None:
    """Write a score, and all files that it reads, as one file.

    It holds the score, what it uses, its takes, layouts and tunings, the instruments of the library
    that it uses, and the version of ergon. Every command that reads a score reads it, on any
    machine. The same files give the same bytes. `ergon info` lists what is in a pack.
    """
    from ergon.api import packs

    check_stdout(output, is_json=console.json)
    packed = packs.pack(score_path, output, ReadOptions(trust=trust), force=force, report=console)
    packed_files = packed.pack.files
    if console.json:
        fields = {"bytes": packed.size, "score": packed.pack.score, "files": sorted(packed_files)}
        console.record("packed", file=packed.path, **fields)
        return
    for name, data in sorted(packed_files.items()):
        console.detail(f"{name}: {octets_text(len(data))}")
    if packed.path != "-":
        console.say(
            f"{packed.path}: {plural(len(packed_files), 'file')}, {octets_text(packed.size)}"
        )
