"""How a generator wires its network, found from what it exposes: places, and the forces of
links.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ergon import _core

RATE = 44100.0
_PROBED = 40  # links whose force tells k and z
Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def bent(
    build: Callable[[_core.Network], int], curvature: float, speed: float
) -> tuple[_core.Network, int]:
    """A body that is slightly bent, or moving, so that no link is at rest; and the number of free
    masses.
    """
    network = _core.Network()
    network.part("body")
    first = build(network)
    assert first == 0
    n_free = network.count(first)
    for i in range(n_free):
        x, y = network.position_of(i)
        network.start(
            i, curvature * math.sin(5.0 * x + 3.0 * y), speed * math.sin(4.0 * x - 3.0 * y)
        )
    return network, n_free


def neighbours(places: Floats, n_free: int) -> Ints:
    """Pairs of neighbours (a, b) by their distance on the bench, b above a or to its right: (n_lia,
    2).

    Pairs to the right come first, from below and from the left.
    """
    reach = 1.01 * float(np.hypot(*(places[0] - places[1])))
    width = 1.0001 * reach
    cells: dict[tuple[int, int], list[int]] = {}
    for i, (x, y) in enumerate(places):
        cells.setdefault((int(x // width), int(y // width)), []).append(i)
    result = []
    for (column, row), members in cells.items():
        near = [
            j for c in (-1, 0, 1) for r in (-1, 0, 1) for j in cells.get((column + c, row + r), ())
        ]
        for i in members:
            result += [
                (i, j)
                for j in near
                if j > i and i < n_free and np.hypot(*(places[i] - places[j])) < reach
            ]
    links = np.array(result, dtype=np.int32)
    right, up = (places[links[:, 1]] - places[links[:, 0]]).T
    level = np.abs(up) < 0.1 * reach
    back = np.where(level, right < 0.0, up < 0.0)
    links[back] = links[back, ::-1]
    left, low = (places[links[:, 0]] / reach).round(3).T
    return links[np.lexsort((left, low, ~level))]


def runs(links: Ints) -> tuple[Ints, Ints, Ints]:
    """Runs (a, b, len) of links that go on side by side."""
    a, b = links.T
    order = np.lexsort((a, b - a))
    a, b = a[order], b[order]
    begins = np.flatnonzero(np.r_[True, (np.diff(a) != 1) | (np.diff(b) != 1)])
    length = np.diff(np.r_[begins, len(a)])
    return a[begins].copy(), b[begins].copy(), length.astype(np.int32)


def spring(build: Callable[[_core.Network], int], links: Ints, q: float) -> tuple[float, float]:
    """k and z of all links, from the summed force of the first ones: in a bent body, and in a
    moving one.
    """
    rows, sums = [], []
    for size in ((1e-5, 0.0), (0.0, 1e-2)):
        network, _ = bent(build, *size)
        # Generators place their links to the right first, row by row.
        network.listen("probe", forces=[(0, _PROBED, 1.0)])
        sim = _core.Simulation(network, _core.Timeline(network, RATE))
        x, d = sim.positions(), sim.velocities() / RATE
        some = links[:_PROBED]
        e, step = (value[some[:, 1]] - value[some[:, 0]] for value in (x, d))
        frame = np.empty((1, 1))
        sim.process(frame)
        rows.append((e.sum(), step.sum()))
        sums.append(-frame[0, 0] - q * (e**3).sum())
    k, z = np.linalg.solve(np.array(rows), np.array(sums))
    return float(k), float(z)
