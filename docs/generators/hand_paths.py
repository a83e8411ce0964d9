"""Writes the table of what a path loses of a hand's motion, for rates and jitter of its arrival.

All is computed in virtual time: `python -m docs.generators.hand_paths docs/howto/hands.md`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ergon import _core
from ergon.common.module_arguments import module_arguments

RATES = (60.0, 125.0, 250.0, 1000.0)  # positions a second
JITTERS = (0.0, 2e-3, 10e-3)  # [s], the longest that a position is under way
DELAY = 0.02  # [s]
TICK = 44 / 44100  # [s]
SECONDS = 20.0
_SEED = 65
_WARM = 0.5  # [s] at both ends that are left out
_HEAD = (
    "| positions a second | jitter | latency | rms and greatest error "
    "| latency without time stamps | rms and greatest error without |"
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PathError:
    """The path that a finger follows, against the hand's own `latency` [s] earlier: the root mean
    square and the greatest difference [m], and positions that came too late.
    """

    latency: float
    rms: float
    greatest: float
    late: int


def hand(t: Floats) -> Floats:
    """A hand [m] that draws back and forth by 20 mm, trembles, and knocks twice a second."""
    drawn = 0.02 * np.sin(2 * np.pi * 1.3 * t) + 5e-4 * np.sin(2 * np.pi * 9.0 * t)
    into = np.mod(t, 0.5) / 0.08  # a knock of 80 ms, 6 mm deep: a fourth power has no corner
    return drawn + np.where(into < 1.0, 6e-3 * 16.0 * (into * (1.0 - into)) ** 2, 0.0)


def path_error(rate: float, jitter: float, *, are_stamped: bool) -> PathError:
    """What the path keeps of `hand`, whose positions come `rate` times a second.

    Each is under way for up to `jitter` [s], at random. `are_stamped`: whether positions say when
    they were taken, as those of a page do; else the time of arrival counts.
    """
    rng = np.random.default_rng(_SEED)
    taken = np.arange(0.0, SECONDS, 1.0 / rate)
    # A position does not overtake the one before.
    arrivals = np.maximum.accumulate(taken + rng.uniform(0.0, jitter, len(taken)))
    stamps = taken if are_stamped else arrivals
    times = np.arange(0.0, SECONDS, TICK)
    path, late = _core.even_path(stamps, arrivals, hand(taken), times, DELAY)
    inside = (times > _WARM) & (times < SECONDS - _WARM)
    # The time on the way is latency as well where nothing says how long it was.
    latency = DELAY + (0.0 if are_stamped else 0.5 * jitter)
    difference = path[inside] - hand(times[inside] - latency)
    rms = float(np.sqrt(np.mean(difference**2)))
    return PathError(latency, rms, float(np.max(np.abs(difference))), late)


def table() -> str:
    """The table of the page, in Markdown."""
    lines = [_HEAD, "|---|---|---|---|---|---|"]
    for rate in RATES:
        for jitter in JITTERS:
            cells = [f"{rate:g} Hz", f"{jitter * 1e3:g} ms"]
            for are_stamped in (True, False):
                error = path_error(rate, jitter, are_stamped=are_stamped)
                cells.append(f"{error.latency * 1e3:g} ms")
                cells.append(f"{error.rms * 1e3:.3f} mm, {error.greatest * 1e3:.3f} mm")
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def with_table(page: str) -> str:
    """The page with the table in place of the one that it has."""
    before, _, rest = page.partition(_HEAD)
    return before + table() + rest[rest.index("\n\n") + 1 :]


if __name__ == "__main__":
    target = Path(module_arguments("PAGE")[0])
    target.write_text(with_table(target.read_text()))
