"""The converged motion of a scene: a run so oversampled that a finer run gives the same."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from ergon import _core
from ergon.scores.staging.refusals import StageError
from ergon.workshop.lab import runs
from ergon.workshop.lab.metrics import Floats, early_db
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Scene

_FINER = 16  # times what is just stable
_HIGHEST = 1024  # times the scene's own rate
EXACT_DB = -300.0  # what a formula does not know


@dataclass(frozen=True, slots=True)
class Truth:
    """Outputs (n_frames, n_out) at the scene's rate, and their change from half the oversampling.

    `change_db` is inf if nothing could be run: then the truth is not known.
    """

    frames: Floats | None
    change_db: float


UNKNOWN = Truth(None, inf)


def converged(scene: Scene, n_frames: int, finer: int = _FINER) -> Truth:
    """The scene by the CA scheme, `finer` times as oversampled as it needs to run at all."""
    oversampling = 1
    while oversampling < _HIGHEST and not _stable(scene, oversampling):
        oversampling *= 2
    top = min(_HIGHEST, oversampling * finer)
    rough, fine = _frames(scene, top // 2, n_frames), _frames(scene, top, n_frames)
    if rough is None or fine is None:
        return UNKNOWN
    return Truth(fine, early_db(rough, fine, scene.rate))


def _stable(scene: Scene, oversampling: int) -> bool:
    rate = scene.rate * oversampling
    try:
        scene.at(rate).network.certify(rate)
    except _core.UnstableError:
        return False
    return True


def _frames(scene: Scene, oversampling: int, n_frames: int) -> Floats | None:
    try:
        return runs.start(scene, Setting("ca", oversampling)).frames(n_frames)
    except (_core.EngineError, StageError):
        return None
