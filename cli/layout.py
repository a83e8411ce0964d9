"""`ergon layout`: where loudspeakers are."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "check": ("layout_check", "check", "Say how well loudspeakers place sound, and their holes."),
    "export": ("layout_export", "export", "Write a layout as other programs have it."),
    "import": ("layout_import", "import_layout", "Make a layout of another program's file."),
    "noise": ("layout_noise", "noise", "Noise from each loudspeaker in turn, as a file or live."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def layout() -> None:
    """Check and exchange layouts of loudspeakers."""
