"""A reference to measure against, and an estimate of its own error.

The best method is run at higher and higher oversampling. The changes of the last doublings give
the order p at which its error falls, and so the remaining error (Richardson): the change divided
by 2^p - 1. Contacts make these changes uneven, because the result depends on where between two
samples they close. So p and the last change come from a straight line through several changes,
and a change that falls faster than the method's own order counts as chance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import log10

import numpy as np

from ergon.workshop.lab.metrics import Floats, waveform_db
from ergon.workshop.lab.names import order_of
from ergon.workshop.lab.runs import Setting

EXACT_DB = -180.0  # change by doubling in an exact method: rounding
_ORDER_DB = 20.0 * log10(2.0)  # of an error of order 1
_FITTED_CHANGES = 4  # changes that tell the order
_DOUBT_MARGIN_DB = 20.0  # the estimates themselves may be wrong by so much
_ORDER_MIN = 0.5  # slower than that nothing is left out by extrapolating


@dataclass(frozen=True, slots=True)
class Reference:
    """The sound against which others are measured.

    `changes_db` are the changes by each doubling [dB], the last one last; `coarser_sound` is the
    sound one doubling earlier.
    """

    setting: Setting
    sound: Floats
    coarser_sound: Floats
    changes_db: tuple[float, ...]

    @property
    def order(self) -> float | None:
        """The observed p, at most the method's own; None if none can be observed."""
        return self._fit_changes()[0]

    @property
    def floor_db(self) -> float:
        """Estimated error of the reference as a waveform [dB]."""
        return self.changes_db[-1] + 20.0 * log10(self.error_ratio)

    @property
    def error_ratio(self) -> float:
        """The reference's own error over the change of the last doubling."""
        order, last_change = self._fit_changes()
        chance_ratio: float = 10.0 ** (max(0.0, last_change - self.changes_db[-1]) / 20.0)
        return chance_ratio if order is None else chance_ratio / float(2.0**order - 1.0)

    def _fit_changes(self) -> tuple[float | None, float]:
        """The order, and the last change [dB], from a straight line through the last changes."""
        if len(self.changes_db) < 2 or min(self.changes_db[-_FITTED_CHANGES:]) < EXACT_DB:
            return None, self.changes_db[-1]
        fall_max = _ORDER_DB * (order_of(self.setting.method))
        limited_changes = [self.changes_db[0]]
        for change in self.changes_db[1:]:
            limited_changes.append(max(change, limited_changes[-1] - fall_max))
        limited_changes = limited_changes[-_FITTED_CHANGES:]
        slope, intercept = np.polyfit(np.arange(len(limited_changes)), limited_changes, 1)
        last_change = max(
            float(intercept + slope * (len(limited_changes) - 1)), limited_changes[-1]
        )
        order = -float(slope) / _ORDER_DB
        return (order, last_change) if order >= _ORDER_MIN else (None, last_change)


def oversamplings(upto: int) -> tuple[int, ...]:
    """1, 2, 4 … up to `upto`."""
    return tuple(2**i for i in range(max(1, upto).bit_length()))


def best_method(sounds: Mapping[Setting, Floats]) -> str | None:
    """The method whose last doubling changed least, of those in double precision."""
    errors = {}
    for method in dict.fromkeys(setting.method for setting in sounds if setting.method):
        rungs = ladder(sounds, method)
        if len(rungs) > 1:
            errors[method] = waveform_db(rungs[-2][1], rungs[-1][1])
    return min(errors, key=lambda method: errors[method], default=None)


def ladder(sounds: Mapping[Setting, Floats], method: str) -> list[tuple[int, Floats]]:
    """Sounds of one method in double precision, each twice as oversampled as the one before."""
    rungs = sorted(
        ((setting.oversampling, sound) for setting, sound in sounds.items()
         if setting.method == method and setting.precision == "f64"),
        key=lambda rate_and_sound: rate_and_sound[0],
    )  # fmt: skip
    # A run that failed breaks the ladder: only the part above it counts.
    first_doubled = next(
        (rung for rung in range(len(rungs) - 1, 0, -1) if rungs[rung][0] != 2 * rungs[rung - 1][0]),
        0,
    )
    return rungs[first_doubled:]


