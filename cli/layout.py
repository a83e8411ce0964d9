"""`ergon layout`: where loudspeakers are."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "check": ("layout_check", "check", "Say how well loudspeakers place sound, and their holes."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def layout() -> None:
    """Check and exchange layouts of loudspeakers."""
