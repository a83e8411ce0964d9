"""Patterns in cycles: functions of a span of time to the events in it, with exact instants.

Time counts in cycles from 0. A query may cut an event: a fragment has the full span of its event
and the part of it that the query sees, so that what comes later (masks, reversal) knows where an
event begins. An event sounds in the cycle in which its span begins: `Cycles.onsets`.

No pattern draws by itself. What happens by chance asks a function of the number of the operator
and of an instant, so that a cycle can be played again, or alone, and sounds the same.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from operator import attrgetter
from typing import Generic, NamedTuple, TypeVar

from ergon import _core

MAX_EVENTS = 4_096  # in a cycle
MAX_DEPTH = 200  # of patterns inside patterns: each takes up to three calls of Python's 1,000
MAX_LEAVES = 4_096  # different values in a pattern

V = TypeVar("V")
W = TypeVar("W")

Chance = Callable[[int, Fraction], float]
"""A number in [0, 1) for the operator of a number and an instant in the operator's time."""

_BEGIN = attrgetter("begin")


@dataclass(frozen=True, slots=True)
class Event(Generic[V]):
    """What happens from one instant to another, in cycles."""

    begin: Fraction
    end: Fraction
    what: V


class Fragment(NamedTuple, Generic[V]):
    """An event from `begin` to `end`, of which a query sees the part from `start` to `stop`."""

    begin: Fraction
    end: Fraction
    start: Fraction
    stop: Fraction
    what: V


Query = Callable[[Fraction, Fraction, Chance], list[Fragment[V]]]


def chance_from(seed: int, owner: str) -> Chance:
    """The draws of one voice of a score, for any operator and instant."""

    def draw(number: int, instant: Fraction) -> float:
        # Hexadecimal: Python writes no decimal number of more than 4,300 digits.
        name = f"{owner}/{instant.numerator:x}/{instant.denominator:x}"
        return _core.Chance(seed, "pattern cycles", name, number, 0).uniform(0.0, 1.0)

    return draw


UNSEEDED = chance_from(0, "")


@dataclass(frozen=True, slots=True, eq=False)
class Cycles(Generic[V]):
    """A pattern. `query` returns the fragments between two instants, in the order of writing.

    `cost` bounds how many fragments are computed for a cycle, `depth` how deep patterns are inside
    patterns; `leaves` are all values that may be played, in the order of writing.
    """

    query: Query[V]
    cost: int = 1
    depth: int = 1
    leaves: tuple[V, ...] = ()

    def onsets(self, cycle: int, chance: Chance = UNSEEDED) -> list[Event[V]]:
        """The events that begin in a cycle, by instant and then in the order of writing."""
        fragments = self.query(Fraction(cycle), Fraction(cycle + 1), chance)
        fragments = [f for f in fragments if f.start is f.begin or f.start == f.begin]
        fragments.sort(key=_BEGIN)
        return [Event(f.begin, f.end, f.what) for f in fragments]

    def excess(self) -> str | None:
        """What of the pattern is too large to be played, as a sentence; None if nothing is."""
        if self.cost > MAX_EVENTS:
            return (
                f"a cycle would have up to {self.cost:,} steps; at most {MAX_EVENTS:,} are played"
            )
        if self.depth > MAX_DEPTH:
            return f"more than {MAX_DEPTH} patterns and changes are inside one another"
        if len(self.leaves) > MAX_LEAVES:
            return f"the words become more than {MAX_LEAVES:,} different strokes"
        return None


def node(query: Query[V], parts: Sequence[Cycles[V]], cost: int) -> Cycles[V]:
    """A pattern that is made of others."""
    depth = 1 + max((part.depth for part in parts), default=0)
    leaves = dict.fromkeys(leaf for part in dict.fromkeys(parts) for leaf in part.leaves)
    return Cycles(query, cost, depth, tuple(leaves))


def by_cycle(begin: Fraction, end: Fraction) -> Iterator[tuple[int, Fraction, Fraction]]:
    """The cycles between two instants, each with the part of it that lies between them."""
    cycle = begin.numerator // begin.denominator
    if end.denominator == 1 and end.numerator == cycle + 1:  # arithmetic of fractions is slow
        yield cycle, begin, end
        return
    while begin < end:
        cycle_end = min(end, Fraction(cycle + 1))
        yield cycle, begin, cycle_end
        begin, cycle = cycle_end, cycle + 1


def into_cycle(instant: Fraction) -> Fraction:
    """How far an instant lies after the beginning of its cycle."""
    return instant - instant.numerator // instant.denominator


def moved(
    fragments: Iterable[Fragment[V]], factor: Fraction | int, shift: Fraction | int
) -> list[Fragment[V]]:
    """Fragments with each instant t at t·factor + shift, for a factor above zero."""
    result = []
    for begin, end, start, stop, value in fragments:
        low, high = begin * factor + shift, end * factor + shift
        # Few fragments are cut.
        first = low if start is begin else start * factor + shift
        last = high if stop is end else stop * factor + shift
        result.append(Fragment(low, high, first, last, value))
    return result


def cut(fragment: Fragment[V], begin: Fraction, end: Fraction) -> Fragment[V] | None:
    """The part of a fragment between two instants."""
    start, stop = max(fragment.start, begin), min(fragment.stop, end)
    if start >= stop:
        return None
    return fragment._replace(start=start, stop=stop)


