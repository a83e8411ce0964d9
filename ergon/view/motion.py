"""Two curves of a running simulation: the path that a gesture asks of its key, and the path of the
key.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .curve import Curve

if TYPE_CHECKING:
    from ergon._core import Simulation

POINTS = 1200  # more than a picture has columns
_MM = 1000.0


def asked_and_done(
    simulation: Simulation,
    key_index: int,
    struck_mat: int,
    start_seconds: float,
    stop_seconds: float,
    reach: float = 1.0,
    point_count: int = POINTS,
) -> tuple[Curve, Curve]:
    """Run from the beginning to `stop_seconds` [s] and trace the key from `start_seconds` on, in
    millimetres.

    Each curve has about `point_count` points.

    `key_index` is the key's index on the timeline, `struck_mat` its struck MAT, whose displacement
    in the piece is `reach` times the key's.
    """
    import numpy as np

    rate, scale = simulation.rate, _MM / reach
    first_frame, last_frame = int(start_seconds * rate + 0.5), int(stop_seconds * rate + 0.5)
    frame_step = max(1, (last_frame - first_frame) // point_count)
    frame_block = np.zeros((4096, simulation.n_out))
    while simulation.frame < first_frame:
        simulation.process(frame_block[: first_frame - simulation.frame])
    t, asked, done = [], [], []
    while True:
        t.append(simulation.frame / rate)
        asked.append(float(simulation.asked()[key_index]) * scale)
        done.append(float(simulation.positions()[struck_mat]) * scale)
        if simulation.frame >= last_frame:
            break
        until = min(last_frame, simulation.frame + frame_step)
        while simulation.frame < until:
            simulation.process(frame_block[: until - simulation.frame])
    return Curve("asked", t, asked), Curve("done", t, done)
