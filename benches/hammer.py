"""A hammer on a string of 60 masses: the planned run compared with an equally accurate CA run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from benches import sides
from benches.measure import Row
from benches.modes import Body, row, tuned
from benches.native import Loops
from benches.planned import planned
from benches.sides import Floats, Side
from benches.struck import Hammer, struck
from ergon import _core

RATE = 44100.0
ROUNDS = 5
N = 60
_M, _F, _T60 = 8e-3, 110.0, 4.0
_HAMMER = Hammer(m=8e-3, k=4e4, x=-1e-4, v=3.0)
_STRUCK, TAPS = 7, (20, 44)
_FRAMES = 22_050
_TIMES = (1, 2, 4, 8, 16, 32, 64)
BUDGET: Mapping[str, Any] = {"error_db": -80.0}


def hammer(_: Loops | None) -> list[Row]:
    """The planned run compared with CA at 44.1 kHz times 1 … 64, at equal measured error."""
    truth = _truth()
    network = _network()
    ours = sides.engine("ergon", planned(network, _core.Timeline(network, RATE), **BUDGET))
    plain = {times: _ca(times) for times in _TIMES}
    everyone = [ours, *plain.values()]
    errors = {side.name: sides.error(side.begin()(_FRAMES), truth) for side in everyone}
    taken = sides.seconds(ROUNDS, everyone, _FRAMES)
    sound = _FRAMES / RATE
    reached = errors["ergon"]
    points = [(errors[side.name], taken[side.name]) for side in plain.values()]
    cost, how = _cost_at(reached, points)
    text = f"{sound / taken['ergon']:.4g} × real time, {reached:.0f} dB (asked for -80 dB)"
    values: dict[str, float | int | str] = {"modules": 2 * N + 3}
    for side in everyone:
        values[f"{side.name}, s"] = taken[side.name] / sound
        values[f"{side.name}, dB"] = errors[side.name]
    against = f"CA at {reached:.0f} dB, {how}: {sound / cost:.4g} × real time"
    sense = "speed over CA's at equal error"
    scene = "hammer on a string of 60 masses, 0.5 s"
    return [Row(scene, text, against, cost / taken["ergon"], sense, values)]


def _cost_at(error: float, points: list[tuple[float, float]]) -> tuple[float, str]:
    """The cost of CA for this error, interpolated between two rates on logarithmic scales."""
    better = sorted(points)
    if error <= better[0][0]:
        return better[0][1], f"which even at × {_TIMES[-1]} stays at {better[0][0]:.0f} dB"
    if error >= points[0][0]:
        return points[0][1], f"which already at 44.1 kHz is at {points[0][0]:.0f} dB"
    db, cost = zip(*better, strict=True)
    between = float(np.interp(error, db, np.log(cost)))
    return math.exp(between), "between two of the rates × 1 … 64"


def _ca(times: int) -> Side:
    network = _network()
    simulation = _core.Simulation(network, _core.Timeline(network, times * RATE))
    return sides.engine(f"CA × {times}", simulation, every=times)


def _network() -> _core.Network:
    network = _core.Network()
    network.part("string")
    first = network.string("", masses=N, M=_M, f=_F, t60=_T60)
    for tap in TAPS:
        network.listen(f"tap{tap}", positions=[(first + tap, 1, 1.0)])
    network.part("hammer")
    hammer = network.mas("h", M=_HAMMER.m, X0=_HAMMER.x, V0=_HAMMER.v)
    network.but("b", hammer, first + _STRUCK, K=_HAMMER.k)
    return network


def _truth() -> Floats:
    eigenvalues, shapes = row(N)
    m = _M / N
    k, z = tuned(float(eigenvalues[0]), m, _F, _T60)
    points = shapes[[_STRUCK, *TAPS]] / math.sqrt(m)
    body = Body(k / m * eigenvalues, 0.5 * z / m * eigenvalues, points)
    return struck(body, _HAMMER, RATE, _FRAMES)[:, 1:]
