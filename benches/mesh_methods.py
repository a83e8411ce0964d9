"""What each method of a mesh costs, and from which size on a second thread gains."""

from __future__ import annotations

from functools import partial

import numpy as np

from benches.measure import Row, interleaved
from benches.planned import planned
from benches.wiring import RATE, bent
from ergon import _core

ROUNDS = 5
# The integral-equation method takes linear meshes alone.
_EXPLICIT = ("ca", "ca2p", "bm4")
_LINEAR = (*_EXPLICIT, "ieq")
_HARDENING = 1e13
_WORK = 3_000_000  # frames times masses of a run


def mesh_methods() -> list[Row]:
    """Every method beside CA, on a small and a large gong; then two threads beside one."""
    rows = []
    for radius, f in ((10, 500.0), (58, 60.0)):
        for hardening, methods in ((_HARDENING, _EXPLICIT), (0.0, _LINEAR)):
            title = "hardening" if hardening else "linear"
            network, count = _gong(radius, f, hardening)
            scene = f"gong of {count} masses, {title}"
            rows += _rows(scene, network, {name: (name, 1) for name in methods}, count)
    for radius in (8, 12, 18, 26, 58):
        network, count = _gong(radius, 60.0, _HARDENING)
        runs = {"1 thread": ("ca", 1), "2 threads": ("ca", 2)}
        rows += _rows(f"gong of {count} masses, shared", network, runs, count)
    return rows


def _rows(
    scene: str, network: _core.Network, runs: dict[str, tuple[str, int]], count: int
) -> list[Row]:
    frames = max(50, _WORK // count)
    timeline = _core.Timeline(network, RATE)
    simulations = {
        name: planned(network, timeline, threads=threads, method=method)
        for name, (method, threads) in runs.items()
    }
    taken = interleaved(
        ROUNDS,
        {name: partial(simulation.process, np.empty((frames, 1)))
         for name, simulation in simulations.items()},
    )  # fmt: skip
    first = next(iter(taken))
    return [
        Row(
            scene,
            f"{name}, {1e6 * seconds / frames:.2f} µs a frame",
            f"{first}, {1e6 * taken[first] / frames:.2f} µs",
            seconds / taken[first],
            "of its time",
            {"us": 1e6 * seconds / frames},
        )
        for name, seconds in taken.items()
        if name != first
    ]


def _gong(radius: int, f: float, hardening: float) -> tuple[_core.Network, int]:
    """A hex plate with a fixed rim that swings, heard in its middle; its number of masses."""
    sizes = {"radius": radius, "M": 1.0, "f": f, "t60": 2.0, "hardening": hardening}
    network, count = bent(
        lambda body: body.plate("", shape="hex", rim="fixed", **sizes), 1e-5, 1e-2
    )
    network.listen("tap", positions=[(network.centre(0), 1, 1.0)])
    return network, count
