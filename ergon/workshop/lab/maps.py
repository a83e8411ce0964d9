"""Stability maps of a method: the predicted border, where runs diverge, where they are accurate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Protocol

from ergon import _core
from ergon.scores.staging.refusals import StageError
from ergon.workshop.lab.map_point import MapPoint
from ergon.workshop.lab.metrics import EARLY_DURATION, Floats, early_db, spectral_difference
from ergon.workshop.lab.names import MapMetric

# Rows of (largest y, largest error that counts as right [dB]). -20 dB is a tenth of the motion, or
# a hundredth of the energy.
DEFAULT_ERROR_LIMITS = ((inf, -20.0),)
_CERTAINTY_MARGIN_DB = -6.0  # margin by which the reference must be more exact
Progress = Callable[[int], None]
ErrorLimits = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Map:
    """A grid over two parameters.

    `load` is λ over the limit by a formula: 1 is the predicted border; None if there is no formula.
    The error is that of the first `judged_duration` seconds of sound. `as_written` is the spot of
    the unchanged score. By the metric `energy` a spot is right if its spurious energy stays below
    `error_limit_db`.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    seconds: float
    make_point: Callable[[float, float], MapPoint]
    load: Callable[[float, float], float] | None = None
    log_x: bool = True
    log_y: bool = True
    error_limits: ErrorLimits = DEFAULT_ERROR_LIMITS
    judged_duration: float = EARLY_DURATION
    as_written: tuple[float, float] | None = None
    metric: MapMetric = "waveform"

    @property
    def n_spots(self) -> int:
        """The number of runs."""
        return len(self.xs) * len(self.ys)

    def error_limit_db(self, y: float) -> float:
        """The error that still counts as right [dB]."""
        return next(db for upto, db in self.error_limits if y <= upto)


@dataclass(frozen=True, slots=True)
class Spot:
    """One cell of a map. None means not known.

    `theory` and `certified` are predictions (by a formula; by the engine before it runs),
    `stable` is the outcome, and `accurate` says whether the outcome is also near the truth.
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
    energy_db: float | None = None
    reason: str = ""


class Surveyors(Protocol):
    """Surveys columns of maps elsewhere."""

    def columns(
        self, wanted_columns: Sequence[tuple[str, float]]
    ) -> Iterator[tuple[str, list[Spot]]]:
        """The spots of columns, each the name of a map and an x, in any order."""


def survey(surveyed_map: Map, progress: Progress) -> list[Spot]:
    """Every spot of a map, row by row; `progress` hears how many are done."""
    spots = []
    for y in surveyed_map.ys:
        for x in surveyed_map.xs:
            spots.append(compute_spot(surveyed_map, x, y))
            progress(len(spots))
    return spots


def survey_all(
    maps: Mapping[str, Map], progress: Progress, surveyors: Surveyors | None = None
) -> dict[str, tuple[Map, list[Spot]]]:
    """Survey several maps with a common progress, by `surveyors` if they are given."""
    if surveyors is not None:
        return _survey_columns(surveyors, maps, progress)
    surveys: dict[str, tuple[Map, list[Spot]]] = {}
    n_surveyed = 0
    for name, surveyed_map in maps.items():
        spots = survey(surveyed_map, partial(_report_from, progress, n_surveyed))
        surveys[name] = surveyed_map, spots
        n_surveyed += len(spots)
    return surveys


def _survey_columns(
    surveyors: Surveyors, maps: Mapping[str, Map], progress: Progress
) -> dict[str, tuple[Map, list[Spot]]]:
    """Survey maps column by column: the spots of a column share their truth, so one process
    computes a column.
    """
    wanted_columns = [(name, x) for name, surveyed_map in maps.items() for x in surveyed_map.xs]
    spots: dict[tuple[str, float, float], Spot] = {}
    for name, column in surveyors.columns(wanted_columns):
        spots |= {(name, spot.x, spot.y): spot for spot in column}
        progress(len(spots))
    return {
        name: (surveyed_map, [spots[name, x, y] for y in surveyed_map.ys for x in surveyed_map.xs])
        for name, surveyed_map in maps.items()
    }


def _report_from(progress: Progress, shift: int, n_surveyed: int) -> None:
    progress(shift + n_surveyed)


def compute_spot(surveyed_map: Map, x: float, y: float) -> Spot:
    """Predict, run, and compare one spot."""
    spot, map_point, frames = predicted_and_run(surveyed_map, x, y)
    return (
        spot
        if map_point is None or frames is None
        else _with_accuracy(surveyed_map, spot, map_point, frames)
    )


def predicted_and_run(
    surveyed_map: Map, x: float, y: float
) -> tuple[Spot, MapPoint | None, Floats | None]:
    """Predict and run one spot; its case and frames are returned if it ran and was stable."""
    load = None if surveyed_map.load is None else surveyed_map.load(x, y)
    theory = None if load is None else load < 1.0
    try:
        map_point = surveyed_map.make_point(x, y)
        refusal = map_point.refusal()
        n_frames = max(2, round(surveyed_map.seconds * map_point.scene.rate))
        outcome = map_point.run(n_frames)
    except (StageError, _core.EngineError) as error:
        reason = str(error).splitlines()[0]
        return Spot(x, y, theory, None, None, load=load, reason=reason), None, None
    spot = Spot(
        x,
        y,
        theory,
        not refusal,
        outcome.is_stable,
        load=load,
        energy_db=outcome.energy_db,
        reason=outcome.reason or refusal,
    )
    return spot, map_point, outcome.frames if outcome.is_stable else None


def _with_accuracy(surveyed_map: Map, spot: Spot, map_point: MapPoint, frames: Floats) -> Spot:
    limit_db = surveyed_map.error_limit_db(spot.y)
    if surveyed_map.metric == "energy":
        produced = spot.energy_db
        return replace(spot, accurate=None if produced is None else produced <= limit_db)
    truth = map_point.truth(len(frames))
    if truth.frames is None:
        unknown_reason = "accuracy is not known: no finer run went through"
        return replace(spot, reason=unknown_reason)
    to_sound = map_point.scene.to_sound
    sound, true_sound = to_sound(frames), to_sound(truth.frames)
    error = early_db(sound, true_sound, map_point.scene.rate, surveyed_map.judged_duration)
    is_certain = truth.change_db < max(error, limit_db) + _CERTAINTY_MARGIN_DB
    accurate = error <= limit_db if is_certain else None
    if not true_sound.any():
        accurate, unknown_reason = None, "accuracy is not known: nothing sounds"
    else:
        unknown_reason = "" if is_certain else "accuracy is not known: finer runs differ as much"
    return replace(
        spot,
        accurate=accurate,
        error_db=error,
        spectral_db=spectral_difference(sound, true_sound).difference,
        reason=unknown_reason or spot.reason,
    )


def disagreements(spots: Sequence[Spot]) -> tuple[int, int]:
    """Number of spots that diverged though certified, and of spots that stayed stable though
    refused.
    """
    n_missed = sum(1 for s in spots if s.certified is True and s.stable is False)
    n_strict = sum(1 for s in spots if s.certified is False and s.stable is True)
    return n_missed, n_strict
