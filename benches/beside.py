"""A bare timing loop beside a measurement: it shows how late the machine alone makes a tick."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from benches.native import Loops
from ergon.live.fitness import TICK_SECONDS

# Below the priorities of the physics thread (78) and the card's (65): it delays no tick of what
# runs beside it.
_PRIORITY = 60


@dataclass
class Bare:
    """Results of a thread that only wakes at every tick."""

    ticks: int = 0
    late: float = 0.0  # of all ticks, by the rule of a performance: by more than half a tick
    worst: float = 0.0  # [s]
    is_fifo: bool = False

    def __str__(self) -> str:
        """`a bare loop beside it: 0.310% late, worst 33 ms`."""
        granted = "" if self.is_fifo else " (SCHED_FIFO refused)"
        return (
            f"a bare loop beside it{granted}: {self.late:.3%} late, worst {self.worst * 1e3:.0f} ms"
        )

    def ratio(self, late: float) -> float | None:
        """The ratio of another thread's late ticks to this one's."""
        return late / self.late if self.late else None


@contextmanager
def bare(loops: Loops | None) -> Iterator[Bare | None]:
    """Run the bare loop during the block; None if there is no compiler."""
    if loops is None or not loops.has("ticks"):
        yield None
        return
    result, going, output = Bare(), np.ones(1, dtype=np.int64), np.zeros(4, dtype=np.int64)
    # It has its own thread: the call releases the GIL as long as it lasts.
    loop = threading.Thread(
        target=loops.call, args=("ticks", _PRIORITY, TICK_SECONDS, going, output)
    )
    loop.start()
    try:
        yield result
    finally:
        going[0] = 0
        loop.join()
    ticks, late, worst, priority = (int(value) for value in output)
    result.ticks, result.late = ticks, late / max(ticks, 1)
    result.worst, result.is_fifo = worst * 1e-9, priority >= 0
