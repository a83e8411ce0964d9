"""`ergon motion`: motion files."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "export": ("motion_export", "export", "Write a motion file as npz, CSV or glTF."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def motion() -> None:
    """Exchange files of what moved."""
