"""The converged motion of a scene: a run so oversampled that a finer run gives the same."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from ergon import _core
from ergon.scores.staging.refusals import StageError
from ergon.workshop.lab import runs
from ergon.workshop.lab.metrics import Floats, early_db
from ergon.workshop.lab.runs import Setting
from ergon.workshop.lab.scene import Scene, UndifferentiatedScene

_REFINEMENT = 16  # times what is just stable
_OVERSAMPLING_MAX = 1024  # times the scene's own rate
EXACT_DB = -300.0  # error of a formula


@dataclass(frozen=True, slots=True)
class Truth:
    """Outputs (n_frames, n_out) at the scene's rate, and their change from half the oversampling.

    `change_db` is inf if nothing could be run: then the truth is not known.
    """

    frames: Floats | None
    change_db: float


UNKNOWN = Truth(None, inf)


@dataclass(frozen=True, slots=True)
class Motion:
    """Positions of all outputs (n_frames, n_out) at `rate`, by a run and one with half its steps.

    `network` says which outputs are speeds and accelerations.
    """

    fine: Floats
    coarse: Floats
    network: _core.Network
    rate: float

    def sampled(self, rate: float, n_frames: int) -> Truth:
        """The outputs at a rate that divides that of the motion.

        Speeds and accelerations derive from positions at that rate, as in every run that is judged
        there: a derivative is late by 7.5 or 8 frames of the rate from whose frames it derives.
        """
        stride = round(self.rate / rate)
        fine, coarse = (
            np.ascontiguousarray(positions[::stride][:n_frames])
            for positions in (self.fine, self.coarse)
        )
        for frames in (fine, coarse):
            _core.Derivatives(self.network, rate).process(frames)
        return Truth(fine, early_db(coarse, fine, rate))


def converged(scene: Scene, n_frames: int, refinement: int = _REFINEMENT) -> Truth:
    """The scene by the CA scheme, `refinement` times as oversampled as it needs to run at all."""
    run = motion(scene, n_frames, refinement)
    return UNKNOWN if run is None else run.sampled(scene.rate, n_frames)


def motion(scene: Scene, n_frames: int, refinement: int = _REFINEMENT) -> Motion | None:
    """The same as positions, to be sampled at any rate that divides the scene's; None if nothing
    could be run.
    """
    oversampling = 1
    while oversampling < _OVERSAMPLING_MAX and not _stable(scene, oversampling):
        oversampling *= 2
    fine_oversampling = min(_OVERSAMPLING_MAX, oversampling * refinement)
    coarse, fine = (
        _positions(scene, fine_oversampling // 2, n_frames),
        _positions(scene, fine_oversampling, n_frames),
    )
    if coarse is None or fine is None:
        return None
    return Motion(fine, coarse, scene.build_at(scene.rate).network, scene.rate)


def _stable(scene: Scene, oversampling: int) -> bool:
    rate = scene.rate * oversampling
    try:
        scene.build_at(rate).network.certify(rate)
    except _core.UnstableError:
        return False
    return True


def _positions(scene: Scene, oversampling: int, n_frames: int) -> Floats | None:
    try:
        run = runs.start(UndifferentiatedScene(scene), Setting("ca", oversampling))
        return run.frames(n_frames)
    except (_core.EngineError, StageError):
        return None
