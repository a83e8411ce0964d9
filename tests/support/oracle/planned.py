"""Scenes computed by a plan, and the difference of two sounds."""

from typing import Any

import numpy as np

from ergon import _core
from oracle.core import play
from oracle.scene import Scene


def plan(scene: Scene, rate: float, **wishes: Any) -> Any:
    """A fresh `_core.Plan` of the scene."""
    return _core.Plan(*scene.build(_core, rate), **wishes)


def simulation(scene: Scene, rate: float, *, threads: int = 1, **wishes: Any) -> Any:
    """A fresh simulation of the scene by a plan."""
    network, timeline = scene.build(_core, rate)
    result = _core.Plan(network, timeline, **wishes)
    return _core.Simulation(network, timeline, plan=result, threads=threads)


def render(scene: Scene, rate: float, n_frames: int, **wishes: Any) -> np.ndarray:
    """All at once from frame 0."""
    return play(simulation(scene, rate, **wishes), n_frames)


def how(scene: Scene, rate: float, **wishes: Any) -> list[tuple[str, str]]:
    """Parts of each row and how they are computed."""
    return [(" + ".join(row.parts), row.what) for row in plan(scene, rate, **wishes).rows()]


def error_db(y: np.ndarray, x: np.ndarray) -> float:
    """20·log10 of ‖y - x‖/‖x‖, of the worst output; x is the reference, with its mean removed."""
    sounds = np.linalg.norm(x - x.mean(axis=0), axis=0)
    assert (sounds > 0.0).all(), "an output of the scene is silent: it compares nothing"
    worst = float((np.linalg.norm(y - x, axis=0) / sounds).max())
    return 20.0 * float(np.log10(max(worst, 1e-20)))
