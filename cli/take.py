"""`ergon take`: recordings of live hands."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "list": ("take_list", "list_takes", "List the recordings in a folder and what they hold."),
    "info": ("take_info", "info", "Say what a take holds, and whether it is whole."),
    "record": ("take_record", "record", "Record what a hand does on a device, without any force."),
    "trim": ("take_trim", "trim", "Write a part of a recording as a recording of its own."),
    "import": (
        "take_import",
        "import_take",
        "Make a recording of a movement in a table, WAV or motion capture.",
    ),
    "export": ("take_export", "export", "Write a recording as CSV, npz or WAV."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def take() -> None:
    """List, cut and exchange recordings of live hands."""
