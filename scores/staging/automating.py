"""Turns `automation:` into points in time through which the engine moves parameters.

Which parameters may move is decided by `scores/reading/automatable.py`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from ergon import _core
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.shifted import NEVER, ShiftedTempoMap, StoppedTempoMap
from ergon.notation.text.errors import Collector, TextError
from ergon.notation.text.values import Place
from ergon.scores.pattern.search import first_from, n_before
from ergon.scores.reading.automatable import moved
from ergon.scores.reading.automation import Automation, Shape, Swing
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.parameter_values import Led, Points, Where

# Time in which a value set by a pattern is reached [s]: a jump would click.
GLIDE = 0.02
MAX_POINTS = 200_000
GRID = _core.GRID  # frames between the instants of the engine's points
# How many places of its pattern are searched backward for the value that holds at a beat.
_BACK = 256
# A swing is approximated by straight segments, sixteen in each quarter: sin(j π / 32).
_QUARTER = (
    *(0.0, 0.0980171403295606, 0.19509032201612825, 0.29028467725446233, 0.3826834323650898),
    *(0.47139673682599764, 0.5555702330196022, 0.6343932841636455, 0.7071067811865475),
    *(0.773010453362737, 0.8314696123025452, 0.8819212643483549, 0.9238795325112867),
    *(0.9569403357322089, 0.9807852804032304, 0.9951847266721968, 1.0),
)
_HALF = (*_QUARTER[:-1], *reversed(_QUARTER))
_SINE = (*_HALF[:-1], *(0.0 - x for x in _HALF))
_PIECES = len(_SINE) - 1
# The largest number of positions on the engine's grid at which a glide has points of its own.
_PLACES = 1_024


@dataclass(slots=True)
class _Curve:
    """A parameter over time: rising instants [s] and values; constant before the first and after
    the last.
    """

    own: float
    t: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    within: set[float] = field(default_factory=set)  # instants inside glides

    def to(self, instant: float, value: float) -> None:
        """Add a value, reached linearly from the last point."""
        self.t.append(max(instant, self.t[-1]) if self.t else instant)
        self.x.append(value)

    def set(self, instant: float, value: float, stop: float = math.inf) -> None:
        """Set a value from an instant on; it is reached within GLIDE, or by `stop`."""
        self.to(instant, self.x[-1] if self.x else self.own)
        self.to(min(instant + GLIDE, stop), value)

    def at(self, instant: float) -> float:
        """The value at an instant."""
        after = bisect_right(self.t, instant)
        if after in (0, len(self.t)):
            return self.x[0 if after == 0 else -1] if self.x else self.own
        begin, end = self.t[after - 1], self.t[after]
        share = (instant - begin) / (end - begin)
        return self.x[after - 1] + (self.x[after] - self.x[after - 1]) * share


def automation_points(
    piece: Piece, since: float, until: float, collector: Collector
) -> dict[Where, Points]:
    """The points of each automated module, for the beats from `since` to `until`."""
    lines: dict[Where, dict[str, list[Automation]]] = {}
    places: dict[str, Place] = {}  # where the first automation of each part is written
    for one in (*piece.automation, *_notes(piece)):
        where = one.target.part, one.target.module
        places.setdefault(one.target.part, one.place)
        lines.setdefault(where, {}).setdefault(one.parameter, []).append(one)
    wholes: dict[str, _Curve] = {}
    for where in [*lines]:
        led = Led.of(piece, where)
        if led is None:
            del lines[where]  # a gesture is rehearsed without instruments
        elif led.module.kind == "INSTRUMENT":
            own = lines.pop(where)["f"]
            wholes[where[0]] = _curve(piece, own, led.own["f"], since, until, collector)
            for module in moved(piece.instruments[where[0]]):
                lines.setdefault((where[0], module.name), {})
    found: dict[Where, Points] = {}
    for where, parameters in lines.items():
        led = Led.of(piece, where)
        assert led is not None
        curves = {
            name: _curve(piece, some, led.own[name], since, until, collector)
            for name, some in parameters.items()
        }
        whole = wholes.get(where[0])
        if whole is not None and led.module not in moved(piece.instruments[where[0]]):
            whole = None
        made = _points(led, curves, whole)
        if led.cost * len(made) > MAX_POINTS:
            message = f"automation: a {led.module.kind} changes more than {MAX_POINTS:,} times"
            collector.error("E105", message, places[where[0]])
        elif made:
            found[where] = made
    return found


def _points(led: Led, curves: Mapping[str, _Curve], whole: _Curve | None) -> Points:
    """The points of a module with automated parameters, which may also follow the automation of a
    `whole` instrument.
    """
    all_curves = [*curves.values(), *([] if whole is None else [whole])]
    known: dict[tuple[float, ...], tuple[float, ...]] = {}
    points = []
    for t in sorted({t for curve in all_curves for t in curve.t}):
        values = tuple(curve.at(t) for curve in all_curves)
        if values not in known:  # a swing has the same values in every period
            numbers = led.numbers(dict(zip(curves, values, strict=False)))
            if whole is not None:
                numbers = led.transposed(numbers, values[-1] / whole.own)
            known[values] = numbers
        points.append((max(0.0, t), *known[values]))
    within = set().union(*(curve.within for curve in all_curves))
    return _chords(points, within) if within else points


def _chords(points: Points, within: Container[float]) -> Points:
    """Points moved so that their chords have the same means as the curve through them, to fourth
    order.

    The engine interpolates linearly, and a pitch that is slightly too high all the way would end
    with a wrong phase.
    """
    made = list(points)
    for at in range(1, len(points) - 1):
        (before, *low), (here, *own), (after, *high) = points[at - 1 : at + 2]
        if here in within and abs((here - before) - (after - here)) < 1e-9:
            bends = (a - 2.0 * x + b for a, x, b in zip(low, own, high, strict=True))
            made[at] = (here, *(x - bend / 12.0 for x, bend in zip(own, bends, strict=True)))
    return made


def value_on(piece: Piece, where: Where, parameter: str, beat: float) -> float:
    """The value of a parameter on a beat, with automation applied."""
    led = Led.of(piece, where)
    assert led is not None
    lines = [
        one
        for one in piece.automation
        if (one.target.part, one.target.module) == where and one.parameter == parameter
    ]
    curve = _curve(piece, lines, led.own[parameter], beat, beat, Collector())
    return curve.at(piece.tempo_map.seconds(beat))


def _notes(piece: Piece) -> Iterator[Automation]:
    """Automation of the pitches of strikes that have notes."""
    tempo = piece.tempo_map
    for one in piece.strikes:
        if not one.notes or one.pattern is None:
            continue
        until = one.until
        if one.span is not None:
            until = Position(plus=Length(beats=tempo.after(tempo.resolve(one.at), one.span)))
        pattern = replace(one.pattern, chance=None)
        for target in one.to:
            said = (target, "f", one.at, until, one.every, one.times, pattern, one.notes)
            yield Automation(*said, None, one.place, one.place, one.who)


def complete_until(piece: Piece, until: float) -> float:
    """The instant [s] up to which points for the beats up to `until` are those of a longer piece:
    the pitch of a note behind that beat begins before its strike.
    """
    return piece.tempo_map.seconds(until) - 2 * GRID / piece.rate


def takeover_points(
    before: Mapping[Where, Points],
    after: Mapping[Where, Points],
    piece: Piece,
    start: float,
    known: float,
) -> dict[Where, Points]:
    """The points of a stage that takes over at `start` [s] from one with the points `before`.

    Points that do not change continue bit by bit; others are reached within `GLIDE`. The points
    `before` are complete up to the instant `known` [s], and compared up to there.
    """
    found: dict[Where, Points] = {}
    for where in {**before, **after}:
        led = Led.of(piece, where)
        if led is None:
            continue  # the module is gone
        own = (0.0, *led.numbers_alone)
        old, new = before.get(where) or [own], after.get(where) or [own]
        if len(old[0]) != len(new[0]):
            old = [own]  # it was a module of another kind
        if not _is_same(old, new, start, known):
            soon = start + GLIDE
            later = (point for point in new if point[0] > soon)
            new = [(start, *value_at(old, start)), (soon, *value_at(new, soon)), *later]
        if any(point[1:] != own[1:] for point in new):
            found[where] = new
    return found


def _is_same(old: Points, new: Points, start: float, known: float) -> bool:
    """Whether two sequences of points are equal from an instant on, as far as both go, and up to
    the instant `known` [s].
    """
    old_from, new_from = (
        max(0, bisect_right(points, start, key=lambda point: point[0]) - 1) for points in (old, new)
    )
    old, new = old[old_from:], new[new_from:]
    if len(old) == 1 or len(new) == 1:  # one of them is constant
        return all(point[1:] == old[0][1:] for point in (*old, *new))
    last = max(start, known)
    return all(one == other for one, other in zip(old, new, strict=False) if one[0] <= last)


def value_at(points: Points, instant: float) -> tuple[float, ...]:
    """The numbers at an instant [s], interpolated linearly."""
    after = bisect_right(points, instant, key=lambda point: point[0])
    if after in (0, len(points)):
        return points[0 if after == 0 else -1][1:]
    (begin, *low), (end, *high) = points[after - 1], points[after]
    share = (instant - begin) / (end - begin)
    return tuple(a + (b - a) * share for a, b in zip(low, high, strict=True))


def _curve(
    piece: Piece,
    lines: Sequence[Automation],
    own: float,
    since: float,
    until: float,
    collector: Collector,
) -> _Curve:
    """The curve of one parameter: its automation entries one after another, its own value in
    between.
    """
    tempo, curve, ended = piece.tempo_map, _Curve(own), -math.inf
    order = sorted(lines, key=lambda one: tempo.resolve(one.at))
    for one, following in zip(order, [*order[1:], None], strict=True):
        begin = tempo.resolve(one.at)
        if begin > until:
            break
        stop = math.inf if one.until is None else tempo.resolve(one.until)
        if following is not None:
            stop = min(stop, tempo.resolve(following.at))
        if curve.t and begin > ended + SAME:
            curve.set(tempo.seconds(ended), own, tempo.seconds(begin))
        try:
            if one.swing is not None:
                _swing(piece, one.swing, curve, (begin, stop), (since, until))
                ended = stop
            elif one.points:
                _glide(piece, one, curve, begin, stop)
                ended = stop
            else:
                ended = min(stop, _set(piece, one, curve, min(stop, until), since))
                ended = math.inf if one.struck and following is None else ended
        except TextError as error:
            collector.error("E305", f"automation of {one.name}: {error.message}", one.place)
            return curve
    if curve.t and ended <= until and tempo.seconds(ended) < NEVER:
        curve.set(tempo.seconds(ended), own)
    return curve


def _set(piece: Piece, one: Automation, curve: _Curve, stop: float, since: float) -> float:
    """Add the values of a pattern to a curve; returns the beat on which the pattern ends."""
    tempo = piece.tempo_map
    places = one.steps(tempo, piece.seed)
    course = places.course
    last = n_before(places, stop - SAME)
    first, wanted = min(last, n_before(places, since - SAME)), 2
    for _ in range(_BACK):  # the value that holds already, and the one that it comes from
        if first == 0 or wanted == 0:
            break
        first -= 1
        wanted -= course.played(first) is not None
    for place in range(first, last):
        if not place % 1024:
            _core.poll()
        name, instant = course.played(place), tempo.seconds(places[place])
        if instant >= NEVER:
            break
        if name is not None and one.struck:
            # The pitch of a note is reached one step of the grid before its strike.
            early = GRID / piece.rate
            curve.set(instant - 2 * early, one.amounts[name].value, instant - early)
        elif name is not None:
            following = tempo.seconds(places.beat(place + 1))
            curve.set(instant, one.amounts[name].of(curve.own), max(following, instant))
    return places.beat(len(places))


def _glide(piece: Piece, one: Automation, curve: _Curve, begin: float, stop: float) -> None:
    """Add a glide or a written curve up to the beat `stop`; afterwards the value stays."""
    tempo, here = piece.tempo_map, piece.tempo_map.seconds(begin)
    if isinstance(tempo, StoppedTempoMap):
        if here < NEVER:  # the value on the beat at which the piece stands
            goes = ShiftedTempoMap(tempo, 0.0)
            moving = _Curve(curve.own, [goes.seconds(begin)], [curve.at(here)])
            _glide(replace(piece, tempo_map=goes), one, moving, begin, stop)
            curve.to(here, moving.at(goes.seconds(tempo.at)))
        return
    to_path, of_path = _SCALES.get(one.parameter, (_same, _same))
    values = [to_path(point.amount.of(curve.own)) for point in one.points]
    if one.over is not None:
        began = curve.at(here)
        instants = [here, tempo.seconds(tempo.after(begin, one.over))]
        values.insert(0, to_path(began))
        ways = ["line", one.points[0].way]
    else:
        instants = [tempo.instant(begin, point.at) for point in one.points]
        ways = [point.way for point in one.points]
        if values[0] != to_path(curve.at(here)):
            curve.set(here, of_path(values[0]), instants[1] if len(instants) > 1 else math.inf)
    if any(after <= before for before, after in pairwise(instants)):
        raise TextError("the points of the curve do not rise in time at this tempo")
    path = list(zip(instants, values, ways, strict=True))
    last = min(instants[-1], tempo.seconds(stop))
    step = GRID / piece.rate
    if one.over is not None:  # it starts from the value on the grid before it
        curve.to(math.floor(here / step) * step, curve.at(here))
    first = max(curve.t[-1], here) if curve.t else here
    places = range(math.floor(first / step) + 1, math.ceil(last / step))
    if len(path) > 1 and len(places):
        stride = -(-len(places) // _PLACES)
        times = [place * step for place in places[::stride]]
        # Points near a corner are not corrected for curvature.
        near = stride * step * (1.0 + SAME)
        curve.within.update(t for t in times if all(abs(t - at) > near for at in instants))
        for t, value in zip(times, _core.path_values(path, times), strict=True):
            curve.to(t, of_path(value))
    (end,) = _core.path_values(path, [last])
    curve.to(last, of_path(end))


def _same(value: float) -> float:
    return value


def _inverse(value: float) -> float:
    return 1.0 / value


# Scales on which glides are linear: ln f for pitch, 1/t60 for damping.
_SCALES: Mapping[str, tuple[Callable[[float], float], Callable[[float], float]]] = {
    "f": (_core.ln, _core.exp),
    "t60": (_inverse, _inverse),
}


def _swing(
    piece: Piece,
    swing: Swing,
    curve: _Curve,
    span: tuple[float, float],
    window: tuple[float, float],
) -> None:
    """Add a swing to a curve, from one period before the window to its first point behind it."""
    tempo, own = piece.tempo_map, curve.own
    since, until = window
    low, high = swing.low.of(own), swing.high.of(own)
    begin, stop = span

    def beat_of(number: int) -> float:
        return tempo.after(begin, swing.period.times(number / _PIECES))

    first = 0
    if since > begin:  # bisection: the tempo may have changed
        first = max(0, first_from(beat_of, 1 << 24, since) - _PIECES)
    offset = round(swing.phase * _PIECES)
    for number in range(first, first + MAX_POINTS):
        beat, place = beat_of(number), (number + offset) % _PIECES
        if beat > stop or (instant := tempo.seconds(beat)) >= NEVER:
            break
        value = low + (high - low) * _share(swing.shape, place)
        edges = {"square": (0, _PIECES // 2), "ramp": (0,)}.get(swing.shape, ())
        if number == 0 or place in edges:
            curve.set(instant, value, tempo.seconds(beat_of(number + 1)))
        elif swing.shape != "square" or not curve.t:
            curve.to(instant, value)
        if beat > until:
            break


def _share(shape: Shape, place: int) -> float:
    """The position of a swing between its low end (0) and its high end (1), at a segment of its
    period.
    """
    if shape == "sine":
        return 0.5 + 0.5 * _SINE[place]
    if shape == "square":
        return 1.0 if place < _PIECES // 2 else 0.0
    if shape == "ramp":
        return place / _PIECES
    quarter = _PIECES // 4
    level = place if place <= quarter else 2 * quarter - place
    return 0.5 + 0.5 * (max(level, place - 4 * quarter) / quarter)
