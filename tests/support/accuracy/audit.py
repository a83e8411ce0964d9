"""For each plan: its stated error, its real error, and its cost compared with the cheapest plain
setting.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf, log10

import numpy as np

from accuracy import hearing, reference, stepped
from accuracy.equations import read
from accuracy.random_scenes import text as random_text
from ergon import _core
from ergon.scores.reading.load import load
from ergon.scores.reading.outputs import Accuracy
from ergon.scores.reading.piece import Piece
from ergon.scores.staging import planning
from ergon.scores.staging.preparing import PreparedPiece, prepare
from ergon.scores.staging.refusals import StageError
from ergon.workshop.lab import metrics
from ergon.workshop.lab.runs import OversampledScene
from ergon.workshop.lab.scene import NetworkAndTimeline, Score

BY_EAR = None
BUDGETS: tuple[float | None, ...] = (BY_EAR, -40.0, -60.0, -80.0)
PLAIN = (
    *(("ca", times) for times in (1, 2, 4, 8)),
    *(("ca2p", times) for times in (1, 2)),
    *(("bm4", times) for times in (1, 2)),
    ("modal", 1),
)
# Allowed mean difference of third octaves between two renders of a chaotic motion; rounding alone
# makes 2 dB.
UNLIKE = 3.0  # [dB]
FLOOR_DB = -150.0  # errors below are rounding, of the reference too
LEAST = 0.05  # [s] that the shortest pilot plays
APART = 1.0  # [dB] by which two plans of a scene differ for certain
DEARER = 1.02  # ratio by which one plan costs more than another for certain
# What is heard of a plan by ear, over what is allowed, from which on it is a miss: here partials of
# close pitches are followed differently than in the planner.
CLEARLY = 1.2
STILL = 1e-24  # of the loudest output [power]: rounding of the reference
THIRD = 0.1  # [s] of a pilot's 0.3 s: errors are taken up to one, two and three of them


@dataclass(frozen=True)
class Plan:
    """A plan of a scene. Errors in dB: `real` over the pilot's time, `render_error` over the
    render.

    `spectrum`: if the plan says that the motion is chaotic, the mean difference of third octaves
    over the render, minus that of two tolerances of the reference. `stated` is FLOOR_DB if the
    plan says that it is exact, and infinite if it says that it did not measure the error.
    `audible`: of a plan by ear, what is heard of its error over what is allowed. `doubt`:
    the difference of two tolerances of the reference over the pilot's time. `refused`: why there is
    no plan or no render; then nothing else is known.
    """

    budget: float | None
    stated: float = inf
    real: float = inf
    render_error: float = inf
    doubt: float = inf
    pilot: float = inf
    cost: float = inf
    warned: bool = False
    chaotic: bool = False
    spectrum: float = 0.0
    audible: float = inf
    refused: str = ""
    how: str = ""

    @property
    def is_judged(self) -> bool:
        """Whether there is a render, of a motion whose reference is accurate enough and that is not
        announced as chaotic.
        """
        is_sure = self.doubt < max(self.real - 10.0, -120.0)
        return is_sure and not self.refused and not self.chaotic

    @property
    def is_met(self) -> bool:
        """Whether the error is within the budget."""
        if self.budget is None:
            return self.is_judged and self.audible <= CLEARLY
        return self.is_judged and self.real <= self.asked + 0.1

    @property
    def is_silent_miss(self) -> bool:
        """Whether the real error exceeds the budget, and the stated one by more than 1.5 dB or none
        is stated, without a warning.

        By ear: whether more is heard than is allowed, without a warning. For a chaotic motion:
        whether the spectrum differs, without a warning.
        """
        if self.chaotic:
            return self.spectrum > UNLIKE and not self.warned
        is_stated = self.stated < inf and self.excess <= 1.5 and self.budget is not None
        return self.is_judged and not self.is_met and not (self.warned or is_stated)

    @property
    def excess(self) -> float:
        """Real error over the stated one [dB]; errors below -100 dB count as equal."""
        return self.real - max(self.stated, -100.0)

    @property
    def asked(self) -> float:
        """The budget [dB]; by ear no waveform is promised."""
        return inf if self.budget is None else self.budget


@dataclass(frozen=True)
class Plain:
    """A method at a multiple of the rate for the whole scene: its real errors and its cost.

    There is one error for the time of each plan's pilot: in a chaotic motion a plan states a
    shorter time. `audible` is as that of a plan, over the time of the plan by ear.
    """

    method: str
    times: int
    reals: tuple[float, ...]
    cost: float
    audible: float = inf

    @property
    def real(self) -> float:
        """The error over the longest time."""
        return max(self.reals, default=inf)


@dataclass(frozen=True)
class Audit:
    """A scene, its plans, and its plain settings."""

    name: str
    plans: tuple[Plan, ...]
    plain: tuple[Plain, ...] = field(default=())

    def overspending(self, plan: Plan) -> float | None:
        """The plan's cost over that of the cheapest plain setting that also keeps the budget."""
        if not plan.is_met:
            return None
        costs = [setting.cost for setting in self._plain_within(plan)]
        return plan.cost / min(costs) if costs else None

    def _plain_within(self, plan: Plan) -> list[Plain]:
        """The plain settings that keep the plan's budget over the time of its pilot."""
        if plan.budget is None:
            return [setting for setting in self.plain if setting.audible <= 1.0]
        position = self.plans.index(plan)
        return [setting for setting in self.plain if setting.reals[position] <= plan.asked]

    def is_inverted(self, plan: Plan) -> bool:
        """Whether a plan is out of order: it misses its budget by an error more than APART above
        that of a looser budget, or costs more than a stricter one.
        """
        if plan.budget is None or not plan.is_judged:
            return False
        others = [own for own in self.plans if own.budget is not None and own.is_judged]
        looser = [own.real for own in others if own.asked > plan.asked]
        stricter = [own.cost for own in others if own.asked < plan.asked]
        is_worse = not plan.is_met and any(plan.real > real + APART for real in looser)
        return is_worse or any(plan.cost > DEARER * cost for cost in stricter)

    def is_false_cannot(self, plan: Plan) -> bool:
        """Whether a plan says that it cannot keep its budget, but a plain setting does."""
        if plan.budget is None or not (plan.is_judged and plan.warned):
            return False
        return bool(self._plain_within(plan))


