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


def wanted_and_actual(
    simulation: Simulation,
    key_index: int,
    struck_mat: int,
    start_s: float,
    end_s: float,
    displacement_ratio: float = 1.0,
    n_points: int = POINTS,
) -> tuple[Curve, Curve]:
    """Run from the beginning to `end_s` [s] and trace the key from `start_s` on, in
    millimetres.

    Each curve has about `n_points` points.

    `key_index` is the key's index on the timeline, `struck_mat` its struck MAT, whose displacement
    in the piece is `displacement_ratio` times the key's.
    """
    import numpy as np

    rate, mm_per_position = simulation.rate, _MM / displacement_ratio
    first_frame, last_frame = int(start_s * rate + 0.5), int(end_s * rate + 0.5)
    stride = max(1, (last_frame - first_frame) // n_points)
    block = np.zeros((4096, simulation.n_out))
    while simulation.frame < first_frame:
        simulation.process(block[: first_frame - simulation.frame])
    instants, wanted_mm, actual_mm = [], [], []
    while True:
        instants.append(simulation.frame / rate)
        wanted_mm.append(float(simulation.asked()[key_index]) * mm_per_position)
        actual_mm.append(float(simulation.positions()[struck_mat]) * mm_per_position)
        if simulation.frame >= last_frame:
            break
        next_frame = min(last_frame, simulation.frame + stride)
        while simulation.frame < next_frame:
            simulation.process(block[: next_frame - simulation.frame])
    return Curve("asked", instants, wanted_mm), Curve("done", instants, actual_mm)
