"""A bare loop beside what is measured: how late the machine alone makes a tick."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from benches.native import Loops
from ergon.live.fitness import PERIOD

# Under the physics thread (78) and the card's (65): it takes no tick from what it stands beside.
_PRIORITY = 60


@dataclass
class Bare:
    """What a thread that only wakes, tick after tick, told in the end."""

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
        """Another's late ticks over its own."""
        return late / self.late if self.late else None


@contextmanager
def bare(loops: Loops | None) -> Iterator[Bare | None]:
    """Let one run meanwhile; None where nothing compiles it."""
    if loops is None or not loops.has("ticks"):
        yield None
        return
    found, going, told = Bare(), np.ones(1, dtype=np.int64), np.zeros(4, dtype=np.int64)
    # A thread of its own: the call lets go of Python for as long as it lasts.
    loop = threading.Thread(target=loops.call, args=("ticks", _PRIORITY, PERIOD, going, told))
    loop.start()
    try:
        yield found
    finally:
        going[0] = 0
        loop.join()
    ticks, late, worst, priority = (int(value) for value in told)
    found.ticks, found.late = ticks, late / max(ticks, 1)
    found.worst, found.is_fifo = worst * 1e-9, priority >= 0