# --- making -------------------------------------------------------------------------------------


def silence() -> Cycles[V]:
    """The pattern without events."""
    return Cycles(lambda begin, end, chance: [])


def pure(value: V) -> Cycles[V]:
    """One event a cycle, which lasts the cycle."""

    def query(begin: Fraction, end: Fraction, _: Chance) -> list[Fragment[V]]:
        result = []
        for cycle, start, stop in by_cycle(begin, end):
            low = start if start.denominator == 1 else Fraction(cycle)
            high = stop if stop.denominator == 1 else Fraction(cycle + 1)
            result.append(Fragment(low, high, start, stop, value))
        return result

    return Cycles(query, leaves=(value,))


def sequence(steps: Sequence[tuple[Cycles[V], Fraction]]) -> Cycles[V]:
    """Patterns after one another in each cycle, each with its weight: its share of the cycle.

    Each pattern plays its first cycle in the first cycle, its second in the second, and so on.
    """
    if len(steps) == 1:
        return steps[0][0]
    parts = [part for part, _ in steps]
    total = sum((weight for _, weight in steps), Fraction(0))
    widths = [weight / total for _, weight in steps]
    bounds = list(accumulate(widths, initial=Fraction(0)))

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        result: list[Fragment[V]] = []
        for cycle, first, last in by_cycle(begin, end):
            is_cut = first.denominator != 1 or last.denominator != 1
            low, high = (first - cycle, last - cycle) if is_cut else (bounds[0], bounds[-1])
            cycle_begins, cycle_ends = Fraction(cycle), Fraction(cycle + 1)
            for step in range(bisect_right(bounds, low) - 1, len(parts)):
                left_bound, width = bounds[step], widths[step]
                start, stop = cycle_begins, cycle_ends
                if is_cut:
                    if left_bound >= high:
                        break
                    if low > left_bound:
                        start += (low - left_bound) / width
                    if high < bounds[step + 1]:
                        stop -= (bounds[step + 1] - high) / width
                inner = parts[step].query(start, stop, chance)
                if inner:
                    result += moved(inner, width, left_bound + cycle * (1 - width))
        return result

    return node(query, parts, sum(part.cost for part in parts))


def fast_sequence(parts: Sequence[Cycles[V]]) -> Cycles[V]:
    """Patterns after one another in each cycle, which they share evenly."""
    return sequence([(part, Fraction(1)) for part in parts])


def stack(parts: Sequence[Cycles[V]]) -> Cycles[V]:
    """Patterns together."""
    if len(parts) == 1:
        return parts[0]

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [fragment for part in parts for fragment in part.query(begin, end, chance)]

    return node(query, parts, max(1, sum(part.cost for part in parts)))


def choose(number: int, parts: Sequence[Cycles[V]]) -> Cycles[V]:
    """One of the patterns in each cycle, by chance."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        result: list[Fragment[V]] = []
        for cycle, first, last in by_cycle(begin, end):
            draw = int(chance(number, Fraction(cycle)) * len(parts))
            result += parts[min(draw, len(parts) - 1)].query(first, last, chance)
        return result

    # The sum, though one is played: what is written out in a text is bounded by the cost.
    return node(query, parts, sum(part.cost for part in parts))


# --- time ---------------------------------------------------------------------------------------


def fast(factor: Fraction | int, part: Cycles[V]) -> Cycles[V]:
    """The pattern `factor` times as fast."""
    if factor == 1:
        return part
    inverse = 1 / Fraction(factor)

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return moved(part.query(begin * factor, end * factor, chance), inverse, 0)

    # A slow pattern costs what it did: one cycle may hold all of its events.
    cost = max(part.cost, -(-part.cost * inverse.denominator // inverse.numerator))
    return node(query, (part,), cost)


def slow(factor: Fraction | int, part: Cycles[V]) -> Cycles[V]:
    """The pattern `factor` times as slow."""
    return fast(1 / Fraction(factor), part)


def late(time: Fraction, part: Cycles[V]) -> Cycles[V]:
    """The pattern, begun some time later."""
    if time == 0:
        return part

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return moved(part.query(begin - time, end - time, chance), 1, time)

    return node(query, (part,), part.cost)


def early(time: Fraction, part: Cycles[V]) -> Cycles[V]:
    """The pattern, begun some time earlier."""
    return late(-time, part)


# --- values and choice ---------------------------------------------------------------------------


def mapped(change: Callable[[V], W], part: Cycles[V]) -> Cycles[W]:
    """The pattern with each value changed."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[W]]:
        fragments = part.query(begin, end, chance)
        return [Fragment(*fragment[:4], change(fragment.what)) for fragment in fragments]

    leaves = dict.fromkeys(change(leaf) for leaf in part.leaves)
    return Cycles(query, part.cost, 1 + part.depth, tuple(leaves))


def filtered(test: Callable[[Fraction, Chance], bool], part: Cycles[V]) -> Cycles[V]:
    """The events whose beginning passes a test."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [f for f in part.query(begin, end, chance) if test(f.begin, chance)]

    return node(query, (part,), part.cost)
