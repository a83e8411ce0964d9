"""Medians of interleaved rounds, so that other load on the machine affects all runs alike."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

_STOPWATCH = Path(__file__).parent / "stopwatch.py"


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: what was measured, its reference, and their ratio.

    `ratio` is ours over the reference in the sense of `sense`; `values` holds the underlying
    numbers.
    """

    scene: str
    ours: str
    reference: str
    ratio: float | None
    sense: str
    values: Mapping[str, float | int | str] = field(default_factory=dict)


def interleaved(rounds: int, runs: Mapping[str, Callable[[], object]]) -> dict[str, float]:
    """Median wall time of each run [s]. All runs take turns in every round, after one round to warm
    up.

    A run that returns a float reports its own time.
    """
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for number in range(rounds + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            output = run()
            spent = output if isinstance(output, float) else time.perf_counter() - start
            if number:
                taken[name].append(spent)
    return {name: median(times) for name, times in taken.items()}


@dataclass(frozen=True, slots=True)
class Spent:
    """Medians of a command: wall time [s], processor time [s], peak memory [MB]."""

    wall: float
    cpu: float
    memory: float


def commands(rounds: int, lines: Mapping[str, list[str]]) -> dict[str, Spent]:
    """The cost of each command line, interleaved; raises if one fails."""
    taken: dict[str, list[tuple[float, float, float]]] = {name: [] for name in lines}
    for number in range(rounds + 1):
        for name, line in lines.items():
            spent = _stopwatch(line)
            if number:
                taken[name].append(spent)
    return {name: Spent(*map(median, zip(*all, strict=True))) for name, all in taken.items()}


def _stopwatch(line: list[str]) -> tuple[float, float, float]:
    # A separate small process starts the command: memory inherited by a fork would count as its
    # peak.
    watch = [sys.executable, "-I", "-S", str(_STOPWATCH), *line]
    result = json.loads(subprocess.run(watch, check=True, capture_output=True).stdout)
    assert result["code"] == 0, f"{line} ended with {result['code']}"
    return result["wall"], result["cpu"], result["memory"]
