"""A key alone in the core, and how far it is from its path."""

from typing import Any

import numpy as np

from ergon import _core
from oracle.core import play

RATE = 44100.0
SMOOTH = ["smooth"] * 8
KEYS = {
    "placeholder": {"M": 0.4, "K": 60.0, "Z": 1.2},
    "light": {"M": 0.08, "f": 8.0, "t60": 0.6},
    "stiff": {"M": 0.2, "K": 9000.0, "Z": 0.3},
    "overdamped": {"M": 0.1, "K": 20.0, "Z": 8.0},
}


def lone(rate: float = RATE, **parameters: float) -> tuple[Any, Any, int]:
    """A key alone, with its position as the only output: (network, timeline, key)."""
    network = _core.Network()
    network.part("k1")
    kind = network.cel if len(parameters) > 1 else network.mas
    struck = kind("m", **parameters)
    network.listen("x", positions=[(struck, 1, 1.0)])
    timeline = _core.Timeline(network, rate)
    return network, timeline, timeline.key("k1", struck)


def moved(network: Any, timeline: Any, seconds: float, **options: Any) -> tuple[np.ndarray, Any]:
    """Positions of the key at every frame, and the simulation after them."""
    sim = _core.Simulation(network, timeline, **options)
    return play(sim, round(seconds * sim.rate))[:, 0], sim


def grid(n: int, rate: float = RATE) -> np.ndarray:
    return np.arange(n) / rate


def worst(done: np.ndarray, asked: np.ndarray) -> float:
    """Largest distance where the path is defined [m]."""
    inside = ~np.isnan(asked)
    assert inside.sum() > 100
    return float(np.abs(done - asked)[inside].max())