def refine(
    sounds: dict[Setting, Floats],
    run: Callable[[Setting], Floats | None],
    *,
    doublings: int = 2,
    rival: Setting | None = None,
) -> Reference | None:
    """Take the best method further by `doublings`; None if nothing can be compared.

    `run` returns a sound, or None if it fails; sounds are added to `sounds`. The setting `rival`,
    run again at more steps, becomes the reference if its own error is smaller.
    """
    method = best_method(sounds)
    if method is None:
        return None
    reference = _refined(sounds, run, method, doublings)
    if rival is None or reference.floor_db < EXACT_DB:
        return reference
    rival_reference = _refined_rival(run, rival)
    return (
        reference
        if rival_reference is None or rival_reference.floor_db >= reference.floor_db
        else rival_reference
    )


def _refined_rival(run: Callable[[Setting], Floats | None], rival: Setting) -> Reference | None:
    """A setting at twice its steps, or at up to 16 times; None if it tells nothing of its error.

    A plan of the scene at twice the rate may take the very same steps: then nothing is compared.
    """
    coarser_sound = run(rival)
    for step_multiple in (2, 4, 8, 16):
        finer_setting = replace(rival, oversampling=step_multiple * rival.oversampling)
        finer_sound = run(finer_setting)
        if coarser_sound is None or finer_sound is None:
            return None
        (change,) = _changes([(1, coarser_sound), (step_multiple, finer_sound)])
        if change > EXACT_DB:
            return Reference(finer_setting, finer_sound, coarser_sound, (change,))
        coarser_sound = finer_sound
    return None


def _refined(
    sounds: dict[Setting, Floats],
    run: Callable[[Setting], Floats | None],
    method: str,
    doublings: int,
) -> Reference:
    """The best method, taken further."""
    for _ in range(doublings):
        rungs = ladder(sounds, method)
        if waveform_db(rungs[-2][1], rungs[-1][1]) < EXACT_DB:
            break
        finer_setting = Setting(method, 2 * rungs[-1][0])
        finer_sound = run(finer_setting)
        if finer_sound is None:
            break
        sounds[finer_setting] = finer_sound
    return _reference_of(sounds, method)


def _reference_of(sounds: Mapping[Setting, Floats], method: str) -> Reference:
    rungs = ladder(sounds, method)
    return Reference(Setting(method, rungs[-1][0]), rungs[-1][1], rungs[-2][1], _changes(rungs))


def find_doubts(sounds: Mapping[Setting, Floats], reference: Reference) -> list[str]:
    """Methods that converge to another sound than the reference: one of the two must be wrong."""
    sentences = []
    for method in dict.fromkeys(setting.method for setting in sounds if setting.method):
        if method == reference.setting.method or len(ladder(sounds, method)) < 2:
            continue
        method_reference = _reference_of(sounds, method)
        difference_db = waveform_db(method_reference.sound, reference.sound)
        if difference_db > max(method_reference.floor_db, reference.floor_db) + _DOUBT_MARGIN_DB:
            sentences.append(
                f"{method_reference.setting} and {reference.setting} differ by "
                f"{difference_db:.0f} dB, "
                "though their "
                "own "
                f"errors seem to be {method_reference.floor_db:.0f} and {reference.floor_db:.0f} dB"
            )
    return sentences


def _changes(rungs: Sequence[tuple[int, Floats]]) -> tuple[float, ...]:
    """The change of each doubling [dB]."""
    return tuple(
        max(waveform_db(sound, finer_sound), 2.0 * EXACT_DB)
        for (_, sound), (_, finer_sound) in pairwise(rungs)
    )
