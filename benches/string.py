"""A linear string of 1,000 masses, plucked, heard at two of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from benches import sides
from benches.measure import Row
from benches.modes import Body, ring, row, tuned
from benches.native import Loops
from benches.peers import faust
from benches.planned import planned
from benches.sides import Floats, Run, Side
from ergon import _core

RATE = 44100.0
ROUNDS = 5
N = 1_000
_M, _F, _T60 = 8e-3, 20.0, 3000.0  # partials up to 12.7 kHz; that at 1 kHz lasts 1.2 s
_KICK_POINT, _HIGH = 199, 1e-3
TAPS = (249, 499)
_FRAMES = 44_100  # a multiple of three, as the stencil wants it
# Rounding differs between a state of x and x⁻ and a state of x and its step; it grows over the
# compared frames.
_SAME = 1e-8
_PROBED = 198
BUDGET: Mapping[str, Any] = {"error_db": -80.0}


def string(loops: Loops | None) -> list[Row]:
    """The engine within its budget compared with CA in C and in Faust; all errors are against the
    exact modes.
    """
    network = _network()
    timeline = _core.Timeline(network, RATE)
    plain = _core.Simulation(network, timeline)
    x, d = plain.positions(), plain.velocities() / RATE
    references, missing = [], {}
    lowest = float(row(N)[0][0])
    k, z = tuned(lowest, _M / N, _F, _T60)
    a, b = k / (_M / N) / RATE**2, z / (_M / N) / RATE
    if loops is None:
        missing["C"] = "no compiler (`cc`) here"
    else:
        references += [
            Side("C, a list of links", partial(_listed, loops, a, b, x, d)),
            Side("C, a stencil", partial(_stencil, loops, a, b, x, d)),
        ]
    name = "Faust mi.lib, double"
    numbers = {
        "n": N,
        "K": a,
        "Z": b,
        "at": _KICK_POINT,
        "high": _HIGH,
        "kick": float(d[_KICK_POINT]),
    }
    numbers |= {"first": TAPS[0], "second": TAPS[1]}
    built = sides.attempt(lambda: Side(name, partial(faust.Program("string", numbers).begin, RATE)))
    if isinstance(built, Side):
        references.append(built)
    else:
        missing[name] = built
    sides.agree([sides.engine("CA", plain), *references], _PROBED, _SAME)
    all_sides = [sides.engine("ergon", planned(network, timeline, **BUDGET)), *references]
    truth = _truth()
    errors = {side.name: sides.error(side.begin()(_FRAMES), truth) for side in all_sides}
    taken = sides.seconds(ROUNDS, all_sides, _FRAMES)
    scene = "string of 1,000 masses, plucked, 1 s"
    return sides.rows(scene, "asked for -80 dB", taken, errors, missing, _FRAMES / RATE, 2 * N + 1)


def _pulled() -> Floats:
    i = np.arange(N)
    return np.where(
        i <= _KICK_POINT, _HIGH * (i + 1) / (_KICK_POINT + 1), _HIGH * (N - i) / (N - _KICK_POINT)
    )


def _network() -> _core.Network:
    network = _core.Network()
    network.part("string")
    first = network.string("", masses=N, M=_M, f=_F, t60=_T60)
    for i, x in enumerate(_pulled()):
        network.start(first + i, float(x), 0.0)
    for tap in TAPS:
        network.listen(f"tap{tap}", positions=[(first + tap, 1, 1.0)])
    return network


def _truth() -> Floats:
    """The same string as its modes: closed form."""
    eigenvalues, shapes = row(N)
    k, z = tuned(float(eigenvalues[0]), _M / N, _F, _T60)
    m = _M / N
    listened = shapes[list(TAPS)]
    body = Body(k / m * eigenvalues, 0.5 * z / m * eigenvalues, listened)
    q = shapes.T @ _pulled()
    return ring(body, body.phasor(q, np.zeros(N)), np.arange(_FRAMES) / RATE, listened)


def _listed(loops: Loops, a: float, b: float, x: Floats, d: Floats) -> Run:
    # Both ends are points with 1/M = 0, which no force moves.
    first = np.arange(N + 1, dtype=np.int32)
    second = first + np.int32(1)
    x, d = np.pad(x[:N], 1), np.pad(d[:N], 1)
    w = np.pad(np.ones(N), 1)
    force = np.empty_like(x)
    taps = np.array(TAPS, dtype=np.int32) + np.int32(1)

    def run(n_frames: int) -> Floats:
        out = np.empty((n_frames, len(TAPS)))
        loops.call(
            "list", n_frames, N + 2, N + 1, first, second, a, 0.0, b, w, x, d, force,
            len(TAPS), taps, out,
        )  # fmt: skip
        return out

    return run


def _stencil(loops: Loops, a: float, b: float, x: Floats, d: Floats) -> Run:
    now, before, after = np.pad(x[:N], 1), np.pad(x[:N] - d[:N], 1), np.zeros(N + 2)
    taps = np.array(TAPS, dtype=np.int32) + np.int32(1)

    def run(n_frames: int) -> Floats:
        assert n_frames % 3 == 0
        out = np.empty((n_frames, len(TAPS)))
        loops.call("string", n_frames, N, a, b, now, before, after, len(TAPS), taps, out)
        return out

    return run