def look(
    name: str, text: str, budgets: Iterable[float | None] = BUDGETS, *, plain: bool = True
) -> Audit:
    """The audit of one scene."""
    loaded = load("scene.yaml", text=text)
    piece = loaded.piece
    assert piece is not None, f"{name}: {[one.message for one in loaded.diagnostics]}"
    built = [_plan_or_reason(piece, budget) for budget in budgets]
    # A pilot may play on after the end of the render.
    n_frames = prepare(piece).n_frames
    limit = n_frames + round(3.0 * THIRD * piece.rate)
    pilots = [min(_pilot(own) * piece.rate, limit) for own in built if _pilot(own) < inf]
    n_frames = max([n_frames, *map(round, pilots)])
    is_stepped = stepped.is_stepped(text)
    exact = stepped.solve(text, n_frames) if is_stepped else reference.solve(read(text), n_frames)
    plans = tuple(
        _plan(piece, budget, own, exact) for budget, own in zip(budgets, built, strict=True)
    )
    settings = _plain(piece, exact.sound, plans) if plain else ()
    return Audit(name, plans, tuple(settings))


def look_drawn(family: str, seed: int) -> Audit:
    """The audit of a random scene; it is a function of this module because a spawned process has no
    `__main__`.
    """
    return look(f"{family}-{seed}", random_text(family, seed))


def error_db(y: np.ndarray, x: np.ndarray, rate: float, seconds: float = inf) -> float:
    """The metric of plans: ‖y - x‖/‖x - mean‖ [dB] of the worst output, up to `seconds`.

    The worst of three spans, each THIRD longer than the last; a render may end earlier. Of the two
    shorter ones, one that ends less than LEAST after the first sound does not count.
    """
    if not np.isfinite(y).all():
        return inf
    n_frames = len(x) if seconds == inf else round(seconds * rate)
    moves = np.flatnonzero((x != x[0]).any(axis=1))
    least = (moves[0] if len(moves) else 0) + LEAST * rate
    worst = 0.0
    for thirds in (2, 1, 0):
        end = min(n_frames - int(thirds * THIRD * rate), len(x))
        if end < (least if thirds else 2):
            continue
        ours, theirs = y[:end], x[:end]
        apart = np.sum((ours - theirs) ** 2, axis=0)
        complete = np.sum((theirs - theirs.mean(axis=0)) ** 2, axis=0)
        # An output of a mass that friction holds has no sound to compare with: that of all counts.
        complete = np.where(complete < STILL * complete.max(), complete.max(), complete)
        output = apart > 1e-26 * np.sum(x**2, axis=0)  # else it is rounding: nothing sounds yet
        worst = max([worst, *(apart[output] / np.maximum(complete[output], 1e-300))])
    return 10.0 * log10(max(worst, 1e-30))


def _plan_or_reason(piece: Piece, budget: float | None) -> planning.PlanWithNotes | str:
    """The plan of a piece, or why there is none."""
    ready = prepare(piece)
    try:
        return planning.make_plan(ready.network, ready.timeline, Accuracy(error=budget))
    except (_core.EngineError, StageError) as error:
        return f"{type(error).__name__}: {error}"


