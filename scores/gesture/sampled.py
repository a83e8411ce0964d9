"""A gesture as positions at even times: those of a hand that follows it exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ergon._core import DivergedError, EngineError, Network, Simulation, Timeline
from ergon.notation.text.errors import TextError
from ergon.scores.gesture.take_file import MAX_SAMPLES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ergon.notation.text.values import Point


def sampled_positions(
    gesture_points: Sequence[Point], beat_duration: float, rate: float
) -> NDArray[np.float64]:
    """Positions (n,) [m], `rate` a second, of points in beats of `beat_duration` [s]; from 0 to the
    last.

    The engine plays the path with a key of its own, so that a `throw` here flies like a free
    mass. Raises TextError at the point that the engine refuses, or that no mass reaches.
    """
    instants = [point.at.beats * beat_duration + point.at.seconds for point in gesture_points]
    network = Network()
    hand_mass = network.mas("hand", M=1.0, X0=gesture_points[0].x)
    timeline = Timeline(network, rate)
    hand_key = timeline.key("hand", hand_mass)
    curves = [point.curve for point in gesture_points]
    positions = [point.x for point in gesture_points]
    if instants[-1] * rate >= MAX_SAMPLES:
        message = f"this gesture has more than {MAX_SAMPLES:,} samples at {rate:g} Hz"
        raise _point_error(gesture_points, len(gesture_points) - 1, message)
    try:
        timeline.gesture(hand_key, instants, positions, curves, touch="tracked")  # type: ignore[arg-type]
        simulation = Simulation(network, timeline)
    except EngineError as error:
        raise _point_error(gesture_points, error.index or 0, error.sentence) from None
    n_samples = int(instants[-1] * rate + 0.5) + 1
    samples = np.empty(n_samples)
    no_samples = np.empty((1, 0))
    for i in range(n_samples):
        samples[i] = simulation.positions()[hand_mass]
        try:
            simulation.process(no_samples)
        except DivergedError:
            point_index = next(
                (k for k, instant in enumerate(instants) if instant * rate >= i + 1),
                len(instants) - 1,
            )
            message = "the path to this point, or on from it, is too fast for any mass"
            raise _point_error(gesture_points, point_index, message) from None
    return samples


def _point_error(points: Sequence[Point], index: int, message: str) -> TextError:
    point = points[min(index, len(points) - 1)]
    return TextError(message, offset=point.offset, length=point.length, code="E308")
