"""Networks beside plain C loops of the same networks, in module-steps per second.

A module is a MAT or a LIA. Both sides start from the same state and must end in the same, so that
it is the same work.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benches.measure import Row, interleaved
from benches.native import Loops
from ergon import _core

RATE = 44100.0
ROUNDS = 9
# Rounding by another order of sums, grown over the frames compared.
_SAME = 1e-8
_PROBED = 40  # links whose force tells k and z
Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Reference:
    """A C loop: its name, and a call that goes on `n_frames` and gives (x, out)."""

    name: str
    run: Callable[[int], tuple[Floats, Floats]]


def bank(loops: Loops | None) -> list[Row]:
    """10,000 oscillators, all heard in one output."""
    count, m, f, t60 = 10_000, 1e-3, (20.0, 10_000.0), (0.5, 8.0)
    network = _core.Network()
    network.part("sky")
    first = network.bank("", count=count, M=m, f=f, t60=t60)
    for i in range(count):
        network.start(first + i, 1e-6 * (1 + i % 7), 0.0)
    network.listen("all", positions=[(first, count, 1.0)])
    sim = _core.Simulation(network, _core.Timeline(network, RATE))
    references = []
    if loops is not None:
        # Poles r·exp(±jθ): the discrete cell has exactly the frequency and decay of the continuous.
        share = np.arange(count) / (count - 1)
        theta = 2 * math.pi * f[0] * (f[1] / f[0]) ** share / RATE
        r = np.exp(-math.log(1000.0) / (t60[1] * (t60[0] / t60[1]) ** share) / RATE)
        kappa, zeta = 1.0 + r * r - 2.0 * r * np.cos(theta), 1.0 - r * r
        x, d = sim.positions(), sim.velocities() / RATE

        def run(n_frames: int) -> tuple[Floats, Floats]:
            out = np.empty((n_frames, 1))
            loops.call("bank", n_frames, count, kappa, zeta, x, d, out)
            return x, out

        references.append(Reference("C", run))
    return _rows("bank of 10,000 oscillators", sim, count, 4_000, references)


def gong(loops: Loops | None) -> list[Row]:
    """A hex PLATE with hardening on every link: 10,267 masses, 30,450 links."""
    q = 4e8

    def build(network: _core.Network) -> int:
        return network.plate("", shape="hex", radius=58, M=0.3, f=65.4, t60=14.0, hardening=q)

    return _mesh("gong of 40,000 modules, hardening", build, 0.3, q, 1_000, ["list", "runs"], loops)


def string(loops: Loops | None) -> list[Row]:
    """A linear STRING, heard at two of its masses; lower and brighter than this CA diverges."""

    def build(network: _core.Network) -> int:
        return network.string("", masses=1_000, M=8e-3, f=11.0, t60=600.0)

    return _mesh("string of 1,000 masses", build, 8e-3, 0.0, 40_000, ["list"], loops)


def _mesh(
    scene: str,
    build: Callable[[_core.Network], int],
    mass: float,
    q: float,
    n_frames: int,
    names: list[str],
    loops: Loops | None,
) -> list[Row]:
    """A generator's network beside the loops `names`, listened to at a quarter and the middle."""
    network, n_free = _bent(build, 1e-5, 1e-2)
    n_mat, n_lia = network.n_mat, network.n_lia
    links = _links(np.array([network.position_of(i) for i in range(n_mat)]), n_free)
    assert len(links) == n_lia, f"{scene}: {len(links)} neighbours, but {n_lia} links"
    taps = np.array([n_free // 4, n_free // 2], dtype=np.int32)
    references = []
    if loops is not None:
        k, z = _spring(build, links, q)
        w = np.where(np.arange(n_mat) < n_free, 1.0 / (RATE * RATE * mass / n_free), 0.0)
    for tap in taps:
        network.listen(f"tap{tap}", positions=[(int(tap), 1, 1.0)])
    sim = _core.Simulation(network, _core.Timeline(network, RATE))
    for name in names if loops is not None else ():
        x, d = sim.positions(), sim.velocities() / RATE
        references.append(_loop(loops, name, links, (k, q, z), w, x, d, taps))
    return _rows(scene, sim, n_mat + n_lia, n_frames, references)


def _bent(
    build: Callable[[_core.Network], int], bend: float, speed: float
) -> tuple[_core.Network, int]:
    """A body bent a little, or moving, and how many masses are free: no link is still."""
    network = _core.Network()
    network.part("body")
    first = build(network)
    assert first == 0
    n_free = network.count(first)
    for i in range(n_free):
        x, y = network.position_of(i)
        network.start(i, bend * math.sin(5.0 * x + 3.0 * y), speed * math.sin(4.0 * x - 3.0 * y))
    return network, n_free


def _loop(
    loops: Loops,
    name: str,
    links: Ints,
    spring: tuple[float, float, float],
    w: Floats,
    x: Floats,
    d: Floats,
    taps: Ints,
) -> Reference:
    force = np.empty_like(x)
    if name == "list":
        order = np.lexsort((links[:, 1], links[:, 0]))
        a, b = (np.ascontiguousarray(column) for column in links[order].T)
        wiring: tuple[Ints, ...] = (a, b)
        room: tuple[Floats, ...] = (force,)
    else:
        wiring = _runs(links)
        room = (force, np.empty(int(wiring[2].max())))

    def run(n_frames: int) -> tuple[Floats, Floats]:
        out = np.empty((n_frames, len(taps)))
        loops.call(
            name, n_frames, len(x), len(wiring[0]), *wiring, *spring, w, x, d, *room,
            len(taps), taps, out,
        )  # fmt: skip
        return x, out

    return Reference(f"C, {name}", run)


def _links(places: Floats, n_free: int) -> Ints:
    """Neighbours (a, b) by their distance on the bench, b above a or to its right: (n_lia, 2).

    Those to the right come first, from below and from the left.
    """
    reach = 1.01 * float(np.hypot(*(places[0] - places[1])))
    width = 1.0001 * reach
    cells: dict[tuple[int, int], list[int]] = {}
    for i, (x, y) in enumerate(places):
        cells.setdefault((int(x // width), int(y // width)), []).append(i)
    found = []
    for (column, row), members in cells.items():
        near = [
            j for c in (-1, 0, 1) for r in (-1, 0, 1) for j in cells.get((column + c, row + r), ())
        ]
        for i in members:
            found += [
                (i, j)
                for j in near
                if j > i and i < n_free and np.hypot(*(places[i] - places[j])) < reach
            ]
    links = np.array(found, dtype=np.int32)
    right, up = (places[links[:, 1]] - places[links[:, 0]]).T
    level = np.abs(up) < 0.1 * reach
    back = np.where(level, right < 0.0, up < 0.0)
    links[back] = links[back, ::-1]
    left, low = (places[links[:, 0]] / reach).round(3).T
    return links[np.lexsort((left, low, ~level))]


def _runs(links: Ints) -> tuple[Ints, Ints, Ints]:
    """Runs (a, b, len) of links that go on side by side."""
    a, b = links.T
    order = np.lexsort((a, b - a))
    a, b = a[order], b[order]
    begins = np.flatnonzero(np.r_[True, (np.diff(a) != 1) | (np.diff(b) != 1)])
    length = np.diff(np.r_[begins, len(a)])
    return a[begins].copy(), b[begins].copy(), length.astype(np.int32)


def _spring(build: Callable[[_core.Network], int], links: Ints, q: float) -> tuple[float, float]:
    """k and z of all links, from the force of some: in a bent body, and in one that moves."""
    rows, sums = [], []
    for size in ((1e-5, 0.0), (0.0, 1e-2)):
        network, _ = _bent(build, *size)
        # Generators lay their links to the right first, row by row.
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


def _rows(
    scene: str, sim: _core.Simulation, modules: int, n_frames: int, references: list[Reference]
) -> list[Row]:
    out = np.empty((200, sim.n_out))
    sim.process(out)
    for reference in references:
        x, heard = reference.run(200)
        for ours, theirs in ((sim.positions(), x), (out, heard)):
            error = np.abs(ours - theirs).max() / np.abs(ours).max()
            assert error < _SAME, f"{scene}: {reference.name} differs by {error:.1e}"
    block = np.empty((n_frames, sim.n_out))
    runs: dict[str, Callable[[], object]] = {"ergon": lambda: sim.process(block)}
    for reference in references:
        runs[reference.name] = lambda run=reference.run: run(n_frames)
    seconds = interleaved(ROUNDS, runs)
    speed = {name: modules * n_frames / taken for name, taken in seconds.items()}
    ours = f"{speed['ergon']:.3g} module-steps/s"
    values = {"modules": modules, "x_real_time": n_frames / RATE / seconds["ergon"], **speed}
    sense = "speed over the reference's"
    if not references:
        return [Row(scene, ours, "no C compiler (`cc`) here", None, sense, values)]
    return [
        Row(scene, ours, f"{name}: {theirs:.3g}", speed["ergon"] / theirs, sense, values)
        for name, theirs in speed.items()
        if name != "ergon"
    ]