def _pilot(built: planning.PlanWithNotes | str) -> float:
    """How long the pilots of a plan played [s]."""
    rows = [] if isinstance(built, str) else built.plan.rows()
    return max((row.error_s for row in rows if row.error_s is not None), default=inf)


def _plan(
    piece: Piece,
    budget: float | None,
    built: planning.PlanWithNotes | str,
    exact: reference.Reference,
) -> Plan:
    if isinstance(built, str):
        return Plan(budget, refused=built)
    try:
        scene = prepare(piece)
        static = planning.make_plan(
            scene.network, scene.timeline, built.accuracy, _uncounted(built.plan)
        )
        sound, counted = _play(scene, built.plan, len(exact.sound))
    except (_core.EngineError, StageError) as error:
        return Plan(budget, refused=f"{type(error).__name__}: {error}")
    rows = built.plan.rows()
    # Each row of an island gives the error of the whole island, so it counts once.
    islands = {(row.error_db, row.error_s) for row in rows}
    errors = [db for db, _ in islands if db is not None]
    # An error is that of what is left out too.
    left_out = [
        row.left_out_db for row in rows if row.error_db is None and row.left_out_db is not None
    ]
    is_unknown = any(planning.needs_trial(row) and row.error_db is None for row in rows if row.cost)
    stated = [inf] if is_unknown else [*errors, *left_out]
    pilot = _pilot(built)
    is_chaotic = any(row.spectral_db is not None for row in rows)
    listened = exact.sound
    if budget is BY_EAR and not errors and exact.audible is not None:
        # Everything is computed by modes, and such a plan leaves out modes above hearing.
        listened = exact.audible
    return Plan(
        budget,
        stated=max(10.0 * log10(sum(10.0 ** (db / 10.0) for db in [*stated, FLOOR_DB])), FLOOR_DB),
        real=error_db(sound, listened, piece.rate, pilot),
        render_error=error_db(sound, listened, piece.rate),
        doubt=error_db(exact.rough, exact.sound, piece.rate, pilot),
        pilot=pilot,
        cost=planning.plan_cost(static.plan) + counted * piece.rate,
        warned=bool(built.notes),
        chaotic=is_chaotic,
        spectrum=_unlike(sound, exact, piece.rate) if is_chaotic else 0.0,
        audible=_audible(sound, listened, piece.rate, pilot) if budget is BY_EAR else inf,
        how=", ".join(f"{row.what} ×{row.oversampling}" for row in rows if row.cost),
    )


def _audible(sound: np.ndarray, exact: np.ndarray, rate: float, seconds: float) -> float:
    """What is heard of the difference over `seconds`, over what is allowed."""
    n_frames = len(exact) if seconds == inf else min(round(seconds * rate), len(exact))
    return hearing.errors(sound[:n_frames], exact[:n_frames], rate).excess


def _unlike(sound: np.ndarray, exact: reference.Reference, rate: float) -> float:
    ours, known = (metrics.bands_db(own, exact.sound, rate) for own in (sound, exact.rough))
    return ours - known


def _plain(piece: Piece, exact: np.ndarray, plans: Sequence[Plan]) -> Iterator[Plain]:
    pilots = [plan.pilot for plan in plans]
    by_ear = [plan.pilot for plan in plans if plan.budget is BY_EAR]
    for method, times in PLAIN:
        scene = OversampledScene.from_scene(Score(piece), times)
        try:
            plan = _core.Plan(scene.network, scene.timeline, method=method)
            pins = _uncounted(plan)
            static = _core.Plan(scene.network, scene.timeline, method=method, pins=pins)
            finer, counted = _play(scene, plan, times * len(exact))
            sound = finer[::times].copy()
            scene.derivatives().process(sound)
        except (_core.EngineError, StageError):
            continue
        reals = tuple(error_db(sound[: len(exact)], exact, piece.rate, own) for own in pilots)
        cost = planning.plan_cost(static) + counted * times * piece.rate
        audible = [_audible(sound[: len(exact)], exact, piece.rate, pilot) for pilot in by_ear]
        yield Plain(method, times, reals, cost, max(audible, default=inf))


def _uncounted(plan: _core.Plan) -> list[_core.IslandChoice]:
    """The choices of a plan without what its trials counted."""
    return [own._replace(counted_cost=0) for own in plan.choices()]


def _play(
    scene: PreparedPiece | NetworkAndTimeline, plan: _core.Plan, n_frames: int
) -> tuple[np.ndarray, float]:
    """The sound of a plan, and its work that depends on the motion [s a frame]."""
    simulation = _core.Simulation(scene.network, scene.timeline, plan=plan)
    sound = np.empty((n_frames, simulation.n_out))
    simulation.process(sound)
    return sound, simulation.counted_work() / n_frames
