"""Maps of where a method fails: what is predicted, what happens, and whether it is also right."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ergon import _core
from ergon.lab import runs
from ergon.lab.energy import production_db
from ergon.lab.metrics import Floats, early_db, spectral
from ergon.lab.runs import Setting
from ergon.lab.scene import Scene
from ergon.lab.truth import Truth
from ergon.scores.staging.stage import StageError

ACCURATE_DB = -20.0  # a tenth of the motion, over the first 0.1 s of sound
_SURE_DB = -6.0  # by so much the truth must be surer than what it judges
_RUNAWAY_DB = 10.0  # ten times the energy that went in, made by the scheme alone
Progress = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Case:
    """A scene of a map, how finely it is computed, and what it really does (outputs)."""

    scene: Scene
    oversampling: int
    truth: Callable[[int], Truth]


@dataclass(frozen=True, slots=True)
class Map:
    """A grid over two parameters.

    `load` is λ over the limit by a formula: 1 is the predicted border; None where there is none.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    seconds: float
    case: Callable[[float, float], Case]
    load: Callable[[float, float], float] | None = None
    log_x: bool = True
    log_y: bool = True

    @property
    def n_spots(self) -> int:
        """How many runs it takes."""
        return len(self.xs) * len(self.ys)


@dataclass(frozen=True, slots=True)
class Spot:
    """One cell of a map. None is what is not known.

    `theory` and `certified` are predictions (by a formula; by the engine before it runs), `stable`
    is what happened, `accurate` whether it is near the truth as well.
    """

    x: float
    y: float
    theory: bool | None
    certified: bool | None
    stable: bool | None
    accurate: bool | None = None
    load: float | None = None
    error_db: float | None = None
    spectral_db: float | None = None
    truth_db: float | None = None
    reason: str = ""


def survey(found: Map, method: str, accurate_db: float, progress: Progress) -> list[Spot]:
    """Every spot of a map, row by row; `progress` hears how many are done."""
    spots = []
    for y in found.ys:
        for x in found.xs:
            spots.append(look(found, x, y, method, accurate_db))
            progress(len(spots))
    return spots


def survey_all(
    maps: Mapping[str, Map], method: str, accurate_db: float, progress: Progress
) -> dict[str, tuple[Map, list[Spot]]]:
    """Several maps, with one progress for all of them."""
    found: dict[str, tuple[Map, list[Spot]]] = {}
    before = 0
    for name, one in maps.items():
        spots = survey(one, method, accurate_db, partial(_shifted, progress, before))
        found[name] = one, spots
        before += len(spots)
    return found


def _shifted(progress: Progress, shift: int, done: int) -> None:
    progress(shift + done)


def look(found: Map, x: float, y: float, method: str, accurate_db: float) -> Spot:
    """Predict, run, and compare one spot."""
    load = None if found.load is None else found.load(x, y)
    theory = None if load is None else load < 1.0
    try:
        case = found.case(x, y)
        setting = Setting(method, case.oversampling)
        certified, said = _certified(case, setting)
        n_frames = max(2, round(found.seconds * case.scene.rate))
        stable, frames, reason = _run(case.scene, setting, n_frames)
    except (StageError, _core.EngineError) as error:
        return Spot(x, y, theory, None, None, load=load, reason=str(error).splitlines()[0])
    spot = Spot(x, y, theory, certified, stable, load=load, reason=reason or said)
    if not stable or frames is None:
        return spot
    return _judged(spot, case, frames, n_frames, accurate_db)


def _certified(case: Case, setting: Setting) -> tuple[bool, str]:
    """Whether the engine would let it run, and what it says where it would not."""
    try:
        if setting.method == "ca":
            rate = case.scene.rate * setting.oversampling
            case.scene.at(rate).network.certify(rate)
        else:
            runs.start(case.scene, setting)
    except _core.UnstableError as error:
        return False, str(error)
    return True, ""


def _run(scene: Scene, setting: Setting, n_frames: int) -> tuple[bool | None, Floats | None, str]:
    """(whether it stayed finite, its outputs, why not); None where the engine would not run it."""
    ledger = setting.method == "ca"
    try:
        run = runs.start(scene, setting, ledger=ledger, unchecked=True)
    except _core.UnstableError as error:
        return None, None, str(error)
    try:
        frames = run.frames(n_frames)
    except _core.DivergedError as error:
        return False, None, str(error)
    if not np.all(np.isfinite(frames)):
        return False, None, "an output is not finite"
    made = production_db(run.energy()) if ledger else -np.inf
    if made > _RUNAWAY_DB:
        return False, frames, f"the scheme made {10 ** (made / 10):.3g} times the energy given"
    return True, frames, ""


def _judged(spot: Spot, case: Case, frames: Floats, n_frames: int, accurate_db: float) -> Spot:
    truth = case.truth(n_frames)
    if truth.frames is None:
        reason = "accuracy is not known: no finer run went through"
        return replace(spot, reason=reason)
    hear = case.scene.hear
    y, x = hear(frames), hear(truth.frames)
    error = early_db(y, x, case.scene.rate)
    sure = truth.change_db < max(error, accurate_db) + _SURE_DB
    accurate = error <= accurate_db if sure else None
    if not x.any():
        accurate, reason = None, "accuracy is not known: nothing sounds"
    else:
        reason = "" if sure else "accuracy is not known: finer runs differ as much"
    return replace(
        spot,
        accurate=accurate,
        error_db=error,
        spectral_db=spectral(y, x).difference,
        truth_db=truth.change_db,
        reason=reason or spot.reason,
    )


def disagreements(spots: Sequence[Spot]) -> tuple[int, int]:
    """How many spots ran away though certified, and stayed though refused."""
    missed = sum(1 for s in spots if s.certified is True and s.stable is False)
    strict = sum(1 for s in spots if s.certified is False and s.stable is True)
    return missed, strict
