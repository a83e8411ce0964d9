"""The order in which the parts of a key's model are identified, and which of them are kept.

A part is kept only if the information criterion falls, the held-out gesture is followed better,
and its parameters are known to within a half of their values. Dry friction comes before modes,
because its residual hides them. But a delay or a mode that is not identified yet looks like a
compliant contact. So once they are known, each kept kind of friction is removed again on trial,
and stays removed if the criterion falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from . import output_error
from .first_guess import first_guess
from .gesture import sensor_noise
from .mode_search import SCORE_MIN, highest_peak
from .parameters import INDEX, is_plain, is_stiffest, n_modes, of_mode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from .gesture import Floats, Gesture
    from .output_error import Fit

FITTED_SHARE = 0.75  # of the last take, where none is held out
MODES_MAX = 3
_LINEAR = tuple(INDEX[name] for name in ("mass", "stiffness", "damping", "weight"))
_ROUGH_ITERATIONS = 4  # iterations from each of several starts
_UNKNOWN = 0.5  # of a part: a deviation by which it may as well not be there
_DELAYS = (0.0, 1.0)  # ticks: of devices in lockstep and by their own clock; tried beside the guess
_TRIAL_ITERATIONS = 15  # iterations for what may not be there
_NOISE_RATIO = 1.02  # of the sensor's noise: nothing is left to explain


@dataclass(frozen=True, slots=True)
class Stage:
    """A part that was tried: its fit, the error on the held-out gesture, and whether it was kept.

    `replay` is the rms [m] of the difference from the held-out positions, their noise included.
    For a mode that was not tried, `fit` is the fit before, and `score` says why. `is_removal`
    says that the part was removed on trial; `kept` then says that it stays removed.
    """

    name: str
    fit: Fit
    replay: float
    kept: bool
    score: float | None = None
    is_removal: bool = False


@dataclass(frozen=True, slots=True)
class Measured:
    """A measured key: all stages in order, the final fit, its held-out error, and the sensor's
    noise [m].

    `noise` is None if no take begins with a still key.
    """

    stages: tuple[Stage, ...]
    fit: Fit
    replay: float
    noise: float | None


def measure(
    gestures: Sequence[Gesture],
    held_out: Gesture | None = None,
    tell: Callable[[Stage], object] = lambda stage: None,
) -> Measured:
    """Measure a key by gestures; `tell` is called after each stage.

    Without `held_out` the last quarter of the last gesture is held out. Raises StoppedError.
    """
    gestures = list(gestures)
    noise = sensor_noise(gestures if held_out is None else [*gestures, held_out])
    judge = _Judge(gestures, held_out)
    guess = first_guess(judge.gestures)
    row = guess.copy()
    row[INDEX["dry"]] = 0.0
    stages = [judge.stage("M K Z", row, _LINEAR, None)]
    best = stages[0]
    tell(best)

    def take(stage: Stage) -> None:
        nonlocal best
        stages.append(stage)
        tell(stage)
        best = stage if stage.kept else best

    for name, start in _FRICTIONS:
        added = start(best.fit.row, guess)
        columns = (*best.fit.columns, *(INDEX[parameter] for parameter in added))
        row = _with(best.fit.row, added)
        take(judge.stage(name, row, columns, best, iterations=_TRIAL_ITERATIONS))
    ticks = [{}, *({"delay": n / judge.gestures[0].rate} for n in _DELAYS)]
    rows = [_with(best.fit.row, added) for added in ticks]
    take(judge.best_of("delay", rows, (*best.fit.columns, INDEX["delay"]), best))

    def take_modes() -> None:
        while n_modes(best.fit.row) < MODES_MAX and not _is_noise(best.fit, noise):
            take(_mode(judge, best))
            if not stages[-1].kept:
                break

    take_modes()
    removals = []
    for name in _doubtful(best):
        removals.append(judge.without(name, best))
        take(removals[-1])
    if any(stage.kept for stage in removals):
        take_modes()
    return Measured(tuple(stages), best.fit, best.replay, noise)


# Kinds of dry friction, and the starting values of their parameters, from a fit and the first
# guess.
_FRICTIONS: tuple[tuple[str, Callable[[Floats, Floats], dict[str, float]]], ...] = (
    ("dry", lambda row, guess: {"dry": guess[INDEX["dry"]]}),
    ("presliding", lambda row, guess: {"presliding": 5e3}),
    (
        "Stribeck",
        lambda row, guess: {"static_dry": 1.2 * row[INDEX["dry"]], "static_speed": 5e-3},
    ),
)


# Kinds of friction that may have been fitted in place of a delay or a mode, and their parameters.
_DOUBTFUL = {"presliding": ("presliding",), "Stribeck": ("static_dry", "static_speed")}


def _doubtful(stage: Stage) -> list[str]:
    """Kinds of friction that were kept before delay and modes were known."""
    return [name for name, own in _DOUBTFUL.items() if INDEX[own[0]] in stage.fit.columns]


def _with(row: Floats, added: dict[str, float]) -> Floats:
    row = row.copy()
    for name, value in added.items():
        row[INDEX[name]] = value
    return row


def _is_noise(fit: Fit, noise: float | None) -> bool:
    return noise is not None and fit.rms <= _NOISE_RATIO * noise


def _mode(judge: _Judge, before: Stage) -> Stage:
    """Try one more mode. The delay is fitted with it, because both act on the quickest motions."""
    peak = highest_peak(judge.recovered(before), before.fit)
    number = n_modes(before.fit.row)
    name = "mode" if number == 0 else f"mode {number + 1}"
    if peak.score < SCORE_MIN:
        return Stage(name, before.fit, before.replay, False, peak.score)
    rows = []
    for frequency, ratio in ((1, 0.01), (1, 0.03), (1 / 1.025, 0.02), (1.025, 0.02)):
        row = np.append(before.fit.row, [peak.mass, frequency * peak.frequency, ratio])
        row[0] -= peak.mass
        rows.append(row)
    columns = dict.fromkeys((*before.fit.columns, INDEX["delay"], *of_mode(number)))
    return judge.best_of(name, rows, tuple(columns), before, peak.score)


def _is_known(fit: Fit, index: int) -> bool:
    """Whether a parameter that cannot be zero is known to within a half of its value."""
    if is_stiffest(fit.row, index):
        return False
    return is_plain(index) or fit.deviation(index) < _UNKNOWN * fit.row[index]


class _Judge:
    """Fits stages, and compares each with the one before on data to which neither was fitted."""

    def __init__(self, gestures: list[Gesture], held_out: Gesture | None) -> None:
        self.is_apart = held_out is not None
        if held_out is None:
            gestures[-1], held_out = gestures[-1].parted(FITTED_SHARE)
        self.gestures, self.held_out = gestures, held_out

    def recovered(self, before: Stage | None) -> list[Gesture]:
        """The gestures, with the unknown forces found by the fit before."""
        return self.gestures if before is None else before.fit.recovered(self.gestures)

    def stage(
        self,
        name: str,
        row: Floats,
        columns: tuple[int, ...],
        before: Stage | None,
        score: float | None = None,
        iterations: int = 30,
    ) -> Stage:
        """Fit these columns starting at a row, and judge the fit."""
        starts = None if before is None else before.fit.starts
        fit = output_error.fit(self.recovered(before), row, columns, starts, iterations)
        start = self.held_out.start if self.is_apart else fit.starts[-1]
        held_out = self.held_out
        if not self.is_apart:
            held_out = held_out.with_forces(fit.forces[-1])
        held_out = output_error.recovered(fit.row, held_out, start)
        errors = output_error.errors(fit.row, held_out, start)
        replay = float(np.sqrt(np.mean(errors**2)))
        kept = before is None or (
            fit.bic < before.fit.bic
            and replay < before.replay
            and all(_is_known(fit, index) for index in set(columns) - set(before.fit.columns))
        )
        return Stage(name, fit, replay, kept, score)

    def without(self, name: str, before: Stage) -> Stage:
        """Remove a kind of friction and fit the rest; it stays removed if BIC falls."""
        own = _DOUBTFUL[name]
        gone = {INDEX[parameter] for parameter in own}
        columns = tuple(index for index in before.fit.columns if index not in gone)
        found = self.stage(name, _with(before.fit.row, dict.fromkeys(own, 0.0)), columns, before)
        return replace(found, kept=found.fit.bic < before.fit.bic, is_removal=True)

    def best_of(
        self,
        name: str,
        rows: list[Floats],
        columns: tuple[int, ...],
        before: Stage,
        score: float | None = None,
    ) -> Stage:
        """Fit several rows roughly, then fit and judge the best one as `stage` does."""
        fits = [
            output_error.fit(
                self.recovered(before), row, columns, before.fit.starts, _ROUGH_ITERATIONS
            )
            for row in rows
        ]
        row = min(fits, key=lambda fit: fit.rms).row
        return self.stage(name, row, columns, before, score)
