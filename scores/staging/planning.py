"""Makes a plan within the accuracy that a piece asks for, and tells what would fit if it costs too
much.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypedDict

from ergon import _core
from ergon.scores.reading.outputs import Accuracy, Method

# Errors that are offered if a plan costs too much, the most exact first [dB].
_LOOSER_ERRORS_DB = (-80.0, -60.0, -40.0, -20.0)
# Shares of the work for trials: for the requested plan and, if its cost is bounded, for each looser
# one. They add up to 1.
_WORK_SHARE, _LOOSER_WORK_SHARE = 0.5, 0.125
# The error that a draft may have: omitted modes are this far below the sound [dB].
_DRAFT_ERROR_DB = -20.0
# And the share of the work for its trials: so much shows where contacts hold once a step, which
# between frames may take ten times as long.
_DRAFT_WORK_SHARE = 0.05
# The share of the work for trials of a session, whose lines wait for their plans.
_SESSION_WORK_SHARE = 0.4
_NO_TRIAL_REASON = "no trial"  # the reason of a record that holds no result of a trial
# Methods of meshes, whose errors are known only from trials.
_TRIAL_METHODS = ("ca", "ca2p", "bm4", "ieq")
# What has no error but for what is left out.
_EXACT_KINDS = ("modes", "complex modes", "oscillators", "unheard", "still")


class TrialStore(Protocol):
    """Keeps the results of trials of earlier plans."""

    def get(self, key: str) -> _core.TrialRecord | None:
        """The record that was kept under a key."""

    def put(self, key: str, record: _core.TrialRecord) -> None:
        """Keep a record."""

    def forget(self) -> None:
        """Remove the records used least recently, until the rest is within bounds."""


class _CountedStore:
    """A store that counts the records it found, and the new ones."""

    def __init__(self, store: TrialStore) -> None:
        self._store = store
        self.n_found = self.n_new = 0

    def get(self, key: str) -> _core.TrialRecord | None:
        record = self._store.get(key)
        self.n_found += record is not None and _has_trials(record)
        return record

    def put(self, key: str, record: _core.TrialRecord) -> None:
        self.n_new += _has_trials(record)
        self._store.put(key, record)

    def forget(self) -> None:
        if self.n_new > 0:
            self._store.forget()


def _has_trials(record: _core.TrialRecord) -> bool:
    """Whether a record holds results of trials; those of modes and banks do not."""
    return record.reason != _NO_TRIAL_REASON


@dataclass(frozen=True, slots=True)
class PlanWithNotes:
    """A plan, the accuracy it was made for, and notes on it (code and sentence).

    `is_kept`: all results of its trials were kept from before. `is_draft`: it is cheap, not exact.
    """

    plan: _core.Plan
    accuracy: Accuracy
    notes: tuple[tuple[str, str], ...] = ()
    is_kept: bool = False
    is_draft: bool = False


def plan_cost(plan: _core.Plan) -> float:
    """Work on one core for a second of sound [s/s], by the table of costs."""
    return sum(row.cost for row in plan.rows())


class _Budget(TypedDict):
    method: Method | None
    error_db: float | None
    cents: float | None
    upto: float | None


class Watched(TypedDict, total=False):
    """Parts that are computed for pictures, and the step in frames of those that are not
    audible.
    """

    seen: Sequence[str]
    seen_every: int


def _budget_of(accuracy: Accuracy) -> _Budget:
    return _Budget(
        method=accuracy.method, error_db=accuracy.error, cents=accuracy.cents, upto=accuracy.upto
    )


class _Planner:
    """Makes plans of one piece, using results of earlier trials."""

    def __init__(
        self,
        network: _core.Network,
        timeline: _core.Timeline,
        store: TrialStore | None,
        earlier_plan: _core.Plan | None,
        watched: Watched,
    ) -> None:
        self._network_and_timeline = network, timeline
        self._watched = watched
        self._store = None if store is None else _CountedStore(store)
        self._earlier_plan = earlier_plan

    def plan(
        self, accuracy: Accuracy, share: float = 1.0, draft: tuple[float, float] | None = None
    ) -> _core.Plan:
        """A plan whose trials take a share of the work. With a `draft`, an error [dB] and a share,
        islands that no earlier plan has planned are planned by these, the others as they were then.
        """
        budget = _budget_of(accuracy)
        store, earlier_plan, watched = self._store, self._earlier_plan, self._watched
        return _core.Plan(
            *self._network_and_timeline,
            **budget,
            **watched,
            store=store,
            like=earlier_plan,
            share=share,
            draft=draft,
        )

    def finish(self) -> bool:
        """Let the store remove old records; returns whether no trial had to be run."""
        if self._store is None:
            return False
        self._store.forget()
        return self._store.n_new == 0 and self._store.n_found > 0


def make_plan(
    network: _core.Network,
    timeline: _core.Timeline,
    accuracy: Accuracy,
    pins: Sequence[_core.IslandChoice] | None = None,
    store: TrialStore | None = None,
    old_plan: _core.Plan | None = None,
    *,
    is_foreseen: bool = True,
    correction: float = 1.0,
    is_draft: bool = False,
    recalls_sound: bool = False,
    watched: Watched | None = None,
) -> PlanWithNotes:
    """The cheapest plan that is exact enough. Raises EngineError if there is none.

    A draft is the cheapest stable plan, whatever the accuracy; it is made with few trials. If it
    `recalls_sound`, islands that an earlier plan of the accuracy has planned, as `store` says, go
    by that, because sound that was computed so is recalled.

    With `cpu` alone, the plan is the most exact that fits. Parts that are the same in the plan
    `old_plan` are computed as there. `is_foreseen` is False if hands or a session play too. Real
    work is `correction` times that in the table of costs: notes use it, and so does the
    comparison with `cpu` if an accuracy is given too; the choice of methods uses the table
    alone. Parts that are `watched` are computed even if nobody hears them.
    """
    watched = watched or Watched()
    if pins is not None:
        pinned_plan = _core.Plan(network, timeline, **_budget_of(accuracy), **watched, pins=pins)
        return PlanWithNotes(pinned_plan, accuracy)
    planner = _Planner(network, timeline, store, old_plan, watched)
    is_cpu_only = accuracy == Accuracy(cpu=accuracy.cpu) and accuracy.cpu is not None
    if is_draft:
        may_recall = recalls_sound and store is not None and old_plan is None and not is_cpu_only
        return _draft_plan(planner, accuracy, may_recall=may_recall)
    work_share = 1.0 if accuracy.cpu is None else _WORK_SHARE
    if not is_foreseen:
        work_share *= _SESSION_WORK_SHARE
    plan = planner.plan(accuracy, work_share)
    plan_notes = _plan_notes(plan, accuracy, is_foreseen=is_foreseen)
    cost_factor = 1.0 if is_cpu_only else correction
    if accuracy.cpu is None or (not is_cpu_only and cost_factor * plan_cost(plan) <= accuracy.cpu):
        return PlanWithNotes(plan, accuracy, plan_notes, planner.finish())
    looser_accuracies = {error: Accuracy(error=error) for error in _LOOSER_ERRORS_DB}
    looser_plans = {
        error: planner.plan(looser_accuracy, _LOOSER_WORK_SHARE)
        for error, looser_accuracy in looser_accuracies.items()
    }
    fitting_errors = [
        error
        for error, looser_plan in looser_plans.items()
        if cost_factor * plan_cost(looser_plan) <= accuracy.cpu
    ]
    if is_cpu_only and fitting_errors:
        return PlanWithNotes(
            looser_plans[fitting_errors[0]],
            looser_accuracies[fitting_errors[0]],
            is_kept=planner.finish(),
        )
    plans = ((plan, accuracy), *zip(looser_plans.values(), looser_accuracies.values(), strict=True))
    cheapest_plan, cheapest_accuracy = min(
        plans, key=lambda plan_and_accuracy: plan_cost(plan_and_accuracy[0])
    )
    hint = (
        f"error: {fitting_errors[0]:g}dB fits"
        if fitting_errors
        else f"the cheapest plan takes {_percent_text(cost_factor * plan_cost(cheapest_plan))}"
    )
    allowed_text = _percent_text(accuracy.cpu)
    cost_text = _percent_text(cost_factor * plan_cost(plan))
    excess_sentence = (
        f"the plan takes {cost_text} of a core, above the {allowed_text} allowed; {hint}"
    )
    notes_with_cost = (*plan_notes, ("W402", excess_sentence))
    chosen_plan = (cheapest_plan, cheapest_accuracy) if is_cpu_only else (plan, accuracy)
    return PlanWithNotes(*chosen_plan, notes_with_cost, planner.finish())


def _draft_plan(planner: _Planner, accuracy: Accuracy, *, may_recall: bool) -> PlanWithNotes:
    """A draft: each island as an earlier plan of the accuracy, if it `may_recall`, or cheap."""
    draft = Accuracy(error=_DRAFT_ERROR_DB)
    if may_recall:
        plan = planner.plan(accuracy, draft=(_DRAFT_ERROR_DB, _DRAFT_WORK_SHARE))
        is_draft = any(row.drafted for row in plan.rows())
    else:
        plan, is_draft = planner.plan(draft, _DRAFT_WORK_SHARE), True
    return PlanWithNotes(
        plan, draft if is_draft else accuracy, is_kept=planner.finish(), is_draft=is_draft
    )


def _plan_notes(
    plan: _core.Plan, accuracy: Accuracy, *, is_foreseen: bool
) -> tuple[tuple[str, str], ...]:
    """Notes on parts of a plan whose accuracy is missed or unknown."""
    sentences = _error_misses(plan, accuracy.error, is_foreseen=is_foreseen)
    if accuracy.method is None and accuracy.error is None:
        sentences += _audible_misses(plan, accuracy.cents)
    sentences += _cut_short_sentences(plan, accuracy)
    sentences += _diverging_sentences(plan)
    return tuple(("W403", sentence) for sentence in sentences)


def plan_again(
    network: _core.Network,
    timeline: _core.Timeline,
    accuracy: Accuracy,
    old_plan: _core.Plan,
    watched: Watched,
) -> _core.Plan:
    """The plan of an open timeline that takes over from the plan `old_plan` of the same network,
    made for the same accuracy. Raises EngineError.
    """
    return _core.Plan(network, timeline, **_budget_of(accuracy), **watched, like=old_plan)


def needs_trial(row: _core.PlanRow) -> bool:
    """Whether the error of a row is known only from a trial."""
    return row.what not in _EXACT_KINDS and not row.reference


def draft_error_sentence(plan: _core.Plan) -> str:
    """A sentence on the known error of a plan that was made with few trials, at least in part."""
    plan_rows = [row for row in plan.rows() if row.cost > 0.0]
    drafted_rows = [row for row in plan_rows if row.drafted]
    is_mixed = 0 < len(drafted_rows) < len(plan_rows)
    plan_rows = drafted_rows or plan_rows
    left_out_db = [row.left_out_db for row in plan_rows if row.left_out_db is not None]
    untried_rows = [row for row in plan_rows if needs_trial(row) and row.error_db is None]
    known_error = "nothing is left out"
    if left_out_db:
        known_error = f"modes that are left out are {max(left_out_db):.0f} dB below the sound"
    unmeasured_text = (
        f"; the error of {_part_names(untried_rows)} is not measured" if untried_rows else ""
    )
    parts_text = f" of {_part_names(plan_rows)}" if is_mixed else ""
    others_text = "; all else is planned as an earlier render" if is_mixed else ""
    methods = "by the cheapest stable methods and few trials"
    return f"draft{parts_text}, {methods}: {known_error}{unmeasured_text}{others_text}"


def _part_names(rows: Sequence[_core.PlanRow]) -> str:
    """The parts of rows, each once."""
    return " + ".join(dict.fromkeys(name for row in rows for name in row.parts))


def _percent_text(fraction: float) -> str:
    """A part of a core [%], with at least two digits and without an exponent."""
    percent = 100 * fraction
    digits = 0 if percent >= 10 or percent <= 0 else 1 - math.floor(math.log10(percent))
    digits_text = f"{percent:.{digits}f}"
    return f"{digits_text.rstrip('0').rstrip('.') if '.' in digits_text else digits_text}%"


def _cut_short_sentences(plan: _core.Plan, accuracy: Accuracy) -> list[str]:
    """A sentence for parts whose trials ended at the work limit, with what is known of their
    error. Nothing is said of parts that are known to be exact enough: they may cost more than
    others would.
    """
    error = accuracy.error
    names_by_error: dict[tuple[float | None, float | None], list[str]] = {}
    for row in plan.rows():
        if row.cut_short and not row.diverges and not _meets_accuracy(row, accuracy):
            names_by_error.setdefault((row.error_db, row.error_s), []).extend(row.parts)
    sentences = []
    for (db, trial_duration), error_parts in names_by_error.items():
        known_error = "the error of the chosen method is unknown"
        if db is not None and trial_duration is not None:
            known_error = (
                f"the error of the chosen method is {db:.0f} dB over the first "
                f"{trial_duration:.2g} s"
            )
        if error is not None and db is None:
            known_error += f" and may be above the {error:g} dB that you asked for"
        elif error is not None and db is not None and db > error:
            known_error += f", above the {error:g} dB that you asked for"
        names = " + ".join(dict.fromkeys(error_parts))
        sentences.append(f"{names}: planning reached its work limit; {known_error}")
    return sentences


def _diverging_sentences(plan: _core.Plan) -> list[str]:
    """A sentence for parts that diverged in their trials: no method that was tried is stable."""
    diverging_names = dict.fromkeys(
        name for row in plan.rows() if row.diverges for name in row.parts
    )
    if not diverging_names:
        return []
    return [
        f"{' + '.join(diverging_names)}: the motion diverged in a trial; a render stops there with "
        "E401, and a performance mutes the part. Reduce K or the law, weaken the strikes, or raise "
        "the rate"
    ]


def _meets_accuracy(plan_row: _core.PlanRow, accuracy: Accuracy) -> bool:
    """Whether the error of a row was measured to its end and is within the accuracy."""
    error_db, audible = plan_row.error_db, plan_row.audible
    if accuracy.error is None and audible is not None:
        return _is_allowed(audible, _audible_limits(accuracy.cents))
    budget_db = _core.INAUDIBLE_ERROR_DB if accuracy.error is None else accuracy.error
    return error_db is not None and error_db <= budget_db and plan_row.spectral_db is None


def _error_misses(plan: _core.Plan, error: float | None, *, is_foreseen: bool) -> list[str]:
    """A sentence for parts whose error is above `error`, or unknown.

    One sentence for each island. If hands or a session play, no error is known beforehand.
    """
    if error is None:
        return []
    parts_by_error: dict[tuple[float, float, float | None], list[str]] = {}
    unknown_parts: list[str] = []
    for plan_row in plan.rows():
        db, trial_duration = plan_row.error_db, plan_row.error_s
        if plan_row.cut_short or plan_row.diverges:
            continue
        if db is None or trial_duration is None:
            if plan_row.what in _TRIAL_METHODS and is_foreseen:
                unknown_parts.extend(plan_row.parts)
            continue
        if db > error or plan_row.spectral_db is not None:
            parts_by_error.setdefault((db, trial_duration, plan_row.spectral_db), []).extend(
                plan_row.parts
            )
    sentences = [
        f"{' + '.join(dict.fromkeys(parts))}: the error is {db:.0f} dB over the first "
        f"{seconds:.2g} s"
        + (
            f", above the {error:g} dB asked for"
            if spectral is None
            else "; after that the motion is chaotic: waveforms differ between methods, while the "
            f"spectra agree within {spectral:.1f} dB"
        )
        for (db, seconds, spectral), parts in parts_by_error.items()
    ]
    if unknown_parts:
        names = " + ".join(dict.fromkeys(unknown_parts))
        sentences.append(
            f"{names}: the error is unknown, because no trial of another method was finished; it "
            f"may be above the {error:g} dB that you asked for"
        )
    return sentences


def _audible_misses(plan: _core.Plan, cents: float | None) -> list[str]:
    """A sentence for parts whose audible error is above what is allowed by ear, or in cents."""
    limits = _audible_limits(cents)
    allowed_error = _core.AudibleError(*limits)
    parts_by_sentence: dict[str, list[str]] = {}
    for plan_row in plan.rows():
        audible, trial_duration, spectral = plan_row.audible, plan_row.error_s, plan_row.spectral_db
        if trial_duration is None or plan_row.cut_short:
            continue
        if audible is not None and not _is_allowed(audible, limits):
            error_sentence = (
                f"over the first {trial_duration:.2g} s {error_text(audible)}; allowed are "
                f"{allowed_error.cents:.2g} cents, {100 * allowed_error.t60:.2g}%, "
                f"{allowed_error.third_octave_db:.2g} dB, {1e3 * allowed_error.first_stroke_s:.2g} "
                f"ms at the first stroke, {1e3 * allowed_error.later_stroke_s:.2g} ms at others "
                f"and {allowed_error.stroke_db:.2g} dB"
            )
        elif spectral is not None and spectral > _core.SPECTRUM_NOISE_DB:
            noise = _core.SPECTRUM_NOISE_DB
            error_sentence = (
                f"after the first {trial_duration:.2g} s the motion is chaotic, and third octaves "
                f"of a more exact run differ by {spectral:.1f} dB on average, above the "
                f"{noise:.2g} dB by which rounding alone changes such a motion"
            )
        else:
            continue
        parts_by_sentence.setdefault(error_sentence, []).extend(plan_row.parts)
    return [
        f"{' + '.join(dict.fromkeys(parts))}: {sentence}"
        for sentence, parts in parts_by_sentence.items()
    ]


def _audible_limits(cents: float | None) -> list[float]:
    """What is allowed by ear, in the order of `AudibleError`."""
    just_noticeable = _core.JUST_NOTICEABLE
    share = 1.0 if cents is None else cents / just_noticeable[0]
    return [share * value for value in just_noticeable]


def _is_allowed(audible: _core.AudibleError, limits: list[float]) -> bool:
    return all(error <= limit for error, limit in zip(audible, limits, strict=True))


def error_text(audible: _core.AudibleError) -> str:
    """The audible error as part of a sentence."""
    return (
        f"pitches are off by up to {audible.cents:.2g} cents, T60 by {100 * audible.t60:.2g}%, "
        f"audible third octaves by {audible.third_octave_db:.2g} dB, strokes by "
        f"{1e3 * max(audible.first_stroke_s, audible.later_stroke_s):.2g} ms and "
        f"{audible.stroke_db:.2g} "
        "dB"
    )


def requested_accuracy(
    accuracy: Accuracy, *, asked_method: str | None, error: float | None, cents: float | None
) -> Accuracy:
    """The accuracy with what the command line asks for in place of the score's; `cpu` stays."""
    if asked_method is None and error is None and cents is None:
        return accuracy
    upto = accuracy.upto if cents is not None else None
    return replace(Accuracy(asked_method, error, cents, upto), cpu=accuracy.cpu)  # type: ignore[arg-type]
