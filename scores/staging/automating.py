"""From `automation:` to points through which the engine leads the parameters of CELs."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ergon import _core
from ergon.instruments.model import Module
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, Position
from ergon.notation.clock.shifted import NEVER
from ergon.notation.text.errors import Collector, TextError
from ergon.scores.reading.automation import Automation, Shape, Swing
from ergon.scores.reading.piece import Piece
from ergon.scores.staging.gliding import LN_1000, TWO_PI, ties

Where = tuple[str, str]  # a part and one of its modules
Point = tuple[float, float, float, float]  # an instant [s], K [N/m], Z [N·s/m], M [kg]
Points = Sequence[Point]

# A value that a pattern sets is reached in this time [s]: a jump would click.
GLIDE = 0.02
MAX_POINTS = 200_000
# How far back the value that holds at a beat is looked for, in places of its pattern.
_BACK = 256
# The pitch of a note is there so many frames before its strike: a place of the engine's grid.
_EARLY = 64
# A swing is drawn by straight pieces, sixteen in each quarter: sin(j π / 32).
_QUARTER = (
    *(0.0, 0.0980171403295606, 0.19509032201612825, 0.29028467725446233, 0.3826834323650898),
    *(0.47139673682599764, 0.5555702330196022, 0.6343932841636455, 0.7071067811865475),
    *(0.773010453362737, 0.8314696123025452, 0.8819212643483549, 0.9238795325112867),
    *(0.9569403357322089, 0.9807852804032304, 0.9951847266721968, 1.0),
)
_HALF = (*_QUARTER[:-1], *reversed(_QUARTER))
_SINE = (*_HALF[:-1], *(0.0 - x for x in _HALF))
_PIECES = len(_SINE) - 1
_FOR_EVER = 1e9  # the t60 of what does not fade [s]
_FOR_EVER = 1e9  # the t60 of what does not fade [s]


@dataclass(slots=True)
class _Curve:
    """A parameter over time: instants [s], rising, and values; it stays before and after them."""

    own: float
    t: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)

    def to(self, instant: float, value: float) -> None:
        """Go on to a value, evenly from the last point."""
        self.t.append(max(instant, self.t[-1]) if self.t else instant)
        self.x.append(value)

    def set(self, instant: float, value: float, stop: float = math.inf) -> None:
        """Set a value from an instant on, reached soon after, or by `stop`."""
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


def automated(
    piece: Piece, since: float, until: float, collector: Collector
) -> dict[Where, Points]:
    """The points of each CEL with automation, for the beats from `since` to `until`."""
    lines: dict[Where, dict[str, list[Automation]]] = {}
    for one in (*piece.automation, *_notes(piece)):
        where = one.target.part, one.target.module
        lines.setdefault(where, {}).setdefault(one.parameter, []).append(one)
    found: dict[Where, Points] = {}
    for where, parameters in lines.items():
        cell = _module(piece, where)
        if cell is None:
            continue  # a gesture is rehearsed without instruments
        module, scale = cell
        own = _own(module)
        curves = {
            name: _curve(piece, some, own[name], since, until, collector)
            for name, some in parameters.items()
        }
        instants = sorted({t for curve in curves.values() for t in curve.t})
        if len(instants) > MAX_POINTS:
            place = next(iter(parameters.values()))[0].place
            message = f"automation: a CEL changes more than {MAX_POINTS:,} times"
            collector.error("E105", message, place)
        elif instants:
            known: dict[tuple[float, ...], tuple[float, float, float]] = {}
            points = []
            for t in instants:
                values = tuple(curve.at(t) for curve in curves.values())
                if values not in known:  # a swing has the same values in every period
                    said = dict(zip(curves, values, strict=True))
                    known[values] = _tied(module, said, scale)
                points.append((max(0.0, t), *known[values]))
            found[where] = points
    return found


def _notes(piece: Piece) -> Iterator[Automation]:
    """The pitches of strikes that have notes."""
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


def led_on(
    before: Mapping[Where, Points], after: Mapping[Where, Points], piece: Piece, start: float
) -> dict[Where, Points]:
    """The points of a stage that takes over at `start` [s] from one with other points.

    What is as before goes on to the last bit; what differs goes over within `GLIDE`.
    """
    found: dict[Where, Points] = {}
    for where in {**before, **after}:
        known = _module(piece, where)
        if known is None:
            continue  # the module is gone
        module, scale = known
        own = (0.0, *_tied(module, {}, scale))
        old, new = before.get(where) or [own], after.get(where) or [own]
        if not _is_same(old, new, start):
            soon = start + GLIDE
            later = (point for point in new if point[0] > soon)
            new = [(start, *_value(old, start)), (soon, *_value(new, soon)), *later]
        if any(point[1:] != own[1:] for point in new):
            found[where] = new
    return found


def _is_same(old: Points, new: Points, start: float) -> bool:
    """Whether two rows of points are one from an instant on, as far as both go."""
    old_from, new_from = (
        max(0, bisect_right(points, start, key=lambda point: point[0]) - 1) for points in (old, new)
    )
    old, new = old[old_from:], new[new_from:]
    if len(old) == 1 or len(new) == 1:  # one of them stays
        return all(point[1:] == old[0][1:] for point in (*old, *new))
    return all(one == other for one, other in zip(old, new, strict=False))


def _value(points: Points, instant: float) -> tuple[float, float, float]:
    after = bisect_right(points, instant, key=lambda point: point[0])
    if after in (0, len(points)):
        _, k, z, m = points[0 if after == 0 else -1]
        return k, z, m
    (begin, *low), (end, *high) = points[after - 1], points[after]
    share = (instant - begin) / (end - begin)
    k, z, m = (a + (b - a) * share for a, b in zip(low, high, strict=True))
    return k, z, m


def _module(piece: Piece, where: Where) -> tuple[Module, float] | None:
    """A CEL, and what turns its values into those that the scene sees; None where it is not."""
    name, module_name = where
    key = piece.keys.get(name)
    part = key or piece.instruments.get(name)
    modules = () if part is None else part.modules
    module = next((one for one in modules if one.name == module_name), None)
    if module is None or module.kind != "CEL":
        return None
    return module, 1.0 if key is None else 1.0 / (key.reach * key.reach)


def _own(module: Module) -> dict[str, float]:
    """The five parameters of a CEL as they are."""
    k, z, m = ties(module.fields)
    sigma = z / (2.0 * m)
    f, t60 = module.fields.get("f"), module.fields.get("t60")
    return {
        "K": k,
        "Z": z,
        "M": m,
        "f": float(f) if f else math.sqrt(max(0.0, k / m - sigma * sigma)) / TWO_PI,
        "t60": float(t60) if t60 else (LN_1000 / sigma if sigma else _FOR_EVER),
    }


def _tied(module: Module, said: Mapping[str, float], scale: float) -> tuple[float, float, float]:
    """K, Z and M of a CEL some of whose parameters have other values."""
    fields = dict(module.fields)
    if said.keys() & {"f", "t60"} and not fields.get("f"):
        fields |= _own(module)
    fields |= said
    if float(fields.get("t60") or 0.0) >= _FOR_EVER:
        fields["t60"] = None
    if said.keys() & {"K", "Z"} and fields.get("f"):
        k, z, _ = ties(fields)
        fields |= {"f": None, "K": said.get("K", k), "Z": said.get("Z", z)}
    k, z, m = ties(fields)
    return k * scale, z * scale, m * scale


def _curve(
    piece: Piece,
    lines: Sequence[Automation],
    own: float,
    since: float,
    until: float,
    collector: Collector,
) -> _Curve:
    """One parameter: its lines one after another, its own value where there is none."""
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
                _swing(piece, one.swing, curve, (begin, min(stop, until)), since)
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
    """Add the values of a pattern to a curve; the beat on which the pattern ends."""
    tempo = piece.tempo_map
    places = one.steps(tempo, piece.seed)
    course = places.course
    last = bisect_left(places, stop - SAME)
    first, wanted = min(last, bisect_left(places, since - SAME)), 2
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
            early = _EARLY / piece.rate
            curve.set(instant - 2 * early, one.amounts[name].value, instant - early)
        elif name is not None:
            following = tempo.seconds(places.beat(place + 1))
            curve.set(instant, one.amounts[name].of(curve.own), max(following, instant))
    return places.beat(len(places))


def _swing(
    piece: Piece, swing: Swing, curve: _Curve, span: tuple[float, float], since: float
) -> None:
    """Add a swing to a curve, from one period before the beat `since` on."""
    tempo, own = piece.tempo_map, curve.own
    low, high = swing.low.of(own), swing.high.of(own)
    begin, stop = span

    def beat_of(number: int) -> float:
        return tempo.after(begin, swing.period.times(number / _PIECES))

    first = 0
    if since > begin:  # where in the swing it is, found by halving: the tempo may have changed
        first = max(0, bisect_left(range(1 << 24), since, key=beat_of) - _PIECES)
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


def _share(shape: Shape, place: int) -> float:
    """How far from the low end to the high one a swing is, at a piece of its period."""
    if shape == "sine":
        return 0.5 + 0.5 * _SINE[place]
    if shape == "square":
        return 1.0 if place < _PIECES // 2 else 0.0
    if shape == "ramp":
        return place / _PIECES
    quarter = _PIECES // 4
    level = place if place <= quarter else 2 * quarter - place
    return 0.5 + 0.5 * (max(level, place - 4 * quarter) / quarter)
