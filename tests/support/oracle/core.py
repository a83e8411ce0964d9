"""The same scene in the core: one function renders, one compares."""

from typing import Any

import numpy as np

from ergon import _core
from oracle.engine import simulate
from oracle.scene import Scene


def simulation(scene: Scene, rate: float, **options: Any) -> Any:
    """A fresh `_core.Simulation` of the scene."""
    return _core.Simulation(*scene.build(_core, rate), **options)


def play(sim: Any, n_frames: int, block: int = 0) -> np.ndarray:
    """The next frames (n_frames, n_out), in blocks (0: all at once)."""
    out = np.empty((n_frames, sim.n_out))
    block = block or max(n_frames, 1)
    for i in range(0, n_frames, block):
        sim.process(out[i : i + block])
    return out


def render(scene: Scene, rate: float, n_frames: int, **options: Any) -> np.ndarray:
    """All at once from frame 0."""
    return play(simulation(scene, rate, **options), n_frames)


def deviation(scene: Scene, rate: float, n_frames: int) -> float:
    """Largest |core - oracle| of any output over that output's largest value."""
    ours, theirs = render(scene, rate, n_frames), simulate(scene, rate, n_frames).out
    size = np.abs(theirs).max(axis=0)
    assert (size > 0.0).all(), "an output of the scene is silent: it compares nothing"
    assert np.isfinite(ours).all()
    return float((np.abs(ours - theirs).max(axis=0) / size).max())
