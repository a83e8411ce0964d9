"""Runs a simulation that records ergons, and gives the rows of their stream."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ergon.exchange.stream import ErgonNames, Form, stream_rows

if TYPE_CHECKING:
    from ergon._core import Simulation


def stream_ergons(
    simulation: Simulation,
    n_frames: int,
    row_form: Form,
    ergon_names: ErgonNames,
    block_frames: int = 4096,
) -> Iterator[tuple[str, int]]:
    """Run a recording simulation to frame `n_frames`; gives (rows of a block, frames done)."""
    import numpy as np

    for first_frame in range(0, n_frames, block_frames):
        count = min(block_frames, n_frames - first_frame)
        simulation.process(np.zeros((count, simulation.n_out)))
        yield stream_rows(row_form, simulation.ergons(), ergon_names), first_frame + count
