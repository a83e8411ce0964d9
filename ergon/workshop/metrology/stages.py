"""The search for the parts of a key's model.

A part is kept only if the information criterion falls (Schwarz 1978), the held-out gesture is
followed better, and its parameters are known to within a half of their values. A mode is also kept
if the gesture is too slow to show it, and the takes are surely explained better. A part that was
refused is tried again after each part that was kept, until no part is kept any more: one part may
hide another. In the end the search goes on after a refused part that explains the takes, and what
it finds stays if the gesture is followed better. A delay or a mode that is not identified yet looks
like a compliant contact. So each kept kind of friction is removed again on trial in the end, and
stays removed if the criterion falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from .first_guess import first_guess
from .gesture import sensor_noise
from .judging import Stage, StageJudge, are_determined, with_values
from .mode_search import SCORE_MIN, highest_peak
from .parameters import INDEX, merge_nearest_modes, mode_indices, n_modes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .gesture import Floats, Gesture
    from .output_error import Fit

MODES_MAX = 3
_DETOURS_MAX = 2  # refused parts after which the search continues
_LINEAR = tuple(INDEX[name] for name in ("mass", "stiffness", "damping", "weight"))
_DELAYS = (0.0, 1.0)  # delays tried beside the guess [ticks]: lockstep, own clock


@dataclass(frozen=True, slots=True)
class Measured:
    """A measured key: all stages in order, the final fit, its held-out error, and the sensor's
    noise [m].

    `noise` is None if no take begins with a still key.
    """

    stages: tuple[Stage, ...]
    fit: Fit
    replay_rms: float
    noise: float | None


@dataclass(frozen=True, slots=True)
class _Part:
    """A part that a key has or lacks: its parameters, the parameter that it needs, and the values
    from which it is tried, by the row of the fit before, the first guess and the rate.
    """

    name: str
    parameters: tuple[str, ...]
    start_values: Callable[[Floats, Floats, float], list[tuple[float, ...]]]
    needs: str = "mass"
    is_doubtful: bool = False  # may have been fitted in place of a delay or a mode

    def can_be_added(self, fit: Fit) -> bool:
        """Whether the part can be added to a fit."""
        return INDEX[self.needs] in fit.fitted_indices and not self.is_fitted(fit)

    def is_fitted(self, fit: Fit) -> bool:
        """Whether a fit has the part."""
        return INDEX[self.parameters[0]] in fit.fitted_indices


_PARTS = (
    _Part("dry", ("dry",), lambda row, guess, rate: [(guess[INDEX["dry"]],)]),
    _Part("presliding", ("presliding",), lambda row, guess, rate: [(5e3,)], "dry", True),
    _Part(
        "Stribeck",
        ("static_dry", "static_speed"),
        lambda row, guess, rate: [
            (over * row[INDEX["dry"]], speed)
            for over, speed in ((1.2, 5e-3), (1.5, 2e-3), (1.5, 2e-2))
        ],
        "dry",
        True,
    ),
    _Part(
        "delay",
        ("delay",),
        lambda row, guess, rate: [(row[INDEX["delay"]],), *((n / rate,) for n in _DELAYS)],
    ),
)


def measure(
    gestures: Sequence[Gesture],
    held_out: Gesture | None = None,
    report_stage: Callable[[Stage], object] = lambda stage: None,
) -> Measured:
    """Measure a key by gestures; `report_stage` is called after each stage.

    Without `held_out` the last quarter of the last gesture is held out. Raises StoppedError.
    """
    gestures = list(gestures)
    noise = sensor_noise(gestures if held_out is None else [*gestures, held_out])
    search = _Search(StageJudge(gestures, held_out), report_stage)
    search.add_parts()
    while search.add_against_held_out() or search.remove_doubtful():
        search.add_parts()
    final = search.judge.refit_from_other_delays(search.best)
    return Measured(tuple(search.stages), final.fit, final.replay_rms, noise)


class _Search:
    """The stages so far, the best of them, and those that were refused since."""

    def __init__(self, judge: StageJudge, report_stage: Callable[[Stage], object]) -> None:
        self.judge, self.report_stage = judge, report_stage
        self.guess = first_guess(judge.gestures)
        row = with_values(self.guess, {"dry": 0.0})
        self.best = judge.fit_stage("M K Z", row, _LINEAR, None)
        self.stages = [self.best]
        self.refused: list[Stage] = []
        report_stage(self.best)

    def _decide(self, stage: Stage) -> bool:
        """Keep a stage or not."""
        self.stages.append(stage)
        self.report_stage(stage)
        if stage.is_accepted:
            self.best, self.refused = stage, []
        else:
            self.refused.append(stage)
        return stage.is_accepted

    def _was_refused(self, name: str) -> bool:
        """Whether adding or removing a part was refused since a part was kept."""
        return any(stage.name == name for stage in self.refused)

    def add_parts(self) -> None:
        """Try all parts, and those that were refused again after each one that was kept."""
        attempts: list[Callable[[], bool]] = [
            *(partial(self._add, part) for part in _PARTS),
            self._add_mode,
        ]
        n_failed, attempt_index = 0, 0
        while n_failed < len(attempts):
            if attempts[attempt_index % len(attempts)]():
                n_failed = 0
            else:
                n_failed, attempt_index = n_failed + 1, attempt_index + 1

    def _add(self, part: _Part) -> bool:
        """Add a part if it is kept; return whether it was."""
        previous = self.best
        if not part.can_be_added(previous.fit) or self._was_refused(part.name):
            return False
        fitted_indices = (*previous.fit.fitted_indices, *(INDEX[name] for name in part.parameters))
        start_rows = [
            with_values(previous.fit.parameters, dict(zip(part.parameters, values, strict=True)))
            for values in part.start_values(
                previous.fit.parameters, self.guess, self.judge.gestures[0].rate
            )
        ]
        return self._decide(
            self.judge.fit_best_start(part.name, start_rows, fitted_indices, previous)
        )

    def _add_mode(self) -> bool:
        """Whether one more mode was kept. The delay is fitted with it, because both act on the
        quickest motions.
        """
        previous = self.best
        mode_number = n_modes(previous.fit.parameters)
        stage_name = "mode" if mode_number == 0 else f"mode {mode_number + 1}"
        if mode_number == MODES_MAX or self._was_refused(stage_name):
            return False
        peak = highest_peak(self.judge.with_recovered_forces(previous), previous.fit)
        if peak.score < SCORE_MIN:
            return self._decide(
                Stage(stage_name, previous.fit, previous.replay_rms, False, peak.score)
            )
        start_rows = []
        for pitch_factor, ratio in ((1, 0.01), (1, 0.03), (1 / 1.025, 0.02), (1.025, 0.02)):
            row = np.append(
                previous.fit.parameters, [peak.mass, pitch_factor * peak.frequency, ratio]
            )
            row[0] -= peak.mass
            start_rows.append(row)
        trial_indices = dict.fromkeys(
            (*previous.fit.fitted_indices, INDEX["delay"], *mode_indices(mode_number))
        )
        trial = self.judge.fit_best_start(
            stage_name, start_rows, tuple(trial_indices), previous, peak.score
        )
        return self._decide(trial) or self._join_modes(trial, previous)

    def _join_modes(self, trial: Stage, best_before: Stage) -> bool:
        """Whether the modes of a refused trial were kept with two of one pitch as one. A mode that
        was fitted before the next one was known may stay far from its values; the rest of it then
        looks like a mode of the same pitch, which frees the others.
        """
        joined_row = merge_nearest_modes(trial.fit.parameters)
        if joined_row is None or not trial.explains_more(best_before):
            return False
        fitted_indices = tuple(
            index for index in trial.fit.fitted_indices if index < joined_row.size
        )
        return self._decide(
            self.judge.fit_stage("modes anew", joined_row, fitted_indices, best_before)
        )

    def add_against_held_out(self) -> bool:
        """Whether parts were kept after one that was refused, though it explains the takes.

        Where sticking and sliding alternate, a part that is right may follow a gesture worse
        until the next one is known; and two parts that are both missing may hide each other: what
        one leaves makes the other's values unsure.
        """
        previous = self.best
        for stage in sorted(
            [stage for stage in self.refused if stage.explains_more(previous)],
            key=lambda stage: (not stage.is_significant, stage.fit.bic),
        )[:_DETOURS_MAX]:
            self._decide(replace(stage, is_accepted=True))
            self.add_parts()
            added_indices = set(stage.fit.fitted_indices) - set(previous.fit.fitted_indices)
            # Without a mode that the gesture is too slow to show, the mass is wrong by that of the
            # mode.
            is_sure_mode = stage.name.startswith("mode") and self.best.is_sure_despite_replay(
                previous
            )
            is_better = self.best.replay_rms < previous.replay_rms or is_sure_mode
            if is_better and are_determined(self.best.fit, added_indices):
                return True
            self._decide(replace(previous, name=stage.name, is_accepted=True, is_removal=True))
        return False

    def remove_doubtful(self) -> bool:
        """Whether a kind of friction was removed."""
        removed = [
            self._decide(self.judge.fit_without(part.name, part.parameters, self.best))
            for part in _PARTS
            if part.is_doubtful
            and part.is_fitted(self.best.fit)
            and not self._was_refused(part.name)
        ]
        return any(removed)
