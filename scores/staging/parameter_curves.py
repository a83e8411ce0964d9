"""The curve of one parameter over time, to which automation entries are added one by line."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

from ergon import _core
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.shifted import NEVER, ShiftedTempoMap, StoppedTempoMap
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.gesture.points import Approach
from ergon.scores.pattern.search import first_index_from, n_before
from ergon.scores.pattern.steps import PlaceBeats
from ergon.scores.reading.automation import Automation, Swing, WaveShape
from ergon.scores.reading.piece import Piece

# Time in which a value set by a pattern is reached [s]: a jump would click.
GLIDE_DURATION = 0.02
GRID_FRAMES = _core.GRID  # frames between the instants of the engine's points
# How many places of its pattern are searched backward for the value that holds at a beat.
_PLACES_BACK_MAX = 256
_PLACE_STEPS = 2_000  # steps of work for a place of a pattern
_POINTS_MAX = 200_000  # points of a swing
_SEGMENTS_MAX = 1 << 24  # segments of a swing that are searched
# A swing is approximated by straight segments, sixteen in each quarter: sin(j π / 32).
_QUARTER_SINE = (
    *(0.0, 0.0980171403295606, 0.19509032201612825, 0.29028467725446233, 0.3826834323650898),
    *(0.47139673682599764, 0.5555702330196022, 0.6343932841636455, 0.7071067811865475),
    *(0.773010453362737, 0.8314696123025452, 0.8819212643483549, 0.9238795325112867),
    *(0.9569403357322089, 0.9807852804032304, 0.9951847266721968, 1.0),
)
_HALF_SINE = (*_QUARTER_SINE[:-1], *reversed(_QUARTER_SINE))
_SINE = (*_HALF_SINE[:-1], *(0.0 - x for x in _HALF_SINE))
SWING_SEGMENTS = len(_SINE) - 1  # segments of a period
# The largest number of positions on the engine's grid at which a glide has points of its own.
GLIDE_POINTS_MAX = 1_024


@dataclass(slots=True)
class Curve:
    """A parameter over time: rising instants [s] and values; constant before the first and after
    the last.
    """

    initial_value: float
    instants: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    curved_instants: set[float] = field(default_factory=set)  # instants inside glides
    corner_instants: set[float] = field(default_factory=set)  # at which glides begin, turn and end

    def add_point(self, instant: float, value: float) -> None:
        """Add a value, reached linearly from the last point."""
        self.instants.append(max(instant, self.instants[-1]) if self.instants else instant)
        self.values.append(value)

    def add_step(self, instant: float, value: float, stop: float = math.inf) -> None:
        """Set a value from an instant on; it is reached within `GLIDE_DURATION`, or by `stop`."""
        self.add_point(instant, self.values[-1] if self.values else self.initial_value)
        self.add_point(min(instant + GLIDE_DURATION, stop), value)

    def evaluate(self, instant: float) -> float:
        """The value at an instant."""
        index_after = bisect_right(self.instants, instant)
        if index_after in (0, len(self.instants)):
            return self.values[0 if index_after == 0 else -1] if self.values else self.initial_value
        begin, end = self.instants[index_after - 1], self.instants[index_after]
        fraction = (instant - begin) / (end - begin)
        return (
            self.values[index_after - 1]
            + (self.values[index_after] - self.values[index_after - 1]) * fraction
        )


class Entry(NamedTuple):
    """An automation entry that controls its parameter from `begin_beat` to `stop_beat`."""

    automation: Automation
    begin_beat: float
    stop_beat: float


class Extent(NamedTuple):
    """What of a curve is needed: the beats from `since_beat` to `until_beat`, of them the
    points from the last one at or before the instant `begin_instant` [s] on.
    """

    since_beat: float
    until_beat: float
    begin_instant: float = -math.inf


def add_pattern(piece: Piece, entry: Entry, curve: Curve, extent: Extent) -> float:
    """Add the values of a pattern to a curve; returns the beat on which the pattern ends."""
    tempo, automation = piece.tempo_map, entry.automation
    steps = automation.place_beats(tempo, piece.seed)
    places = steps.places
    first_place, stop_place = needed_places(
        steps, extent.since_beat, min(entry.stop_beat, extent.until_beat)
    )
    for place_index in range(first_place, stop_place):
        if not place_index % 1024:
            _core.poll(_PLACE_STEPS * 1024)
        value_name, instant = (places.played_name(place_index), tempo.seconds(steps[place_index]))
        if instant >= NEVER:
            break
        if value_name is not None and automation.strikes_name:
            # The pitch of a note is reached one step of the grid before its strike.
            grid_step = GRID_FRAMES / piece.rate
            curve.add_step(
                instant - 2 * grid_step, automation.amounts[value_name].value, instant - grid_step
            )
        elif value_name is not None:
            next_instant = tempo.seconds(steps.beat(place_index + 1))
            curve.add_step(
                instant,
                automation.amounts[value_name].applied_to(curve.initial_value),
                max(next_instant, instant),
            )
    return steps.beat(len(steps))


def needed_places(steps: PlaceBeats, since_beat: float, stop_beat: float) -> tuple[int, int]:
    """The places before beat `stop_beat` from the value on that holds at `since_beat` and the one
    that it comes from: the first, and the one behind the last.
    """
    stop_place = n_before(steps, stop_beat - SAME)
    first_place, n_values_missing = min(stop_place, n_before(steps, since_beat - SAME)), 2
    for _ in range(_PLACES_BACK_MAX):
        if first_place == 0 or n_values_missing == 0:
            break
        first_place -= 1
        n_values_missing -= steps.places.played_name(first_place) is not None
    return first_place, stop_place


class GlidePath(NamedTuple):
    """The points of a glide or a written curve, on the scale on which it is linear.

    It ends at the instant `last_instant` [s], which is earlier than that of its last point if the
    entry ends before.
    """

    instants: list[float]
    values: list[float]
    approaches: list[Approach]
    last_instant: float

    @property
    def is_complete(self) -> bool:
        """Whether the last point is reached: its value depends on nothing before."""
        return self.last_instant == self.instants[-1]


def glide_path(piece: Piece, entry: Entry, initial_value: float) -> GlidePath:
    """The path of an entry, for a glide without the value from which it starts. Raises TextError.

    `initial_value` is that of the parameter as written.
    """
    tempo, automation = piece.tempo_map, entry.automation
    to_scale, _ = _SCALES.get(automation.parameter, (_identity, _identity))
    values = [to_scale(point.amount.applied_to(initial_value)) for point in automation.points]
    approaches: list[Approach] = [point.way for point in automation.points]
    if automation.over is not None:
        start_instant = tempo.seconds(entry.begin_beat)
        instants = [start_instant, tempo.seconds(tempo.after(entry.begin_beat, automation.over))]
        approaches.insert(0, "line")
    else:
        instants = [tempo.instant(entry.begin_beat, point.at) for point in automation.points]
    if any(instant_after <= instant_before for instant_before, instant_after in pairwise(instants)):
        raise TextError("the points of the curve do not rise in time at this tempo")
    return GlidePath(
        instants, values, approaches, min(instants[-1], tempo.seconds(entry.stop_beat))
    )


def add_glide(piece: Piece, entry: Entry, curve: Curve, begin_instant: float = -math.inf) -> None:
    """Add a glide or a written curve up to the end of its entry; afterwards the value stays.

    Points before the last one at or before the instant `begin_instant` [s] may be left out.
    """
    tempo, automation = piece.tempo_map, entry.automation
    start_instant = tempo.seconds(entry.begin_beat)
    if isinstance(tempo, StoppedTempoMap):
        if start_instant < NEVER:  # the value on the present beat
            tempo_map = ShiftedTempoMap(tempo, 0.0)
            present_curve = Curve(
                curve.initial_value,
                [tempo_map.seconds(entry.begin_beat)],
                [curve.evaluate(start_instant)],
            )
            add_glide(replace(piece, tempo_map=tempo_map), entry, present_curve)
            curve.add_point(
                start_instant, present_curve.evaluate(tempo_map.seconds(tempo.stop_beat))
            )
        return
    to_scale, from_scale = _SCALES.get(automation.parameter, (_identity, _identity))
    instants, values, approaches, stop_instant = glide_path(piece, entry, curve.initial_value)
    old_value = curve.evaluate(start_instant)
    is_over = (
        stop_instant <= begin_instant and stop_instant > start_instant + GLIDE_DURATION
    )  # only its end is heard
    if automation.over is not None:
        values.insert(0, to_scale(old_value))
        if not is_over:  # the swing starts from the grid value before it
            step = GRID_FRAMES / piece.rate
            curve.add_point(math.floor(start_instant / step) * step, old_value)
    elif values[0] != to_scale(old_value) and not is_over:
        curve.add_step(
            start_instant, from_scale(values[0]), instants[1] if len(instants) > 1 else math.inf
        )
    path = list(zip(instants, values, approaches, strict=True))
    if len(path) > 1 and not is_over:
        times, grid_spacing = _glide_instants(piece, curve, start_instant, stop_instant)
        times = times[max(0, bisect_right(times, begin_instant) - 1) :]
        curve.corner_instants.update(instant for instant in instants if instant < stop_instant)
        curve.corner_instants.add(stop_instant)
        # Points near a corner are not corrected for curvature.
        corner_reach = grid_spacing * (1.0 + SAME)
        curve.curved_instants.update(
            grid_instant
            for grid_instant in times
            if all(abs(grid_instant - corner) > corner_reach for corner in instants)
        )
        for grid_instant, value in zip(times, _core.path_values(path, times), strict=True):
            curve.add_point(grid_instant, from_scale(value))
    (end_value,) = _core.path_values(path, [stop_instant])
    curve.add_point(stop_instant, from_scale(end_value))


def _glide_instants(
    piece: Piece, curve: Curve, start_instant: float, stop_instant: float
) -> tuple[list[float], float]:
    """The instants on the grid within a glide that have points, and the time between them [s]."""
    grid_step = GRID_FRAMES / piece.rate
    first_instant = max(curve.instants[-1], start_instant) if curve.instants else start_instant
    grid_indices = range(
        math.floor(first_instant / grid_step) + 1, math.ceil(stop_instant / grid_step)
    )
    stride = max(1, -(-len(grid_indices) // GLIDE_POINTS_MAX))
    # The end of the glide lies behind the last point, by less than a step of the grid.
    point_indices = sorted({*grid_indices[::stride], *grid_indices[-1:]})
    return [index * grid_step for index in point_indices], stride * grid_step


def _identity(value: float) -> float:
    return value


def _inverse(value: float) -> float:
    return 1.0 / value


# Scales on which glides are linear: ln f for pitch, 1/t60 for damping.
_SCALES: Mapping[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "f": (_core.ln, _core.exp),
    "t60": (_inverse, _inverse),
}


def swing_beats(tempo: TempoMap, entry: Entry, swing: Swing) -> Callable[[int], float]:
    """The beat of each point of a swing, by number: `tempo.after` the beginning, with what does not
    depend on the number computed once.
    """
    begin_beat, period = entry.begin_beat, swing.period
    if period.seconds:
        return lambda number: tempo.after(begin_beat, period.times(number / SWING_SEGMENTS))
    period_beats = period.beats
    if not period.bars:
        return lambda number: begin_beat + period_beats * (number / SWING_SEGMENTS)
    (bar, beat), n_bars, start_beat = tempo.bar_beat(begin_beat), period.bars, tempo.bars.start
    beats_in_bar = beat - 1.0

    def beat_of(point_number: int) -> float:
        n_periods = point_number / SWING_SEGMENTS
        # Nothing is added in number 0, as `after` adds no bars then.
        base_beat = (
            start_beat(bar + n_bars * n_periods) + beats_in_bar if point_number else begin_beat
        )
        return base_beat + period_beats * n_periods

    return beat_of


def n_swing_points_before(beat_of: Callable[[int], float], beat: float) -> int:
    """The number of points of a swing before a beat; bisection, for the tempo may have changed."""
    return first_index_from(beat_of, _SEGMENTS_MAX, beat)


def add_swing(piece: Piece, entry: Entry, curve: Curve, extent: Extent) -> None:
    """Add a swing to a curve, from one period before the extent to its first point behind it."""
    swing = entry.automation.swing
    assert swing is not None
    tempo, initial_value = piece.tempo_map, curve.initial_value
    low, high = swing.low.applied_to(initial_value), swing.high.applied_to(initial_value)
    beat_of = swing_beats(tempo, entry, swing)
    first_point = 0
    if extent.since_beat > entry.begin_beat:
        first_point = max(0, n_swing_points_before(beat_of, extent.since_beat) - SWING_SEGMENTS)
    phase_offset = round(swing.phase * SWING_SEGMENTS)
    edge_segments = {"square": (0, SWING_SEGMENTS // 2), "ramp": (0,)}.get(swing.shape, ())
    for number in range(first_point, first_point + _POINTS_MAX):
        point_beat, segment_index = (beat_of(number), (number + phase_offset) % SWING_SEGMENTS)
        if point_beat > entry.stop_beat or (instant := tempo.seconds(point_beat)) >= NEVER:
            break
        swing_value = low + (high - low) * _swing_fraction(swing.shape, segment_index)
        if number == 0 or segment_index in edge_segments:
            curve.add_step(instant, swing_value, tempo.seconds(beat_of(number + 1)))
        elif swing.shape != "square" or not curve.instants:
            curve.add_point(instant, swing_value)
        if point_beat > extent.until_beat:
            break


def _swing_fraction(swing_shape: WaveShape, segment_index: int) -> float:
    """The position of a swing between its low end (0) and its high end (1), at a segment of its
    period.
    """
    if swing_shape == "sine":
        return 0.5 + 0.5 * _SINE[segment_index]
    if swing_shape == "square":
        return 1.0 if segment_index < SWING_SEGMENTS // 2 else 0.0
    if swing_shape == "ramp":
        return segment_index / SWING_SEGMENTS
    quarter = SWING_SEGMENTS // 4
    level = segment_index if segment_index <= quarter else 2 * quarter - segment_index
    return 0.5 + 0.5 * (max(level, segment_index - 4 * quarter) / quarter)
