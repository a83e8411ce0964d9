"""A gesture as positions at even times: what a hand that goes it does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon._core import Network, Simulation, Timeline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ergon.notation.text.values import Point


def sampled(points: Sequence[Point], beat: float, rate: float) -> NDArray[np.float64]:
    """Positions (n,) [m], `rate` a second, of points in beats of `beat` [s]; from 0 to the last.

    The engine goes the path with a key of its own, so a `throw` here flies as a free mass does.
    """
    t = [point.at.beats * beat + point.at.seconds for point in points]
    network = Network()
    mass = network.mas("hand", M=1.0, X0=points[0].x)
    timeline = Timeline(network, rate)
    key = timeline.key("hand", mass)
    curves = [point.curve for point in points]
    x = [point.x for point in points]
    timeline.gesture(key, t, x, curves, touch="tracked")  # type: ignore[arg-type]
    simulation = Simulation(network, timeline)
    n = int(t[-1] * rate + 0.5) + 1
    path = np.empty(n)
    nothing = np.empty((1, 0))
    for i in range(n):
        path[i] = simulation.positions()[mass]
        simulation.process(nothing)
    return path
