"""Fits of a key's parts, each judged on data to which it was not fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from . import output_error
from .parameters import INDEX, is_plain, is_stiffest

if TYPE_CHECKING:
    from collections.abc import Iterable

    from .gesture import Floats, Gesture
    from .output_error import Fit

FITTED_SHARE = 0.75  # share of the last take that is fitted if none is held out
_ITERATIONS, _TRIAL_ITERATIONS = 30, 12  # of a fit, and of a fit before it is compared
_ROUGH_ITERATIONS = 5  # iterations from each of several starts
_RELATIVE_DEVIATION_MAX = 0.5  # relative deviation above which a part is not significant
_BIC_FALL_MIN = 10.0  # fall of BIC: very strong evidence (Kass and Raftery 1995)
_BIC_FALL_CERTAIN = 100.0  # fall of BIC that residuals which are correlated do not explain either
_BESIDE = 10.0  # deviations of a delay from which a fit begins anew
_HIDDEN = 0.1  # of the relative fall of the error in the takes: so little a replay may rise


@dataclass(frozen=True, slots=True)
class Stage:
    """A part that was tried: its fit, the error on the held-out gesture, and whether it was kept.

    `replay` is the rms [m] of the difference from the held-out positions, their noise included.
    `is_worth` says that the part explains the takes well enough, whatever the held-out gesture
    says. For a mode that was not tried, `fit` is the fit before, and `score` says why.
    `is_removal` says that the part was removed on trial; `is_accepted` then that it stays removed.
    """

    name: str
    fit: Fit
    replay: float
    is_accepted: bool
    score: float | None = None
    is_removal: bool = False
    is_worth: bool = False

    def explains_more(self, other: Stage) -> bool:
        """Whether there is very strong evidence that it explains the takes better than another
        stage.
        """
        return self.fit.bic < other.fit.bic - _BIC_FALL_MIN

    def is_hidden(self, before: Stage) -> bool:
        """Whether the parts since a stage surely explain the takes, and the held-out gesture hardly
        speaks against them: its error rises by less than a tenth of what that of the takes falls.
        """
        is_sure = self.is_worth and self.fit.bic < before.fit.bic - _BIC_FALL_CERTAIN
        log_fall, log_rise = (
            np.log(before.fit.rms / self.fit.rms),
            np.log(self.replay / before.replay),
        )
        return bool(is_sure and log_rise < _HIDDEN * log_fall)


class Judge:
    """Fits stages, and compares each with the one before on data to which neither was fitted."""

    def __init__(self, gestures: list[Gesture], held_out: Gesture | None) -> None:
        """Without a held-out gesture the last quarter of the last gesture is held out."""
        gestures = [gesture.with_unknown_speed() for gesture in gestures]
        self.is_apart = held_out is not None
        if held_out is None:
            gestures[-1], held_out = gestures[-1].parted(FITTED_SHARE)
        self.gestures, self.held_out = gestures, held_out

    def recovered(self, stage_before: Stage | None) -> list[Gesture]:
        """The gestures, with the unknown forces found by the fit before."""
        return self.gestures if stage_before is None else stage_before.fit.recovered(self.gestures)

    def stage(
        self,
        name: str,
        row: Floats,
        columns: tuple[int, ...],
        stage_before: Stage | None,
        score: float | None = None,
        iterations: int = _TRIAL_ITERATIONS,
    ) -> Stage:
        """Fit these columns starting at a row, and judge the fit.

        A fit that is no better than the one before after some iterations is not fitted further.
        """
        starts = None if stage_before is None else stage_before.fit.starts
        trial = output_error.fit(
            self.recovered(stage_before), row, columns, starts, iterations, is_rough=True
        )
        is_better = stage_before is None or trial.bic < stage_before.fit.bic
        further_iterations = _ITERATIONS if is_better and iterations else 0
        fit = output_error.fit(
            trial.recovered(self.gestures), trial.row, columns, trial.starts, further_iterations
        )
        model_replay = self._replay(fit)
        is_worth = stage_before is None or (
            fit.bic < stage_before.fit.bic - _BIC_FALL_MIN
            and knows(fit, set(columns) - set(stage_before.fit.columns))
        )
        is_accepted = is_worth and (stage_before is None or model_replay < stage_before.replay)
        return Stage(name, fit, model_replay, is_accepted, score, is_worth=is_worth)

    def begun_beside(self, stage: Stage) -> Stage:
        """The stage, fitted anew from a shorter and a longer delay if that explains the takes
        better. Where dry friction holds and lets go tick by tick the cost has dents along the
        delay, in which a fit may end.
        """
        delay_index = INDEX["delay"]
        if delay_index not in stage.fit.columns:
            return stage
        delay_offset = min(_BESIDE * stage.fit.deviation(delay_index), 1e-3)
        best_stage = stage
        for delay_start in (
            stage.fit.row[delay_index] - delay_offset,
            stage.fit.row[delay_index] + delay_offset,
        ):
            row = with_values(stage.fit.row, {"delay": max(0.0, delay_start)})
            gestures, starts = stage.fit.recovered(self.gestures), stage.fit.starts
            fit = output_error.fit(gestures, row, stage.fit.columns, starts, _ITERATIONS)
            if fit.bic < best_stage.fit.bic:
                best_stage = replace(stage, fit=fit, replay=self._replay(fit))
        return best_stage

    def _replay(self, fit: Fit) -> float:
        """Rms of the difference from the held-out positions [m]."""
        if self.is_apart:
            return output_error.follow(fit.row, self.held_out).rms
        start_position = fit.starts[-1]
        held_out = self.held_out.with_forces(fit.forces[-1])
        held_out = output_error.recovered(fit.row, held_out, start_position)
        errors = output_error.errors(fit.row, held_out, start_position)
        return float(np.sqrt(np.mean(errors**2)))

    def without(self, name: str, parameters: tuple[str, ...], stage_before: Stage) -> Stage:
        """Remove a part and fit the rest; it stays removed if it would not be worth adding."""
        removed_indices = {INDEX[parameter] for parameter in parameters}
        columns = tuple(index for index in stage_before.fit.columns if index not in removed_indices)
        row = with_values(stage_before.fit.row, dict.fromkeys(parameters, 0.0))
        stage = self.stage(name, row, columns, stage_before)
        return replace(
            stage, is_accepted=stage.fit.bic < stage_before.fit.bic + _BIC_FALL_MIN, is_removal=True
        )

    def best_of(
        self,
        stage_name: str,
        trial_rows: list[Floats],
        fitted_columns: tuple[int, ...],
        stage_before: Stage,
        score: float | None = None,
    ) -> Stage:
        """Fit several rows roughly, then fit and judge the best one as `stage` does.

        The rough fits are to the first gesture. If the best is still worse there than the fit
        before, the stage ends with it.
        """
        first_gesture, starts = self.recovered(stage_before)[:1], stage_before.fit.starts[:1]
        fits = [
            output_error.fit(
                first_gesture, row, fitted_columns, starts, _ROUGH_ITERATIONS, is_rough=True
            )
            for row in trial_rows
        ]
        best_fit = min(fits, key=lambda fit: fit.rms)
        residual = output_error.errors(stage_before.fit.row, first_gesture[0], starts[0])
        if best_fit.rms**2 < np.mean(residual**2):
            return self.stage(stage_name, best_fit.row, fitted_columns, stage_before, score)
        stage = self.stage(
            stage_name, best_fit.row, fitted_columns, stage_before, score, iterations=0
        )
        return replace(stage, is_accepted=False, is_worth=False)


def with_values(parameter_row: Floats, values_by_name: dict[str, float]) -> Floats:
    """A row with other values of the parameters of these names."""
    parameter_row = parameter_row.copy()
    for name, value in values_by_name.items():
        parameter_row[INDEX[name]] = value
    return parameter_row


def knows(fit: Fit, columns: Iterable[int]) -> bool:
    """Whether a fit determines these of its parameters, if they cannot be zero."""
    return all(_is_known(fit, index) for index in columns if index in fit.columns)


def _is_known(fit: Fit, parameter_index: int) -> bool:
    """Whether a parameter that cannot be zero is known to within a half of its value."""
    if is_stiffest(fit.row, parameter_index):
        return False
    return (
        is_plain(parameter_index)
        or fit.deviation(parameter_index) < _RELATIVE_DEVIATION_MAX * fit.row[parameter_index]
    )
