"""A gong with hardening on every link: it has no linear part that a plan could use."""

from __future__ import annotations

from functools import partial

import numpy as np

from benches import sides
from benches.measure import Row
from benches.native import Loops
from benches.planned import planned
from benches.sides import Run, Side
from benches.wiring import RATE, Floats, Ints, bent, neighbours, runs, spring
from ergon import _core

ROUNDS = 7
_M, _Q = 0.3, 4e8
_FRAMES = 1_000
_PROBED = 200
# The sums have another order, and its rounding errors grow over the compared frames.
_SAME = 1e-8


def gong(loops: Loops | None) -> list[Row]:
    """A hex PLATE of 10,267 masses and 30,450 links, on one thread and on two."""
    network, n_free = bent(plate, 1e-5, 1e-2)
    n_mat, n_lia = network.n_mat, network.n_lia
    taps = np.array([n_free // 4, n_free // 2], dtype=np.int32)
    for tap in taps:
        network.listen(f"tap{tap}", positions=[(int(tap), 1, 1.0)])
    timeline = _core.Timeline(network, RATE)
    ours = [
        sides.engine(name, planned(network, timeline, threads=threads, method="ca"))
        for threads, name in ((1, "ergon, 1 thread"), (2, "ergon, 2 threads"))
    ]
    missing = {}
    references = []
    if loops is None:
        missing["C"] = "no compiler (`cc`) here"
    else:
        links = neighbours(np.array([network.position_of(i) for i in range(n_mat)]), n_free)
        assert len(links) == n_lia, f"{len(links)} neighbours, but {n_lia} links"
        k, z = spring(plate, links, _Q)
        w = np.where(np.arange(n_mat) < n_free, 1.0 / (RATE * RATE * _M / n_free), 0.0)
        plain = _core.Simulation(network, timeline)
        begun = w, plain.positions(), plain.velocities() / RATE
        for name, how in (("C, runs of links", "runs"), ("C, a list of links", "list")):
            begin = partial(_loop, loops, how, links, (k, _Q, z), begun, taps)
            references.append(Side(name, begin))
    everyone = [*ours, *references]
    sides.agree(everyone, _PROBED, _SAME)
    taken = sides.seconds(ROUNDS, everyone, _FRAMES)
    scene = "gong of 40,000 modules, hardening"
    sound = _FRAMES / RATE
    return [
        row
        for side in ours
        for row in sides.rows(
            scene,
            side.name,
            {name: taken[name] for name in (side.name, *(other.name for other in references))},
            {},
            missing if side is ours[0] else {},
            sound,
            n_mat + n_lia,
        )
    ]


def plate(network: _core.Network) -> int:
    """The gong: 0.3 kg, 65.4 Hz."""
    return network.plate("", shape="hex", radius=58, M=_M, f=65.4, t60=14.0, hardening=_Q)


def _loop(
    loops: Loops,
    how: str,
    links: Ints,
    law: tuple[float, float, float],
    begun: tuple[Floats, Floats, Floats],
    taps: Ints,
) -> Run:
    w, x, d = begun[0], begun[1].copy(), begun[2].copy()
    force = np.empty_like(x)
    if how == "list":
        order = np.lexsort((links[:, 1], links[:, 0]))
        a, b = (np.ascontiguousarray(column) for column in links[order].T)
        wiring: tuple[Ints, ...] = (a, b)
        room: tuple[Floats, ...] = (force,)
    else:
        wiring = runs(links)
        room = (force, np.empty(int(wiring[2].max())))

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, len(taps)))
        loops.call(
            how, n_frames, len(x), len(wiring[0]), *wiring, *law, w, x, d, *room,
            len(taps), taps, out,
        )  # fmt: skip
        return out

    return run
