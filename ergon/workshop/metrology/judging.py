"""Fits of a key's parts, each judged on data to which it was not fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from . import output_error
from .parameters import INDEX, is_linear, is_rigid

if TYPE_CHECKING:
    from collections.abc import Iterable

    from .gesture import Floats, Gesture
    from .output_error import Fit

FITTED_SHARE = 0.75  # share of the last take that is fitted if none is held out
_FIT_ITERATIONS, _TRIAL_ITERATIONS = 30, 12  # of a fit, and of a fit before it is compared
_ROUGH_ITERATIONS = 5  # iterations from each of several starts
_RELATIVE_DEVIATION_MAX = 0.5  # relative deviation above which a part is not significant
_BIC_FALL_MIN = 10.0  # fall of BIC: very strong evidence (Kass and Raftery 1995)
_BIC_FALL_CERTAIN = 100.0  # fall of BIC that residuals which are correlated do not explain either
_DELAY_OFFSET_DEVIATIONS = 10.0  # deviations of a delay from which a fit begins anew
# Largest rise of the replay error, as a part of the fall of the error in the takes (logarithms).
_REPLAY_RISE_RATIO_MAX = 0.1


@dataclass(frozen=True, slots=True)
class Stage:
    """A part that was tried: its fit, the error on the held-out gesture, and whether it was kept.

    `replay_rms` is the rms [m] of the difference from the held-out positions, their noise included.
    `is_significant` says that the part explains the takes well enough, whatever the held-out
    gesture says. For a mode that was not tried, `fit` is the fit before, and `score` says why.
    `is_removal` says that the part was removed on trial; `is_accepted` then that it stays removed.
    """

    name: str
    fit: Fit
    replay_rms: float
    is_accepted: bool
    score: float | None = None
    is_removal: bool = False
    is_significant: bool = False

    def explains_more(self, other_stage: Stage) -> bool:
        """Whether there is very strong evidence that it explains the takes better than another
        stage.
        """
        return self.fit.bic < other_stage.fit.bic - _BIC_FALL_MIN

    def is_sure_despite_replay(self, earlier_stage: Stage) -> bool:
        """Whether the parts since a stage surely explain the takes, and the held-out gesture hardly
        speaks against them: its error rises by less than a tenth of what that of the takes falls.
        """
        is_sure = self.is_significant and self.fit.bic < earlier_stage.fit.bic - _BIC_FALL_CERTAIN
        takes_log_fall, replay_log_rise = (
            np.log(earlier_stage.fit.rms / self.fit.rms),
            np.log(self.replay_rms / earlier_stage.replay_rms),
        )
        return bool(is_sure and replay_log_rise < _REPLAY_RISE_RATIO_MAX * takes_log_fall)


class StageJudge:
    """Fits stages, and compares each with the one before on data to which neither was fitted."""

    def __init__(self, gestures: list[Gesture], held_out: Gesture | None) -> None:
        """Without a held-out gesture the last quarter of the last gesture is held out."""
        gestures = [gesture.with_unknown_speed() for gesture in gestures]
        self.has_held_out_take = held_out is not None
        if held_out is None:
            gestures[-1], held_out = gestures[-1].split(FITTED_SHARE)
        self.gestures, self.held_out = gestures, held_out

    def with_recovered_forces(self, previous: Stage | None) -> list[Gesture]:
        """The gestures, with the unknown forces that the previous fit found."""
        return (
            self.gestures if previous is None else previous.fit.with_recovered_forces(self.gestures)
        )

    def fit_stage(
        self,
        name: str,
        parameters: Floats,
        fitted_indices: tuple[int, ...],
        previous: Stage | None,
        score: float | None = None,
        iterations: int = _TRIAL_ITERATIONS,
    ) -> Stage:
        """Fit the parameters `fitted_indices`, starting from `parameters`, and judge the fit.

        A fit that is no better than the one before after some iterations is not fitted further.
        """
        starts = None if previous is None else previous.fit.start_positions
        trial = output_error.fit(
            self.with_recovered_forces(previous),
            parameters,
            fitted_indices,
            starts,
            iterations,
            is_rough=True,
        )
        is_better = previous is None or trial.bic < previous.fit.bic
        further_iterations = _FIT_ITERATIONS if is_better and iterations else 0
        fit = output_error.fit(
            trial.with_recovered_forces(self.gestures),
            trial.parameters,
            fitted_indices,
            trial.start_positions,
            further_iterations,
        )
        replay_rms = self._replay_rms(fit)
        is_worth_adding = previous is None or (
            fit.bic < previous.fit.bic - _BIC_FALL_MIN
            and are_determined(fit, set(fitted_indices) - set(previous.fit.fitted_indices))
        )
        is_accepted = is_worth_adding and (previous is None or replay_rms < previous.replay_rms)
        return Stage(name, fit, replay_rms, is_accepted, score, is_significant=is_worth_adding)

    def refit_from_other_delays(self, stage: Stage) -> Stage:
        """The stage, fitted anew from a shorter and a longer delay if that explains the takes
        better. Where dry friction holds and lets go tick by tick the cost has dents along the
        delay, in which a fit may end.
        """
        delay_index = INDEX["delay"]
        if delay_index not in stage.fit.fitted_indices:
            return stage
        delay_offset = min(_DELAY_OFFSET_DEVIATIONS * stage.fit.deviation(delay_index), 1e-3)
        best_stage = stage
        for delay_start in (
            stage.fit.parameters[delay_index] - delay_offset,
            stage.fit.parameters[delay_index] + delay_offset,
        ):
            start_parameters = with_values(stage.fit.parameters, {"delay": max(0.0, delay_start)})
            gestures, starts = (
                stage.fit.with_recovered_forces(self.gestures),
                stage.fit.start_positions,
            )
            fit = output_error.fit(
                gestures, start_parameters, stage.fit.fitted_indices, starts, _FIT_ITERATIONS
            )
            if fit.bic < best_stage.fit.bic:
                best_stage = replace(stage, fit=fit, replay_rms=self._replay_rms(fit))
        return best_stage

    def _replay_rms(self, fit: Fit) -> float:
        """Rms of the difference from the held-out positions [m]."""
        if self.has_held_out_take:
            return output_error.follow(fit.parameters, self.held_out).rms
        start_position = fit.start_positions[-1]
        held_out = self.held_out.with_forces(fit.forces[-1])
        held_out = output_error.recover_forces(fit.parameters, held_out, start_position)
        errors = output_error.residuals(fit.parameters, held_out, start_position)
        return float(np.sqrt(np.mean(errors**2)))

    def fit_without(self, name: str, parameters: tuple[str, ...], previous: Stage) -> Stage:
        """Remove a part and fit the rest; it stays removed if it would not be worth adding."""
        removed_indices = {INDEX[parameter] for parameter in parameters}
        fitted_indices = tuple(
            index for index in previous.fit.fitted_indices if index not in removed_indices
        )
        start_parameters = with_values(previous.fit.parameters, dict.fromkeys(parameters, 0.0))
        stage = self.fit_stage(name, start_parameters, fitted_indices, previous)
        return replace(
            stage, is_accepted=stage.fit.bic < previous.fit.bic + _BIC_FALL_MIN, is_removal=True
        )

    def fit_best_start(
        self,
        name: str,
        start_rows: list[Floats],
        fitted_indices: tuple[int, ...],
        previous: Stage,
        score: float | None = None,
    ) -> Stage:
        """Fit from several starts roughly, then fit and judge the best one as `fit_stage` does.

        The rough fits are to the first gesture. If the best is still worse there than the fit
        before, it is fitted no further, and the stage is not accepted.

        """
        first_gesture, starts = (
            self.with_recovered_forces(previous)[:1],
            previous.fit.start_positions[:1],
        )
        fits = [
            output_error.fit(
                first_gesture, start_row, fitted_indices, starts, _ROUGH_ITERATIONS, is_rough=True
            )
            for start_row in start_rows
        ]
        best_fit = min(fits, key=lambda fit: fit.rms)
        residual = output_error.residuals(previous.fit.parameters, first_gesture[0], starts[0])
        if best_fit.rms**2 < np.mean(residual**2):
            return self.fit_stage(name, best_fit.parameters, fitted_indices, previous, score)
        stage = self.fit_stage(
            name, best_fit.parameters, fitted_indices, previous, score, iterations=0
        )
        return replace(stage, is_accepted=False, is_significant=False)


def with_values(parameters: Floats, values_by_name: dict[str, float]) -> Floats:
    """A copy of `parameters` with other values of the parameters of these names."""

    parameters = parameters.copy()
    for name, parameter_value in values_by_name.items():
        parameters[INDEX[name]] = parameter_value
    return parameters


def are_determined(fit: Fit, indices: Iterable[int]) -> bool:
    """Whether a fit determines each of these of its parameters; linear ones, which may be zero,
    always are.
    """
    return all(_is_determined(fit, index) for index in indices if index in fit.fitted_indices)


def _is_determined(fit: Fit, parameter_index: int) -> bool:
    """Whether a parameter is linear, or known to within a half of its value; none is where the key
    is rigid.
    """
    if is_rigid(fit.parameters, parameter_index):
        return False
    return (
        is_linear(parameter_index)
        or fit.deviation(parameter_index)
        < _RELATIVE_DEVIATION_MAX * fit.parameters[parameter_index]
    )
