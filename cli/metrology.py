"""`ergon metrology`: what a real key is made of."""

from __future__ import annotations

import click

from .lazy import LazyGroup, Table

COMMANDS: Table = {
    "fit": ("metrology_fit", "fit", "Measure a key by takes of the forces that it was given."),
}


@click.group(cls=LazyGroup, table=COMMANDS)
def metrology() -> None:
    """Measure what a real key is made of."""
