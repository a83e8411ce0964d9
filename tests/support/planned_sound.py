"""Scores played by a plan, and how far their sound is from an exact one."""

from functools import lru_cache
from typing import Any

import numpy as np

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import Ready, prepare


def ready(text: str) -> Ready:
    loaded = load("scene.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return prepare(loaded.piece)


def _plan(text: str, **wishes: Any) -> tuple[Ready, _core.Plan]:
    stage = ready(text)
    return stage, _core.Plan(stage.network, stage.timeline, **wishes)


planned = lru_cache(64)(_plan)  # several tests of a file ask for the same plan


def played(text: str, **wishes: Any) -> np.ndarray:
    """What a score's plan gives, before the mix (n_frames, n_out)."""
    # Choices that are pinned are lists, and asked for once.
    stage, plan = (_plan if "pins" in wishes else planned)(text, **wishes)
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((stage.n_frames, simulation.n_out))
    simulation.process(sound)
    return sound


def off_db(sound: np.ndarray, exact: np.ndarray) -> float:
    """The largest error of any output over its largest value [dB]."""
    sizes = np.abs(exact).max(axis=0)
    return float(20.0 * np.log10((np.abs(sound - exact).max(axis=0) / sizes).max() + 1e-30))
