"""A part by its modes: what is struck, what is heard, and the resonators between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

UNITS = ("m", "m/s", "m/s^2")  # of an output, by how often it is differentiated


@dataclass(frozen=True, slots=True)
class Way:
    """From a point that is struck to an output: so many modes, each with four numbers.

    `rows` hold the damped frequency [Hz], the decay [1/s], and of an impulse of 1 N·s the amplitude
    [m] and phase [rad].
    """

    struck: int
    heard: int
    rows: Sequence[tuple[float, float, float, float]]


@dataclass(frozen=True, slots=True)
class Bank:
    """A part by its modes: points that are struck, outputs, and ways between them.

    Each output is differentiated so many times. `strikes` are those of each point: instant [s] and
    impulse [N·s]. `full` is the size of each output that is full scale.
    """

    name: str
    rate: float
    seconds: float
    struck: Sequence[str]
    strikes: Sequence[Sequence[tuple[float, float]]]
    heard: Sequence[tuple[str, int]]
    full: Sequence[float]
    ways: Sequence[Way]
