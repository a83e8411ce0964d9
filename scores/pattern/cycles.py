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

MAX_EVENTS = 4_096  # events in a cycle
MAX_DEPTH = 200  # nested patterns; each takes up to three of Python's 1,000 calls
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
    value: V


class Fragment(NamedTuple, Generic[V]):
    """An event from `begin` to `end`, of which a query sees the part from `part_start` to
    `part_stop`.
    """

    begin: Fraction
    end: Fraction
    part_start: Fraction
    part_stop: Fraction
    value: V


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
        fragments = [f for f in fragments if f.part_start is f.begin or f.part_start == f.begin]
        fragments.sort(key=_BEGIN)
        return [Event(f.begin, f.end, f.value) for f in fragments]

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


def combined(query: Query[V], patterns: Sequence[Cycles[V]], cost: int) -> Cycles[V]:
    """A pattern that is made of others."""
    depth = 1 + max((part.depth for part in patterns), default=0)
    leaves = dict.fromkeys(leaf for part in dict.fromkeys(patterns) for leaf in part.leaves)
    return Cycles(query, cost, depth, tuple(leaves))


def split_by_cycle(begin: Fraction, end: Fraction) -> Iterator[tuple[int, Fraction, Fraction]]:
    """The cycles between two instants, each with the part of it that lies between them."""
    cycle = begin.numerator // begin.denominator
    if end.denominator == 1 and end.numerator == cycle + 1:  # arithmetic of fractions is slow
        yield cycle, begin, end
        return
    while begin < end:
        cycle_end = min(end, Fraction(cycle + 1))
        yield cycle, begin, cycle_end
        begin, cycle = cycle_end, cycle + 1


def cycle_fraction(instant: Fraction) -> Fraction:
    """How far an instant lies after the beginning of its cycle."""
    return instant - instant.numerator // instant.denominator


def moved(
    fragments: Iterable[Fragment[V]], factor: Fraction | int, shift: Fraction | int
) -> list[Fragment[V]]:
    """Fragments with each instant t at t·factor + shift, for a factor above zero."""
    moved_fragments = []
    for begin, end, start, stop, value in fragments:
        low, high = begin * factor + shift, end * factor + shift
        # Few fragments are cut.
        first = low if start is begin else start * factor + shift
        last = high if stop is end else stop * factor + shift
        moved_fragments.append(Fragment(low, high, first, last, value))
    return moved_fragments


def clipped(fragment: Fragment[V], begin: Fraction, end: Fraction) -> Fragment[V] | None:
    """The part of a fragment between two instants."""
    start, stop = max(fragment.part_start, begin), min(fragment.part_stop, end)
    if start >= stop:
        return None
    return fragment._replace(part_start=start, part_stop=stop)


# --- making -------------------------------------------------------------------------------------


def silence() -> Cycles[V]:
    """The pattern without events."""
    return Cycles(lambda begin, end, chance: [])


def pure(value: V) -> Cycles[V]:
    """One event a cycle, which lasts the cycle."""

    def query(begin: Fraction, end: Fraction, _: Chance) -> list[Fragment[V]]:
        fragments = []
        for cycle, fragment_start, fragment_stop in split_by_cycle(begin, end):
            low = fragment_start if fragment_start.denominator == 1 else Fraction(cycle)
            high = fragment_stop if fragment_stop.denominator == 1 else Fraction(cycle + 1)
            fragments.append(Fragment(low, high, fragment_start, fragment_stop, value))
        return fragments

    return Cycles(query, leaves=(value,))


