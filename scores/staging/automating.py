"""Turns `automation:` into points in time through which the engine moves parameters.

Which parameters may move is decided by `scores/reading/automatable.py`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.shifted import NEVER
from ergon.notation.text.errors import Collector, TextError
from ergon.notation.text.values import Place
from ergon.scores.reading.automatable import transposed_modules
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.grid_points import keep_means
from ergon.scores.staging.known_automation import KnownAutomation, ModuleTracks
from ergon.scores.staging.parameter_curves import (
    GLIDE_DURATION,
    GRID_FRAMES,
    Curve,
    Entry,
    Extent,
    add_glide,
    add_pattern,
    add_swing,
)
from ergon.scores.staging.parameter_values import AutomatedModule, ModuleKey, Points
from ergon.scores.staging.past_automation import needed_entries, point_margin

MAX_POINTS = 200_000


class AutomatedPoints(NamedTuple):
    """The points of automated modules, and the modules that entries have moved for good: these stay
    automated, even if they have their own values again.
    """

    points: dict[ModuleKey, Points]
    permanent_modules: frozenset[ModuleKey] = frozenset()


def automation_points(
    piece: Piece,
    since_beat: float,
    until_beat: float,
    collector: Collector,
    begin: float = -math.inf,
    known_automation: KnownAutomation | None = None,
) -> AutomatedPoints:
    """The points of each automated module, for the beats from `since_beat` to `until_beat`; only
    those from the last one at or before the instant `begin` [s] on are needed.

    `known_automation` is what the stage before knew.
    """
    tempo, known_automation = piece.tempo_map, known_automation or KnownAutomation()
    track_by_module = known_automation.tracks(piece)
    start_beat = tempo.beats(begin) if begin > -math.inf else -math.inf
    modules: dict[ModuleKey, AutomatedModule] = {}
    points_by_module: dict[ModuleKey, Points] = {}
    tracks: dict[ModuleKey, ModuleTracks] = {}
    for module_key, track in track_by_module.items():
        target = known_automation.automated_module(piece, module_key)
        if target is None:
            continue  # a gesture is rehearsed without instruments
        modules[module_key] = target
        constant_points = known_automation.constant_points(module_key, track, target, start_beat)
        if constant_points is None:
            tracks[module_key] = track
        else:
            points_by_module[module_key] = constant_points
    if begin > -math.inf:
        all_entries = chain.from_iterable(track.entries.values() for track in tracks.values())
        begin -= point_margin(piece, all_entries, begin)
        since_beat = min(since_beat, tempo.beats(begin))
    extent = Extent(since_beat, until_beat, begin)
    moved_keys = {key for key in modules if track_by_module[key].first_move_beat < start_beat}
    instrument_pitch_curves: dict[str, Curve] = {}
    for module_key in [key for key in tracks if modules[key].module.kind == "INSTRUMENT"]:
        entries = tracks.pop(module_key).entries["f"]
        written_pitch = modules[module_key].written_values["f"]
        instrument_pitch_curves[module_key[0]] = _parameter_curve(
            piece, entries, written_pitch, extent, collector
        )
        for module in transposed_modules(piece.instruments[module_key[0]]):
            member_key = module_key[0], module.name
            tracks.setdefault(
                member_key, track_by_module.get(member_key) or ModuleTracks({}, math.inf)
            )
            if module_key in moved_keys:
                moved_keys.add(member_key)
    for module_key, track in tracks.items():
        target = modules.get(module_key) or known_automation.automated_module(piece, module_key)
        assert target is not None
        curves = {
            name: _parameter_curve(piece, group, target.written_values[name], extent, collector)
            for name, group in track.entries.items()
        }
        pitch_curve = instrument_pitch_curves.get(module_key[0])
        if pitch_curve is not None and target.module not in transposed_modules(
            piece.instruments[module_key[0]]
        ):
            pitch_curve = None
        points = _module_points(target, curves, pitch_curve, GRID_FRAMES / piece.rate)
        if target.cost * len(points) > MAX_POINTS:
            message = f"automation: a {target.module.kind} changes more than {MAX_POINTS:,} times"
            collector.error("E105", message, _automation_place(piece, module_key[0]))
        elif points:
            points_by_module[module_key] = points
            if pitch_curve is None and _is_constant(track, curves, start_beat, begin):
                points_by_module[module_key] = points[-1:]
                known_automation.keep_constant_points(
                    module_key, track, target, start_beat, points[-1:]
                )
    return AutomatedPoints(points_by_module, frozenset(moved_keys))


def _is_constant(
    tracks: ModuleTracks, curves: Mapping[str, Curve], point_beat: float, instant: float
) -> bool:
    """Whether nothing moves a module after a beat, which is at an instant [s]: the last entry of
    each parameter is over, or is a glide whose value stays.
    """
    for name, parameter_entries in tracks.entries.items():
        last_entry, curve_times = parameter_entries[-1], curves[name].instants
        has_settled = last_entry.stop_beat <= point_beat or (
            last_entry.stop_beat == math.inf and bool(last_entry.automation.points)
        )
        if (
            last_entry.begin_beat > point_beat
            or not has_settled
            or not curve_times
            or curve_times[-1] > instant
        ):
            return False
    return point_beat > -math.inf


def _automation_place(piece: Piece, instrument_name: str) -> Place:
    """Where the first automation of a part is written."""
    places_of_automation = (
        automation_entry.place
        for automation_entry in piece.automation
        if any(name == instrument_name for name, _ in automation_entry.modules)
    )
    places_of_strikes = (
        strikes.place
        for strikes in piece.strikes
        for target in strikes.to
        if strikes.moves_pitches and target.part == instrument_name
    )
    return next(chain(places_of_automation, places_of_strikes))


def _module_points(
    automated_module: AutomatedModule,
    curves: Mapping[str, Curve],
    pitch_curve: Curve | None,
    grid_step: float,
) -> Points:
    """The points of a module with automated parameters, which may also follow the pitch of its
    instrument, `pitch_curve`. The grid of the engine has steps of `grid_step` [s].
    """
    all_curves = [*curves.values(), *([] if pitch_curve is None else [pitch_curve])]
    engine_values_by_curves: dict[tuple[float, ...], tuple[float, ...]] = {}
    path_points = []
    for instant, curve_values in _curve_values(all_curves):
        if (
            curve_values not in engine_values_by_curves
        ):  # a swing has the same values in every period
            engine_values = automated_module.engine_values(
                dict(zip(curves, curve_values, strict=False))
            )
            if pitch_curve is not None:
                engine_values = automated_module.transposed(
                    engine_values, curve_values[-1] / pitch_curve.initial_value
                )
            engine_values_by_curves[curve_values] = engine_values
        path_points.append((max(0.0, instant), *engine_values_by_curves[curve_values]))
    return keep_means(
        path_points,
        set().union(*(curve.curved_instants for curve in all_curves)),
        set().union(*(curve.corner_instants for curve in all_curves)),
        grid_step,
    )


def _curve_values(curves: Sequence[Curve]) -> Iterator[tuple[float, tuple[float, ...]]]:
    """The values of curves at each instant at which one of them has a point."""
    if len(curves) == 1:
        (curve,) = curves
        return ((t, (x,)) for t, x in dict(zip(curve.instants, curve.values, strict=True)).items())
    instants = sorted({t for curve in curves for t in curve.instants})
    return ((t, tuple(curve.evaluate(t) for curve in curves)) for t in instants)


def value_on_beat(piece: Piece, module_key: ModuleKey, parameter_name: str, beat: float) -> float:
    """The value of a parameter on a beat, with automation applied."""
    automated_module = AutomatedModule.from_piece(piece, module_key)
    assert automated_module is not None
    automation_entries = [
        automation_entry
        for automation_entry in piece.automation
        if module_key in automation_entry.modules and automation_entry.parameter == parameter_name
    ]
    instant = piece.tempo_map.seconds(beat)
    point_extent = Extent(beat, beat, instant)
    track_by_module = KnownAutomation().tracks(
        replace(piece, automation=tuple(automation_entries), strikes=())
    )
    parameter_entries = (
        track_by_module[module_key].entries[parameter_name] if automation_entries else []
    )
    curve = _parameter_curve(
        piece,
        parameter_entries,
        automated_module.written_values[parameter_name],
        point_extent,
        Collector(),
    )
    return curve.evaluate(instant)


def last_complete_instant(piece: Piece, until_beat: float) -> float:
    """The instant [s] up to which points for the beats up to `until_beat` are those of a longer
    piece: the pitch of a note behind that beat begins before its strike.
    """
    return piece.tempo_map.seconds(until_beat) - 2 * GRID_FRAMES / piece.rate


def takeover_points(
    points_before: Mapping[ModuleKey, Points],
    points_after: Mapping[ModuleKey, Points],
    piece: Piece,
    start: float,
    complete_end: float,
    moved_modules: Container[ModuleKey] = (),
    known_automation: KnownAutomation | None = None,
) -> dict[ModuleKey, Points]:
    """The points of a stage that takes over at `start` [s] from one with the points
    `points_before`.

    Unchanged points continue exactly; changed ones are reached within `GLIDE_DURATION`. The points
    `points_before` are complete up to the instant `complete_end` [s], and compared up to there.
    Modules with their own values alone have no points, except those that are among `moved_modules`.
    """
    points_by_module: dict[ModuleKey, Points] = {}
    known_automation = known_automation or KnownAutomation()
    for module_key in {**points_before, **points_after}:
        if (
            constant_points := points_after.get(module_key)
        ) is not None and constant_points is points_before.get(module_key):
            has_moved = known_automation.has_moved(module_key, constant_points)
            if has_moved or (has_moved is not None and module_key in moved_modules):
                points_by_module[module_key] = constant_points
            if has_moved is not None:
                continue
        automated_module = known_automation.automated_module(piece, module_key)
        if automated_module is None:
            continue  # the module is gone
        written_point = (0.0, *automated_module.written_engine_values)
        old_points, new_points = (
            points_before.get(module_key) or [written_point],
            points_after.get(module_key) or [written_point],
        )
        if len(old_points[0]) != len(new_points[0]):
            old_points = [written_point]  # the module had another kind before
        is_same = _equal_from(old_points, new_points, start, complete_end)
        if not is_same:
            glide_stop = start + GLIDE_DURATION
            later_points = (point for point in new_points if point[0] > glide_stop)
            new_points = [
                (start, *numbers_at(old_points, start)),
                (glide_stop, *numbers_at(new_points, glide_stop)),
                *later_points,
            ]
        if (is_same and module_key in moved_modules) or any(
            point[1:] != written_point[1:] for point in new_points
        ):
            points_by_module[module_key] = new_points
    return points_by_module


def _equal_from(old_points: Points, new_points: Points, start: float, complete_end: float) -> bool:
    """Whether two sequences of points are equal from an instant on, as far as both go, and up to
    the instant `complete_end` [s].
    """
    old_start, new_start = (
        max(0, bisect_right(points, start, key=lambda point: point[0]) - 1)
        for points in (old_points, new_points)
    )
    old_points, new_points = old_points[old_start:], new_points[new_start:]
    if len(old_points) == 1 or len(new_points) == 1:  # one of them is constant
        return all(point[1:] == old_points[0][1:] for point in (*old_points, *new_points))
    last_compared = max(start, complete_end)
    return all(
        old_point == new_point
        for old_point, new_point in zip(old_points, new_points, strict=False)
        if old_point[0] <= last_compared
    )


def numbers_at(points: Points, instant: float) -> tuple[float, ...]:
    """The numbers at an instant [s], interpolated linearly."""
    index_after = bisect_right(points, instant, key=lambda point: point[0])
    if index_after in (0, len(points)):
        return points[0 if index_after == 0 else -1][1:]
    (begin, *low), (end, *high) = points[index_after - 1], points[index_after]
    fraction = (instant - begin) / (end - begin)
    return tuple(
        low_number + (high_number - low_number) * fraction
        for low_number, high_number in zip(low, high, strict=True)
    )


def _parameter_curve(
    piece: Piece,
    entries: Sequence[Entry],
    written_value: float,
    curve_extent: Extent,
    collector: Collector,
) -> Curve:
    """The curve of one parameter: its automation entries one after another, its own value in
    between.
    """
    tempo, until_beat = piece.tempo_map, curve_extent.until_beat
    first_entry, curve = needed_entries(piece, entries, written_value, curve_extent)
    end_beat = math.inf if curve.instants else -math.inf
    for index in range(first_entry, len(entries)):
        entry, entry_extent = entries[index], curve_extent
        automation_entry, begin_beat, stop_beat = entry
        if begin_beat > until_beat:
            break
        if curve.instants and begin_beat > end_beat + SAME:
            curve.add_step(tempo.seconds(end_beat), written_value, tempo.seconds(begin_beat))
        if curve_extent.begin_instant > -math.inf and index + 1 < len(
            entries
        ):  # some spans need only their end
            begin_instant = min(
                curve_extent.begin_instant, tempo.seconds(entries[index + 1].begin_beat)
            )
            entry_extent = Extent(
                min(curve_extent.since_beat, stop_beat), until_beat, begin_instant
            )
        try:
            if automation_entry.swing is not None:
                add_swing(piece, entry, curve, entry_extent)
                end_beat = stop_beat
            elif automation_entry.points:
                add_glide(piece, entry, curve, entry_extent.begin_instant)
                end_beat = stop_beat
            else:
                end_beat = min(stop_beat, add_pattern(piece, entry, curve, entry_extent))
                end_beat = (
                    math.inf
                    if automation_entry.strikes_name and index + 1 == len(entries)
                    else end_beat
                )
        except TextError as error:
            collector.error(
                "E305",
                f"automation of {automation_entry.name}: {error.message}",
                automation_entry.place,
            )
            return curve
    if curve.instants and end_beat <= until_beat and tempo.seconds(end_beat) < NEVER:
        curve.add_step(tempo.seconds(end_beat), written_value)
    return curve
