"""What a voice costs: the processor time that more sound takes, least of several rounds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_SHORTEST = 0.1  # seconds; a shorter run is repeated, so that a pause of the machine cannot hide

_BUSY = 0.1  # seconds; live sound is late unless a buffer holds what a longer rush takes


@dataclass(frozen=True, slots=True)
class Voices:
    """Voices that play together for some seconds of sound beyond their start.

    `long` returns the processor time of it [s]. If it counts the start too, `start` returns the
    processor time of that alone.
    """

    count: int
    seconds: float
    long: Callable[[], float]
    start: Callable[[], float] | None = None


def polyphony(count: int, seconds: float, spent: float) -> float:
    """How many voices one core plays in real time, if `count` of them take `spent` [s] for seconds
    of sound.
    """
    return count * seconds / spent


def counted(
    run: Callable[[], object], prepare: Callable[[], object] = lambda: None
) -> Callable[[], float]:
    """A call that returns the least processor time of a run [s]; that of `prepare`, which precedes
    each run, does not count.
    """

    def least() -> float:
        shortest, total = math.inf, 0.0
        while total < _SHORTEST:
            prepare()
            before = time.process_time()
            run()
            spent = time.process_time() - before
            shortest, total = min(shortest, spent), total + spent
        return shortest

    return least


def evenness(times: NDArray[np.float64], length: float) -> float:
    """The mean cost of blocks that last `length` [s] over that of the busiest tenth of a second.

    `times` are the processor times of the blocks [s]; the result is 1 if all cost the same.
    """
    together = min(len(times), round(_BUSY / length))
    highest = np.convolve(times, np.ones(together) / together, "valid").max()
    return float(times.mean() / highest)


def in_turns(rounds: int, sides: Mapping[str, Voices]) -> dict[str, float]:
    """How many voices of each side play at once: all take turns in every round, and the least times
    of the rounds count.
    """
    long = dict.fromkeys(sides, math.inf)
    start = {name: math.inf if side.start else 0.0 for name, side in sides.items()}
    for _ in range(rounds):
        for name, side in sides.items():
            long[name] = min(long[name], side.long())
            if side.start:
                start[name] = min(start[name], side.start())
    return {
        name: polyphony(side.count, side.seconds, long[name] - start[name])
        for name, side in sides.items()
    }
