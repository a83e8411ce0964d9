"""Grains in a drum compared with a C loop: contacts of all pairs, by neighbour lists."""

from __future__ import annotations

import numpy as np

from benches import sides
from benches.measure import Row
from benches.native import Loops
from benches.planned import planned
from benches.sides import Floats, Run, Side
from ergon import _core

ROUNDS = 5
RATE = 44_100.0
N = 5_000
M, K, Z, GAP, G = 5e-4, 2_000.0, 0.05, 8e-3, 9.81
RADIUS, WALL = 0.11, 2_000.0  # of the drum
SKIN = 0.3 * GAP  # as long as that of the engine
_PAIRS = 64  # room for so many a grain
_FRAMES, _PROBED, _SETTLED = 400, 100, 8_000
_SAME = 1e-9  # rounding by another order of sums


def grains(loops: Loops | None) -> list[Row]:
    """5,000 grains that fall in a drum and lie on each other, on one thread."""
    network = settled()
    timeline = _core.Timeline(network, RATE)
    ours = sides.engine("ergon", planned(network, timeline, method="ca"))
    missing = {} if loops else {"C": "no compiler (`cc`) here"}
    references = []
    if loops:
        plain = _core.Simulation(network, timeline)
        begun = plain.positions()[3:], plain.velocities()[3:] / RATE
        references.append(Side("C, a list of neighbours", lambda: _loop(loops, begun)))
    everyone = [ours, *references]
    sides.agree(everyone, _PROBED, _SAME)
    taken = sides.seconds(ROUNDS, everyone, _FRAMES)
    scene = f"{N:,} grains in a drum"
    return sides.rows(scene, "one thread", taken, {}, missing, _FRAMES / RATE, N)


def settled() -> _core.Network:
    """The grains in a state in which most of them touch. The drum's middle comes before their
    coordinates.
    """
    network = _network(*_thrown())
    settling = _core.Simulation(network, _core.Timeline(network, RATE))
    settling.process(np.empty((_SETTLED, 1)))
    return _network(settling.positions()[3:], settling.velocities()[3:])


def _thrown() -> tuple[Floats, Floats]:
    """Places on a lattice within the drum, and speeds, axis by axis."""
    steps = np.arange(-20, 21) * 1.05 * GAP
    places = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)
    inside = np.sqrt((places**2).sum(1)) < RADIUS - GAP
    places = places[inside][:N]
    speeds = 0.3 * np.sin(np.arange(3 * N))
    return places.T.ravel(), speeds


def _network(x: Floats, v: Floats) -> _core.Network:
    network = _core.Network()
    network.part("drum")
    skin = network.points("skin", axes=3, M=[0.0], X0=[0.0] * 3, V0=[0.0] * 3, numbered=False)
    first = network.points("m", axes=3, M=[M] * N, X0=list(x), V0=list(v))
    single = (first, first + N, first + 2 * N), N
    network.pairwise("rattle", single, single, gap=GAP, K=K, Z=Z)
    drum = (skin, skin + 1, skin + 2), 1
    network.pairwise("drum", drum, single, gap=RADIUS, K=WALL, inside=True)
    network.weigh(first + 2 * N, N, -G)
    network.listen("tap", positions=[(first + 2 * N + N // 2, 1, 1.0)])
    return network


def _loop(loops: Loops, begun: tuple[Floats, Floats]) -> Run:
    x, d = (np.ascontiguousarray(one.reshape(3, N).T).ravel() for one in begun)
    w, side = 1.0 / (RATE * RATE * M), int(2 * (RADIUS + GAP) / (GAP + SKIN)) + 3
    force, start = np.empty_like(x), np.empty_like(x)
    heads, after = np.empty(side**3, np.int32), np.empty(N, np.int32)
    starts, others = np.empty(N + 1, np.int32), np.empty(_PAIRS * N, np.int32)

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, 1))
        loops.call(
            "grains", n_frames, N, GAP, SKIN, K, Z * RATE, RADIUS, WALL, w, -M * G,
            side, x, d, force, start, heads, after, starts, others, 3 * (N // 2) + 2, out,
        )  # fmt: skip
        return out

    return run