def sequence(weighted_steps: Sequence[tuple[Cycles[V], Fraction]]) -> Cycles[V]:
    """Patterns after one another in each cycle, each with its weight: its share of the cycle.

    Each pattern plays its first cycle in the first cycle, its second in the second, and so on.
    """
    if len(weighted_steps) == 1:
        return weighted_steps[0][0]
    patterns = [part for part, _ in weighted_steps]
    total = sum((weight for _, weight in weighted_steps), Fraction(0))
    widths = [weight / total for _, weight in weighted_steps]
    bounds = list(accumulate(widths, initial=Fraction(0)))

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        fragments: list[Fragment[V]] = []
        for cycle, first_instant, last_instant in split_by_cycle(begin, end):
            is_cut = first_instant.denominator != 1 or last_instant.denominator != 1
            low_bound, high_bound = (
                (first_instant - cycle, last_instant - cycle) if is_cut else (bounds[0], bounds[-1])
            )
            cycle_begin, cycle_end = Fraction(cycle), Fraction(cycle + 1)
            for step_index in range(bisect_right(bounds, low_bound) - 1, len(patterns)):
                left_bound, step_width = bounds[step_index], widths[step_index]
                part_start, part_stop = cycle_begin, cycle_end
                if is_cut:
                    if left_bound >= high_bound:
                        break
                    if low_bound > left_bound:
                        part_start += (low_bound - left_bound) / step_width
                    if high_bound < bounds[step_index + 1]:
                        part_stop -= (bounds[step_index + 1] - high_bound) / step_width
                inner_fragments = patterns[step_index].query(part_start, part_stop, chance)
                if inner_fragments:
                    fragments += moved(
                        inner_fragments, step_width, left_bound + cycle * (1 - step_width)
                    )
        return fragments

    return combined(query, patterns, sum(part.cost for part in patterns))


def fast_sequence(parts: Sequence[Cycles[V]]) -> Cycles[V]:
    """Patterns after one another in each cycle, which they share evenly."""
    return sequence([(part, Fraction(1)) for part in parts])


def stack(patterns: Sequence[Cycles[V]]) -> Cycles[V]:
    """Patterns together."""
    if len(patterns) == 1:
        return patterns[0]

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [fragment for part in patterns for fragment in part.query(begin, end, chance)]

    return combined(query, patterns, max(1, sum(part.cost for part in patterns)))


def choose(operator_number: int, patterns: Sequence[Cycles[V]]) -> Cycles[V]:
    """One of the patterns in each cycle, by chance."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        fragments: list[Fragment[V]] = []
        for cycle, first, last in split_by_cycle(begin, end):
            drawn_index = int(chance(operator_number, Fraction(cycle)) * len(patterns))
            fragments += patterns[min(drawn_index, len(patterns) - 1)].query(first, last, chance)
        return fragments

    # The sum, though one is played: what is written out in a text is bounded by the cost.
    return combined(query, patterns, sum(part.cost for part in patterns))


# --- time ---------------------------------------------------------------------------------------


def fast(factor: Fraction | int, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern `factor` times as fast."""
    if factor == 1:
        return pattern
    inverse_factor = 1 / Fraction(factor)

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return moved(pattern.query(begin * factor, end * factor, chance), inverse_factor, 0)

    # A slow pattern costs what it did: one cycle may hold all of its events.
    faster_cost = max(
        pattern.cost, -(-pattern.cost * inverse_factor.denominator // inverse_factor.numerator)
    )
    return combined(query, (pattern,), faster_cost)


def slow(factor: Fraction | int, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern `factor` times as slow."""
    return fast(1 / Fraction(factor), pattern)


def late(delay: Fraction, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern, begun some time later."""
    if delay == 0:
        return pattern

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return moved(pattern.query(begin - delay, end - delay, chance), 1, delay)

    return combined(query, (pattern,), pattern.cost)


def early(time: Fraction, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern, begun some time earlier."""
    return late(-time, pattern)


# --- values and choice ---------------------------------------------------------------------------


def mapped(change: Callable[[V], W], pattern: Cycles[V]) -> Cycles[W]:
    """The pattern with each value changed."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[W]]:
        fragments = pattern.query(begin, end, chance)
        return [Fragment(*fragment[:4], change(fragment.value)) for fragment in fragments]

    leaves = dict.fromkeys(change(leaf) for leaf in pattern.leaves)
    return Cycles(query, pattern.cost, 1 + pattern.depth, tuple(leaves))


def filtered(test: Callable[[Fraction, Chance], bool], pattern: Cycles[V]) -> Cycles[V]:
    """The events whose beginning passes a test."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [f for f in pattern.query(begin, end, chance) if test(f.begin, chance)]

    return combined(query, (pattern,), pattern.cost)
