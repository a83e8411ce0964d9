"""Error against cost: a scene by many methods, at each oversampling and in each precision."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, isnan, log10, nan
from statistics import median
from typing import Literal, Protocol

import numpy as np

from ergon import _core
from ergon.common.errors import ErgonError
from ergon.scores.staging.refusals import StageError
from ergon.workshop.lab import canonical, runs
from ergon.workshop.lab.energy import ROUNDING_DB, drift, production_db
from ergon.workshop.lab.metrics import (
    Floats,
    bands_db,
    early_db,
    onset_frame,
    spectral_difference,
    waveform_db,
)
from ergon.workshop.lab.names import Metric
from ergon.workshop.lab.partials import Partial, compare, strongest_partials
from ergon.workshop.lab.reference import Reference, find_doubts, oversamplings, refine
from ergon.workshop.lab.runs import Run, Setting
from ergon.workshop.lab.scene import Scene

TIMING_ROUNDS = 3  # timed, after one that warms up and makes the sound
_N_LEDGER_READINGS = 20  # into the ledger, to see a drift
_REFERENCE_DOUBLINGS = 2  # of the reference, beyond all that is charted
# A plan for this error becomes the reference where its own error is smaller than that of any fixed
# method, because a reference must be finer than the planner's choices that it judges.
_EXACT_PLAN = Setting(None, budget_db=-120.0)
_YARDSTICK_MASSES = 100  # masses of a string, for a second: some 10 ms
_TIMING_RATIO_MAX = 1.1  # between two timings of the same work
_SAME_SOUND_RATIO = (
    1e-10  # of the largest sample: so little differ sounds of one motion, in their last bits
)
# What an energy error counts: all energy, or only what links made where there is no ledger.
EnergyCount = Literal["", "all", "links"]
Progress = Callable[[int], None]


class SilentPieceError(ErgonError):
    """The piece makes no sound that can be compared."""


@dataclass(frozen=True, slots=True)
class Point:
    """One setting: its cost [s of one core per s of sound] and its errors.

    None means not measured. `t60` [%] and `cents` are the worst among the strongest partials;
    `bands_db` is of third octaves; `energy_db` is energy made by the scheme over energy given,
    `drift_db_s` its trend, and `energy_of` what is counted: without a ledger only what contacts and
    laws made is known, not what they took too much. `is_bounded`: in the metric of the chart the
    error is below that of the reference (of energy: below rounding), so that only this bound is
    known.
    """

    setting: Setting
    status: Literal["ok", "refused", "diverged"] = "ok"
    reason: str = ""
    cost: float | None = None
    waveform_db: float | None = None
    early_db: float | None = None
    spectral_db: float | None = None
    convergence: float | None = None
    bands_db: float | None = None
    cents: float | None = None
    t60: float | None = None
    energy_db: float | None = None
    drift_db_s: float | None = None
    energy_of: EnergyCount = ""
    on_front: bool = False
    is_bounded: bool = False

    def error(self, metric: Metric) -> float | None:
        """The error in a metric; smaller is better."""
        return {
            "waveform": self.waveform_db,
            "spectral": self.spectral_db,
            "cents": self.cents,
            "energy": self.energy_db,
        }[metric]


@dataclass(frozen=True, slots=True)
class Chart:
    """All points of a scene, and the reference against which they were measured.

    `floor` is the reference's own error in the metric, and rounding for energy, whose true error is
    0: smaller errors cannot be distinguished. `doubts` name methods that converge to another sound.
    `identical_methods` are groups of methods whose samples are the same wherever both ran: each is
    one curve.
    """

    points: list[Point]
    reference: Reference | None
    floor: float | None
    metric: Metric
    seconds: float
    rate: float
    doubts: tuple[str, ...] = ()
    identical_methods: tuple[tuple[str, ...], ...] = ()


@dataclass(slots=True)
class _Runner:
    """Runs in progress, and the number of frames computed."""

    scene: Scene
    n_frames: int
    progress: Progress
    finished: dict[Setting, Run] = field(default_factory=dict)
    failures: dict[Setting, Point] = field(default_factory=dict)
    sounds: dict[Setting, Floats] = field(default_factory=dict)
    n_frames_done: int = 0

    def start(self, setting: Setting) -> Run | None:
        try:
            return runs.start(self.scene, setting)
        except (_core.EngineError, StageError) as error:
            self.failures[setting] = Point(setting, "refused", _sentence(error))
            return None

    def play(self, setting: Setting, run: Run) -> Floats | None:
        try:
            frames = run.frames(self.n_frames)
        except _core.DivergedError as error:
            self.failures[setting] = Point(setting, "diverged", _sentence(error))
            return None
        self.n_frames_done += self.n_frames * setting.oversampling
        self.progress(self.n_frames_done)
        return frames

    def sound(self, setting: Setting) -> Floats | None:
        run = self.start(setting)
        frames = None if run is None else self.play(setting, run)
        return None if frames is None else self.scene.to_sound(frames)


def _sentence(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def settings(methods: Sequence[str], precisions: Sequence[str], upto: int) -> list[Setting]:
    """Every method at every oversampling up to `upto` in every precision."""
    return [Setting(m, s, p) for m in methods for s in oversamplings(upto) for p in precisions]


def planner_settings(budget_db: float | None = None) -> list[Setting]:
    """Settings of the planner: by ear and, if `budget_db` is given, for that error."""
    ear_setting = Setting(None)
    return [ear_setting] if budget_db is None else [ear_setting, Setting(None, budget_db=budget_db)]


def n_frames_to_compute(settings_to_run: Sequence[Setting], n_frames: int) -> int:
    """Frames to compute for a chart, for the display of progress."""
    oversampling_max = max(setting.oversampling for setting in settings_to_run)
    reference_oversampling = sum(oversampling_max << i for i in range(1, _REFERENCE_DOUBLINGS + 1))
    return n_frames * (
        (TIMING_ROUNDS + 1) * sum(setting.oversampling for setting in settings_to_run)
        + reference_oversampling
    )


@dataclass(frozen=True, slots=True)
class PlayedSetting:
    """A setting that was played: its sound (n_frames, n_channels), or None with the reason in the
    point.
    """

    point: Point
    sound: Floats | None


class Players(Protocol):
    """Plays settings elsewhere, such as on a cluster."""

    def play_settings(
        self, wanted_settings: Sequence[Setting], n_frames: int, *, has_energy: bool
    ) -> Iterator[PlayedSetting]:
        """Each setting, in any order, with its cost and, with `has_energy`, its energy errors."""


def measure(
    scene: Scene,
    settings_to_run: Sequence[Setting],
    duration: float,
    metric: Metric,
    progress: Progress,
    players: Players | None = None,
) -> Chart:
    """Run and compare every setting, by `players` if they are given.

    Raises SilentPieceError if there is no sound.
    """
    runner = _Runner(scene, max(2, round(duration * scene.rate)), progress)
    has_energy = metric == "energy"
    if players is None:
        played_settings = _play_settings(runner, settings_to_run, has_energy=has_energy)
    else:
        played_settings = _play_with(players, runner, settings_to_run, has_energy=has_energy)
    sound_by_setting = {
        result.point.setting: result.sound for result in played_settings if result.sound is not None
    }
    sounds = dict(sound_by_setting)
    has_plans = any(setting.method is None for setting in settings_to_run)
    rival = _EXACT_PLAN if has_plans else None
    reference = refine(sounds, runner.sound, doublings=_REFERENCE_DOUBLINGS, rival=rival)
    points = _with_ledger_of_ca([each.point for each in played_settings], sound_by_setting)
    floor = None
    doubts_of_methods: tuple[str, ...] = ()
    if reference is not None:
        doubts_of_methods = tuple(find_doubts(sounds, reference))
        if onset_frame(reference.sound) is None:
            raise SilentPieceError(f"nothing sounds in the first {duration:g} s")
        error_meter = ErrorMeter(reference, scene.rate)
        points = [
            error_meter.with_errors(point, sound_by_setting[point.setting])
            if point.setting in sound_by_setting
            else point
            for point in points
        ]
        floor = error_meter.floor(metric)
    alike = _identical_methods(sounds)
    final_points = _with_front(points, metric, floor, alike)
    return Chart(
        final_points, reference, floor, metric, duration, scene.rate, doubts_of_methods, alike
    )


def _play_settings(
    runner: _Runner, settings_to_run: Sequence[Setting], *, has_energy: bool
) -> list[PlayedSetting]:
    """All settings, in order. Their costs are those of interleaved rounds."""
    for setting in settings_to_run:
        run = runner.start(setting)
        frames = None if run is None else runner.play(setting, run)
        if run is not None and frames is not None:
            runner.finished[setting] = run
            runner.sounds[setting] = runner.scene.to_sound(frames)
    costs = _costs(runner)
    # `refine` may add failures of settings that were not asked for; these are not failures of the
    # chart.
    played_by_setting = {
        setting: PlayedSetting(point, None) for setting, point in runner.failures.items()
    }
    for setting, run in runner.finished.items():
        point = Point(setting, "ok", run.plan_text, costs[setting])
        if has_energy:
            point = _with_energy(runner, point)
        played_by_setting[setting] = PlayedSetting(point, runner.sounds[setting])
    return [played_by_setting[setting] for setting in settings_to_run]


def _play_with(
    players: Players, runner: _Runner, settings_to_run: Sequence[Setting], *, has_energy: bool
) -> list[PlayedSetting]:
    """All settings, in order, played by `players`."""
    played_by_setting = {}
    for played_setting in players.play_settings(
        settings_to_run, runner.n_frames, has_energy=has_energy
    ):
        played_by_setting[played_setting.point.setting] = played_setting
        runner.n_frames_done += (
            (TIMING_ROUNDS + 1) * runner.n_frames * played_setting.point.setting.oversampling
        )
        runner.progress(runner.n_frames_done)
    return [played_by_setting[setting] for setting in settings_to_run]


def play_beside_yardstick(
    scene: Scene, setting: Setting, n_frames: int, *, has_energy: bool
) -> tuple[PlayedSetting, float]:
    """A setting played alone, and the time of the yardstick in rounds between its own [s].

    The cost of the point is in seconds of this machine.
    """
    runner = _Runner(scene, n_frames, lambda done: None)
    run = runner.start(setting)
    frames = None if run is None else runner.play(setting, run)
    if run is None or frames is None:
        return PlayedSetting(runner.failures[setting], None), nan
    run_times, yardstick_times = [], []
    for _ in range(TIMING_ROUNDS):
        yardstick_times.append(yardstick())
        run.rewind()
        runner.play(setting, run)
        run_times.append(run.cpu_time)
    point = Point(setting, "ok", run.plan_text, median(run_times) * scene.rate / n_frames)
    if has_energy:
        point = _with_energy(runner, point)
    return PlayedSetting(point, scene.to_sound(frames)), median(yardstick_times)


def yardstick() -> float:
    """The time of a fixed piece of work on this processor [s]."""
    run = runs.start(canonical.string(_YARDSTICK_MASSES, canonical.RATE), Setting("ca"))
    run.frames(round(canonical.RATE))
    return run.cpu_time


def _identical_methods(sounds: Mapping[Setting, Floats]) -> tuple[tuple[str, ...], ...]:
    """Groups of methods whose sounds are the same, wherever both were computed."""
    sounds_by_method: dict[str, dict[Setting, Floats]] = {}
    for setting, sound in sounds.items():
        if setting.method is not None:
            sounds_by_method.setdefault(setting.method, {})[replace(setting, method=None)] = sound
    groups: list[list[str]] = []
    for method, settings in sounds_by_method.items():
        for group in groups:
            group_settings = sounds_by_method[group[0]]
            common_settings = settings.keys() & group_settings.keys()
            if common_settings and all(
                np.array_equal(settings[setting], group_settings[setting])
                for setting in common_settings
            ):
                group.append(method)
                break
        else:
            groups.append([method])
    return tuple(tuple(group) for group in groups if len(group) > 1)


def _costs(runner: _Runner) -> dict[Setting, float]:
    """Medians of interleaved rounds, so that other load on the machine slows all settings alike."""
    times_by_setting: dict[Setting, list[float]] = {setting: [] for setting in runner.finished}
    for _ in range(TIMING_ROUNDS):
        for setting, run in runner.finished.items():
            run.rewind()
            runner.play(setting, run)
            times_by_setting[setting].append(run.cpu_time)
    duration = runner.n_frames / runner.scene.rate
    return {setting: median(times) / duration for setting, times in times_by_setting.items()}


def _with_energy(runner: _Runner, point: Point) -> Point:
    """The point with the energy errors from its ledger, or from the accounts of contacts and laws
    if the method keeps none.
    """
    if point.status != "ok":
        return point
    frame_edges = np.linspace(0, runner.n_frames, _N_LEDGER_READINGS + 1).astype(int)
    try:
        run = runs.start(runner.scene, point.setting, ledger=True)
        ledgers = []
        for n_frames in np.diff(frame_edges):
            run.frames(int(n_frames))
            ledgers.append(run.energy())
    except _core.EngineError:
        run = runs.start(runner.scene, point.setting)
        run.frames(runner.n_frames)
        return replace(point, energy_db=run.created_db(), energy_of="links")
    times = [float(edge) / runner.scene.rate for edge in frame_edges[1:]]
    energy_drift = drift(times, ledgers)
    return replace(
        point,
        energy_db=production_db(ledgers[-1]),
        drift_db_s=energy_drift.db_per_second,
        energy_of="all",
    )


def _with_ledger_of_ca(points: list[Point], sounds: Mapping[Setting, Floats]) -> list[Point]:
    """The points; a plan that moves as CA does, to rounding, has the energy errors of CA's ledger.

    A plan keeps no ledger, and steps the most of a piece by CA.
    """
    ca_by_oversampling = {
        point.setting.oversampling: point
        for point in points
        if point.setting.method == "ca" and point.setting.precision == "f64"
    }

    def with_ledger(point: Point) -> Point:
        twin = ca_by_oversampling.get(point.setting.oversampling)
        if point.energy_of != "links" or twin is None or twin.energy_of != "all":
            return point
        sound, twin_sound = sounds.get(point.setting), sounds.get(twin.setting)
        if sound is None or twin_sound is None or not _is_same_motion(sound, twin_sound):
            return point
        return replace(point, energy_db=twin.energy_db, drift_db_s=twin.drift_db_s, energy_of="all")

    return [with_ledger(point) for point in points]


def _is_same_motion(y: Floats, x: Floats) -> bool:
    """Whether two sounds differ in last bits alone."""
    return bool(np.abs(y - x).max(initial=0.0) <= _SAME_SOUND_RATIO * np.abs(x).max(initial=0.0))


class ErrorMeter:
    """Measures sounds against a reference."""

    def __init__(self, reference: Reference, rate: float) -> None:
        """Find where the reference sounds, and its strongest partials, in its loudest channel."""
        self.reference, self.rate = reference, rate
        x = reference.sound
        self._channel = int(np.argmax(np.sum(x**2, axis=0)))
        self._onset = onset_frame(x) or 0
        self._partials = strongest_partials(x[self._onset :, self._channel], rate)

    def with_errors(self, point: Point, sound: Floats) -> Point:
        """The point with all its errors."""
        reference_sound = self.reference.sound
        spectral_result = spectral_difference(sound, reference_sound)
        partials = self._compared_partials(sound)
        t60_errors = [
            abs(partial.t60_ratio - 1.0) for partial in partials if not isnan(partial.t60_ratio)
        ]
        return replace(
            point,
            waveform_db=waveform_db(sound, reference_sound),
            early_db=early_db(sound, reference_sound, self.rate),
            spectral_db=spectral_result.difference,
            convergence=spectral_result.convergence,
            bands_db=bands_db(sound, reference_sound, self.rate),
            cents=max((abs(partial.cents) for partial in partials), default=None),
            t60=100.0 * max(t60_errors) if t60_errors else None,
        )

    def floor(self, metric: Metric) -> float | None:
        """The reference's own error in the metric."""
        if metric == "waveform":
            return self.reference.floor_db
        if metric == "energy":
            return ROUNDING_DB
        error_before = self.with_errors(
            Point(self.reference.setting), self.reference.coarser_sound
        ).error(metric)
        return None if error_before is None else error_before * self.reference.error_ratio

    def _compared_partials(self, y: Floats) -> list[Partial]:
        span = slice(self._onset, None), self._channel
        x, y = self.reference.sound[span], y[span]
        compared = (compare(y, x, f, self.rate) for f in self._partials)
        return [partial for partial in compared if partial is not None]


