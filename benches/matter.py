"""A cloth in space compared with C loops: links along distances, with no linear part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benches import sides
from benches.measure import Row
from benches.native import Loops
from benches.planned import planned
from benches.sides import Floats, Run, Side
from ergon import _core

ROUNDS = 7
RATE = 44_100.0
SIDE = 100  # points along each side
M, _K, _SHEAR, _SPACING, _G = 1e-4, 500.0, 80.0, 0.01, 9.81
_FRAMES, _PROBED = 400, 200
_SAME = 1e-9  # rounding by another order of sums

# (first point, second point, how many, stiffness, rest)
_Links = tuple[int, int, int, float, float]


def matter(loops: Loops | None) -> list[Row]:
    """A cloth of 10,000 points and 39,402 springs that is struck, on one thread."""
    n, runs = SIDE * SIDE, runs_of_cloth(SIDE)
    network, tap = cloth(SIDE, runs)
    timeline = _core.Timeline(network, RATE)
    ours = sides.engine("ergon", planned(network, timeline, method="ca"))
    missing = {} if loops else {"C": "no compiler (`cc`) here"}
    references = []
    if loops:
        plain = _core.Simulation(network, timeline)
        begun = plain.positions(), plain.velocities() / RATE
        for name, how in (("C, a list of links", _list), ("C, runs of links", _run)):
            references.append(Side(name, lambda how=how: how(loops, n, runs, begun, tap)))
    everyone = [ours, *references]
    sides.agree(everyone, _PROBED, _SAME)
    taken = sides.seconds(ROUNDS, everyone, _FRAMES)
    modules = n + sum(run[2] for run in runs)
    scene = f"cloth in space of {modules:,} modules"
    return sides.rows(scene, "one thread", taken, {}, missing, _FRAMES / RATE, modules)


def runs_of_cloth(side: int) -> list[_Links]:
    """Links in runs: along rows, along columns, across the meshes."""
    far = _SPACING * float(np.sqrt(2.0))
    rows = [(j * side, j * side + 1, side - 1, _K, _SPACING) for j in range(side)]
    columns = [(0, side, side * (side - 1), _K, _SPACING)]
    across = [
        (j * side + i, (j + 1) * side + 1 - i, side - 1, _SHEAR, far)
        for j in range(side - 1)
        for i in (0, 1)
    ]
    return rows + columns + across


def cloth(side: int, runs: Sequence[_Links]) -> tuple[_core.Network, int]:
    n = side * side
    network = _core.Network()
    network.part("cloth")
    index = np.arange(n)
    x, y = _SPACING * (index % side), _SPACING * (index // side)
    bump = 1e-3 * np.exp(-((x - 0.4) ** 2 + (y - 0.6) ** 2) / 0.01)
    places = np.concatenate([x, y, bump])
    mass = np.where((index == 0) | (index == side - 1), 0.0, M)
    first = network.points("", axes=3, M=list(mass), X0=list(places), V0=[0.0] * (3 * n))
    for a, b, count, stiff, rest in runs:
        ends = (range(first + end, first + end + 3 * n, n) for end in (a, b))
        network.space_ref("link", *ends, count=count, rest=rest, K=stiff, Z=0.01)
    network.weigh(first + 2 * n, n, -_G)
    tap = 2 * n + n // 2 + side // 3
    network.listen("tap", positions=[(tap, 1, 1.0)])
    return network, tap


def _numbers(n: int) -> tuple[Floats, Floats]:
    """1/M of each coordinate in a step, and its weight, axis by axis."""
    held = np.zeros(n, dtype=bool)
    held[[0, SIDE - 1]] = True
    w = np.tile(np.where(held, 0.0, 1.0 / (RATE * RATE * M)), 3)
    weight = np.zeros(3 * n)
    weight[2 * n :] = np.where(held, 0.0, -M * _G)
    return w, weight


def _list(
    loops: Loops, n: int, runs: Sequence[_Links], begun: tuple[Floats, Floats], tap: int
) -> Run:
    a, b, k, rest = (
        np.concatenate([np.atleast_1d(one) for one in column])
        for column in zip(
            *(
                (
                    np.arange(a, a + count, dtype=np.int32),
                    np.arange(b, b + count, dtype=np.int32),
                    np.full(count, stiff),
                    np.full(count, rest),
                )
                for a, b, count, stiff, rest in runs
            ),
            strict=True,
        )
    )

    def together(all_axes: Floats) -> Floats:
        return np.ascontiguousarray(all_axes.reshape(3, n).T).ravel()

    w, weight = (together(one) for one in _numbers(n))
    x, d = (together(one) for one in begun)
    force, z = np.empty_like(x), 0.01 * RATE

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, 1))
        listened = 3 * (tap % n) + tap // n
        loops.call(
            "matter_list", n_frames, n, len(a), a, b, k, rest, z, w, weight, x, d, force,
            listened, out,
        )  # fmt: skip
        return out

    return run


def _run(
    loops: Loops, n: int, runs: Sequence[_Links], begun: tuple[Floats, Floats], tap: int
) -> Run:
    columns = list(zip(*runs, strict=True))
    a, b, count = (np.array(column, dtype=np.int32) for column in columns[:3])
    k, rest = (np.array(column) for column in columns[3:])
    w, weight = _numbers(n)
    x, d = (one.copy() for one in begun)
    force, room, z = np.empty_like(x), np.empty(3 * n), 0.01 * RATE

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, 1))
        loops.call(
            "matter_runs", n_frames, n, len(a), a, b, count, k, rest, z, w, weight, x, d, force,
            room, tap, out,
        )  # fmt: skip
        return out

    return run
