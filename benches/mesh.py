"""A linear mesh of 32 × 32 masses in a held rim, struck by a hammer, heard at two of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from benches import sides
from benches.measure import Row
from benches.modes import Body, row, tuned
from benches.native import Loops
from benches.peers import faust
from benches.planned import planned
from benches.sides import Floats, Run, Side
from benches.struck import Hammer, struck
from ergon import _core

RATE = 44100.0
ROUNDS = 5
SIDE = 32
_WIDE = SIDE + 2
_M, _F, _T60 = 0.3, 220.0, 6.0  # partials up to 4.6 kHz
_HAMMER = Hammer(m=8e-3, k=4e4, x=-1e-4, v=2.0)
# Places as (row, column) of the masses; the rim lies outside.
_STRUCK, TAPS = (9, 13), ((5, 20), (22, 8))
_FRAMES = 22_050  # a multiple of three
_SAME = 1e-8
_PROBED = 300
BUDGET: Mapping[str, Any] = {"error_db": -60.0}


def mesh(loops: Loops | None) -> list[Row]:
    """The engine within its budget compared with CA in C and in Faust; all errors are against the
    exact modes.
    """
    network = _network()
    timeline = _core.Timeline(network, RATE)
    k, z = _links()
    m = _M / SIDE**2
    a, b = k / m / RATE**2, z / m / RATE
    references, missing = [], {}
    if loops is None:
        missing["C"] = "no compiler (`cc`) here"
    else:
        references.append(Side("C, a stencil", partial(_stencil, loops, a, b)))
    name = "Faust mi.lib, double"
    numbers: dict[str, float | int] = {"side": SIDE, "K": a, "Z": b, "hammer": _HAMMER.m / m}
    numbers |= {"stiff": _HAMMER.k / m / RATE**2, "below": _HAMMER.x, "before": _before()}
    numbers |= {"struck": _place(_STRUCK), "first": _place(TAPS[0]), "second": _place(TAPS[1])}
    built = sides.attempt(lambda: Side(name, partial(faust.Program("mesh", numbers).begin, RATE)))
    if isinstance(built, Side):
        references.append(built)
    else:
        missing[name] = built
    plain = sides.engine("CA", _core.Simulation(network, timeline))
    sides.agree([plain, *references], _PROBED, _SAME)
    all_sides = [sides.engine("ergon", planned(network, timeline, **BUDGET)), *references]
    truth = _truth()
    errors = {side.name: sides.error(side.begin()(_FRAMES), truth) for side in all_sides}
    taken = sides.seconds(ROUNDS, all_sides, _FRAMES)
    scene = "mesh of 32 × 32 masses, struck by a hammer, 0.5 s"
    modules = SIDE**2 + 2 * SIDE * (SIDE + 1) + 2
    return sides.rows(scene, "asked for -60 dB", taken, errors, missing, _FRAMES / RATE, modules)


def _place(at: tuple[int, int]) -> int:
    """Index of a mass when rows begin and end with the rim."""
    return (at[0] + 1) * _WIDE + at[1] + 1


def _before() -> float:
    return _HAMMER.x - _HAMMER.v / RATE


def _links() -> tuple[float, float]:
    lowest = 2.0 * float(row(SIDE)[0][0])
    return tuned(lowest, _M / SIDE**2, _F, _T60)


def _network() -> _core.Network:
    """Row by row, with the rim, so that links form runs."""
    network = _core.Network()
    network.part("mesh")
    k, z = _links()
    inside = range(1, SIDE + 1)
    for i in range(_WIDE * _WIDE):
        if i // _WIDE in inside and i % _WIDE in inside:
            network.mas(f"m{i}", M=_M / SIDE**2)
        else:
            network.sol(f"m{i}")
    for r in inside:
        for i in range(r * _WIDE, r * _WIDE + SIDE + 1):
            network.ref(f"r{i}", i, i + 1, K=k, Z=z)
    for r in range(SIDE + 1):
        for i in range(r * _WIDE + 1, r * _WIDE + SIDE + 1):
            network.ref(f"u{i}", i, i + _WIDE, K=k, Z=z)
    network.part("hammer")
    hammer = network.mas("h", M=_HAMMER.m, X0=_HAMMER.x, V0=_HAMMER.v)
    network.but("b", hammer, _place(_STRUCK), K=_HAMMER.k)
    for tap in TAPS:
        network.listen(f"tap{_place(tap)}", positions=[(_place(tap), 1, 1.0)])
    return network


def _truth() -> Floats:
    eigenvalues, shapes = row(SIDE)
    k, z = _links()
    m = _M / SIDE**2
    both = np.add.outer(eigenvalues, eigenvalues).ravel()
    points = [np.outer(shapes[r], shapes[c]).ravel() for r, c in (_STRUCK, *TAPS)]
    body = Body(k / m * both, 0.5 * z / m * both, np.array(points) / math.sqrt(m))
    return struck(body, _HAMMER, RATE, _FRAMES)[:, 1:]


def _stencil(loops: Loops, a: float, b: float) -> Run:
    buffers = [np.zeros(_WIDE**2) for _ in range(3)]
    hammer = np.array([_HAMMER.x, _before()])
    taps = np.array([_place(tap) for tap in TAPS], dtype=np.int32)
    push, lift = (_HAMMER.k / m / RATE**2 for m in (_HAMMER.m, _M / SIDE**2))

    def run(n_frames: int) -> Floats:
        assert n_frames % 3 == 0
        out = np.empty((n_frames, len(TAPS)))
        loops.call(
            "mesh", n_frames, SIDE, a, b, *buffers, hammer, _place(_STRUCK), push, lift,
            len(TAPS), taps, out,
        )  # fmt: skip
        return out

    return run