def _with_front(
    points: list[Point], metric: Metric, floor: float | None, alike: Sequence[Sequence[str]] = ()
) -> list[Point]:
    front = set(_pareto_front(points, metric, floor, alike))

    def is_bounded(point: Point) -> bool:
        error = point.error(metric)
        return floor is not None and error is not None and error < floor

    return [
        replace(point, on_front=point.setting in front, is_bounded=is_bounded(point))
        for point in points
    ]


def _pareto_front(
    points: list[Point], metric: Metric, floor: float | None, alike: Sequence[Sequence[str]] = ()
) -> Iterator[Setting]:
    """Settings that no other setting of about the same cost beats in error; all errors below the
    floor are equal.

    Costs that differ by no more than the scatter of timings are equal: then the smaller error
    counts, and of equal errors the first point. The first of methods that are alike stands for
    all.
    """
    duplicates = {method for group in alike for method in group[1:]}
    candidates = [
        (point.cost, error if floor is None else max(error, floor), point_index, point.setting)
        for point_index, point in enumerate(points)
        if point.setting.method not in (None, *duplicates)
        and point.cost is not None
        and (error := point.error(metric)) is not None
    ]
    for cost, error, point_index, setting in sorted(candidates, key=lambda ranked: ranked[:3]):
        rivals = (
            candidate
            for candidate in candidates
            if candidate[0] <= cost * _TIMING_RATIO_MAX and candidate[1:3] != (error, point_index)
        )
        if not any(
            rival_error < error
            or (
                rival_error == error
                and (rival_cost < cost / _TIMING_RATIO_MAX or rival_index < point_index)
            )
            for rival_cost, rival_error, rival_index, _ in rivals
        ):
            yield setting


def likely_cost(chart: Chart, point: Point) -> float | None:
    """The cost of a point, measured or estimated: a run that failed costs S times the highest cost
    per oversampling of its method.
    """
    if point.cost is not None:
        return point.cost
    points_of_method = [
        p for p in chart.points if p.setting.method == point.setting.method and p.cost
    ]
    points_with_cost = points_of_method or [p for p in chart.points if p.cost]
    if not points_with_cost:
        return None
    costs_per_step = [p.cost / p.setting.oversampling for p in points_with_cost if p.cost]
    return max(costs_per_step) * point.setting.oversampling


def slope(chart: Chart, method: str) -> float | None:
    """Decades of error per decade of step, from the waveform of one method above the floor."""
    floor = -300.0 if chart.reference is None else chart.reference.floor_db + 6.0
    rows = [
        (log10(p.setting.oversampling), p.waveform_db / 20.0)
        for p in chart.points
        if p.setting.method == method and p.setting.precision == "f64" and p.waveform_db is not None
        if isfinite(p.waveform_db) and floor < p.waveform_db < -6.0
    ]
    if len(rows) < 2:
        return None
    log_oversampling, log_errors = zip(*rows, strict=True)
    return -float(np.polyfit(log_oversampling, log_errors, 1)[0])
