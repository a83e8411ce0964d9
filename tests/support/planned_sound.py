"""Scores computed by a plan, and their difference from an exact sound."""

from functools import lru_cache
from typing import Any

import numpy as np

from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.staging.preparing import PreparedPiece, prepare


def ready(text: str) -> PreparedPiece:
    loaded = load("scene.yaml", text=text)
    assert loaded.piece is not None, loaded.diagnostics
    return prepare(loaded.piece)


def _plan(text: str, **wishes: Any) -> tuple[PreparedPiece, _core.Plan]:
    stage = ready(text)
    return stage, _core.Plan(stage.network, stage.timeline, **wishes)


planned = lru_cache(64)(_plan)  # several tests of a file ask for the same plan


def played(text: str, **wishes: Any) -> np.ndarray:
    """The outputs of a score's plan, before the mix (n_frames, n_out)."""
    # Pinned choices are lists, which the cache cannot hash; no test plans them twice.
    stage, plan = (_plan if "pins" in wishes else planned)(text, **wishes)
    simulation = _core.Simulation(stage.network, stage.timeline, plan=plan, threads=1)
    sound = np.empty((stage.n_frames, simulation.n_out))
    simulation.process(sound)
    return sound


def off_db(sound: np.ndarray, exact: np.ndarray) -> float:
    """The largest error of any output over its largest value [dB]."""
    sizes = np.abs(exact).max(axis=0)
    return float(20.0 * np.log10((np.abs(sound - exact).max(axis=0) / sizes).max() + 1e-30))
