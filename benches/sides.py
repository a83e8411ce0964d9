"""The two sides of a comparison: begin at the same state, advance, be timed, be compared with the
exact result.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benches.measure import Row, interleaved
from benches.peers import Missing
from ergon import _core

Floats = NDArray[np.float64]
Run = Callable[[int], Floats]
_LEAST = 0.1  # seconds


@dataclass(frozen=True, slots=True)
class Side:
    """A name, and `begin`: it goes back to the start and returns a call that advances n_frames and
    returns (n, taps).

    The time of `begin` is never measured.
    """

    name: str
    begin: Callable[[], Run]


def engine(name: str, simulation: _core.Simulation, *, every: int = 1) -> Side:
    """A simulation from its present state; only every `every`th frame is heard."""
    begun = simulation.snapshot()

    def begin() -> Run:
        simulation.restore(begun)
        return lambda n_frames: forward(simulation, n_frames, every)

    return Side(name, begin)


def forward(simulation: _core.Simulation, n_frames: int, every: int = 1) -> Floats:
    """Advance n_frames · every frames, in blocks that stay in the cache."""
    out = np.empty((n_frames, simulation.n_out))
    block = np.empty((512 * every, simulation.n_out))
    for i in range(0, n_frames, 512):
        some = block[: every * min(512, n_frames - i)]
        simulation.process(some)
        out[i : i + 512] = some[::every]
    return out


def attempt(built: Callable[[], Side]) -> Side | str:
    """A peer's side, or why there is none."""
    try:
        return built()
    except Missing as missing:
        return str(missing)


def seconds(rounds: int, sides: Sequence[Side], n_frames: int) -> dict[str, float]:
    """The time of n_frames on each side [s]: medians, interleaved, each time from the start."""

    def timed(side: Side) -> float:
        spent, times = 0.0, 0
        while spent < _LEAST:  # a glance of a few milliseconds would show what else is running
            go_on = side.begin()
            start = time.perf_counter()
            go_on(n_frames)
            spent, times = spent + time.perf_counter() - start, times + 1
        return spent / times

    return interleaved(rounds, {side.name: partial(timed, side) for side in sides})


def error(listened: Floats, truth: Floats) -> float:
    """Root mean square of the difference over that of the truth, all outputs together [dB]."""
    wrong = float(np.linalg.norm(listened - truth) / np.linalg.norm(truth))
    return 20.0 * math.log10(max(wrong, 1e-16))


def agree(sides: Sequence[Side], n_frames: int, limit: float) -> None:
    """Fails unless all sides give the result of the first: then they do the same work."""
    first = sides[0].begin()(n_frames)
    for side in sides[1:]:
        differs = np.abs(side.begin()(n_frames) - first).max() / np.abs(first).max()
        assert differs < limit, f"{side.name} differs by {differs:.1e}"


def rows(
    scene: str,
    budget: str,
    taken: Mapping[str, float],
    errors: Mapping[str, float],
    missing: Mapping[str, str],
    sound: float,
    modules: int,
) -> list[Row]:
    """A row for each reference, timed or missing; the first of `taken` is ours."""
    ours, *others = taken
    text = {name: f"{sound / spent:.4g} × real time" for name, spent in taken.items()}
    for name, error in errors.items():
        text[name] += f", {error:.0f} dB"
    values = {"modules": modules} | {f"{name}, s": spent / sound for name, spent in taken.items()}
    values |= {f"{name}, dB": error for name, error in errors.items()}
    asked = f"{text[ours]} ({budget})"
    sense = "speed over the reference's"
    return [
        Row(scene, asked, f"{name}: {text[name]}", taken[name] / taken[ours], sense, values)
        for name in others
    ] + [Row(scene, asked, f"{name}: {why}", None, sense, values) for name, why in missing.items()]
