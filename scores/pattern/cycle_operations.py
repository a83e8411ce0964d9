"""What changes patterns in cycles: order, speed, chance, masks, copies."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache

from ergon.scores.pattern.cycles import (
    Chance,
    Cycles,
    Fragment,
    V,
    W,
    clipped,
    combined,
    cycle_fraction,
    early,
    fast_sequence,
    filtered,
    late,
    mapped,
    silence,
    split_by_cycle,
    stack,
)
from ergon.scores.pattern.rhythm import Euclid

Change = Callable[[Cycles[V]], Cycles[V]]

HALF = Fraction(1, 2)
_WALKS_CACHED = 256  # voices whose paths are remembered
# From the numbers of operators in one copy of a pattern to those in the next.
_OPERATOR_NUMBERS_PER_COPY = 1 << 40


# --- which pattern, which events, with which chances ---------------------------------------------


def select(
    pattern_of_cycle: Callable[[int], Cycles[V]], cycle_patterns: Sequence[Cycles[V]]
) -> Cycles[V]:
    """In each cycle the pattern that `pattern_of_cycle` returns for it, among `cycle_patterns`."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        pieces = split_by_cycle(begin, end)
        return [
            f
            for cycle, low, high in pieces
            for f in pattern_of_cycle(cycle).query(low, high, chance)
        ]

    return combined(query, cycle_patterns, max(part.cost for part in cycle_patterns))


def renumbered(number_shift: int, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern whose operators have other numbers, and so draw other chances."""
    if number_shift == 0:
        return pattern

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return pattern.query(begin, end, _renumbered_chance(chance, number_shift))

    return combined(query, (pattern,), pattern.cost)


@lru_cache(_WALKS_CACHED)
def _renumbered_chance(chance: Chance, shift: int) -> Chance:
    """The draws of operators whose numbers are `shift` higher; the same function each time."""
    return lambda number, instant: chance(number + shift, instant)


def filter_values(test: Callable[[V], bool], pattern: Cycles[V]) -> Cycles[V]:
    """The events whose value passes a test."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [f for f in pattern.query(begin, end, chance) if test(f.value)]

    leaves = tuple(leaf for leaf in pattern.leaves if test(leaf))
    return Cycles(query, pattern.cost, 1 + pattern.depth, leaves)


# --- order --------------------------------------------------------------------------------------


def rev(pattern: Cycles[V]) -> Cycles[V]:
    """Each cycle backwards."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        fragments = []
        for cycle, low_instant, high_instant in split_by_cycle(begin, end):
            mirror_sum = 2 * cycle + 1
            for first_instant, last_instant, fragment_start, fragment_stop, value in pattern.query(
                mirror_sum - high_instant, mirror_sum - low_instant, chance
            ):
                mirrored = Fragment(
                    mirror_sum - last_instant,
                    mirror_sum - first_instant,
                    mirror_sum - fragment_stop,
                    mirror_sum - fragment_start,
                    value,
                )
                fragments.append(mirrored)
        return fragments

    return combined(query, (pattern,), pattern.cost)


def palindrome(pattern: Cycles[V]) -> Cycles[V]:
    """Every second cycle backwards."""
    backwards = rev(pattern)
    return select(lambda cycle: backwards if cycle % 2 else pattern, (pattern, backwards))


def iterate(count: int, pattern: Cycles[V]) -> Cycles[V]:
    """Each cycle begins one of `count` shares later in the pattern than the cycle before."""
    shifted_patterns = [early(Fraction(shift, count), pattern) for shift in range(count)]
    return select(
        lambda cycle: shifted_patterns[cycle % count], (shifted_patterns[0], shifted_patterns[-1])
    )


def swing(amount: Fraction, slices: int, pattern: Cycles[V]) -> Cycles[V]:
    """The events in the second half of each slice of a cycle, later by a share of the slice."""
    on_beats = filtered(lambda begin, _: cycle_fraction(begin * slices) < HALF, pattern)
    off_beats = filtered(lambda begin, _: cycle_fraction(begin * slices) >= HALF, pattern)
    return stack([on_beats, late(amount / slices, off_beats)])


def ply(
    n_repeats: int,
    pattern: Cycles[V],
    change: Callable[[V, int], V] = lambda played_value, _: played_value,
) -> Cycles[V]:
    """Each event `n_repeats` times in its span; `change` returns the value of a repetition."""

    def query(begin: Fraction, end: Fraction, chance: Chance) -> list[Fragment[V]]:
        fragments: list[Fragment[V]] = []
        for fragment in pattern.query(begin, end, chance):
            first_instant, last_instant, fragment_start, fragment_stop, played_value = fragment
            step_width = (last_instant - first_instant) / n_repeats
            repetition = (fragment_start - first_instant) // step_width
            low_instant = first_instant + repetition * step_width
            while low_instant < fragment_stop:
                high_instant = low_instant + step_width
                value = change(played_value, int(repetition))
                fragments.append(
                    Fragment(
                        low_instant,
                        high_instant,
                        max(low_instant, fragment_start),
                        min(high_instant, fragment_stop),
                        value,
                    )
                )
                low_instant, repetition = high_instant, repetition + 1
        return fragments

    return combined(query, (pattern,), pattern.cost * n_repeats)


# --- some cycles, some parts of them ------------------------------------------------------------


def every(count: int, change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """A change of the first of every `count` cycles."""
    return when(lambda cycle: cycle % count == 0, change, pattern)


def whenmod(count: int, cycle_min: int, change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """A change of those of every `count` cycles that have the number `cycle_min`, from 0, or
    more.
    """
    return when(lambda cycle: cycle % count >= cycle_min, change, pattern)


def when(test: Callable[[int], bool], change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """A change of the cycles that pass a test."""
    changed = change(pattern)
    return select(lambda cycle: changed if test(cycle) else pattern, (pattern, changed))


def chunk(n_chunks: int, change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """A change of one of `n_chunks` shares of a cycle: of the first share in the first cycle,
    of the second in the second.
    """
    changed = change(pattern)

    def is_share(begin: Fraction) -> bool:
        cycle = begin.numerator // begin.denominator
        return (begin - cycle) * n_chunks // 1 == cycle % n_chunks

    return stack(
        [
            filtered(lambda begin, _: is_share(begin), changed),
            filtered(lambda begin, _: not is_share(begin), pattern),
        ]
    )


# --- chance -------------------------------------------------------------------------------------


def degrade(number: int, amount: float, pattern: Cycles[V]) -> Cycles[V]:
    """The pattern without some of its events: each is left out with a probability."""
    return filtered(lambda begin, chance: chance(number, begin) >= amount, pattern)


def undegrade(number: int, amount: float, pattern: Cycles[V]) -> Cycles[V]:
    """The events that `degrade` leaves out."""
    return filtered(lambda begin, chance: chance(number, begin) < amount, pattern)


def sometimes(number: int, amount: float, change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """A change of some events: of each with a probability."""
    return stack([degrade(number, amount, pattern), change(undegrade(number, amount, pattern))])


def walk(walk_number: int, cycle_patterns: Sequence[Cycles[V]]) -> Cycles[V]:
    """One of the patterns in each cycle: the first in the first, then the one before, the same or
    the one behind, by chance; a step beyond an end is reflected.
    """

    def query(query_begin: Fraction, query_end: Fraction, chance: Chance) -> list[Fragment[V]]:
        positions = _drawn_walk(chance, walk_number, len(cycle_patterns))
        fragments: list[Fragment[V]] = []
        for cycle, low_instant, high_instant in split_by_cycle(query_begin, query_end):
            for cycle_index in range(len(positions), abs(cycle) + 1):
                step = (
                    int(3 * chance(walk_number, Fraction(cycle_index))) - 1
                    if len(cycle_patterns) > 1
                    else 0
                )
                position = positions[-1] + step
                positions.append(
                    position if 0 <= position < len(cycle_patterns) else positions[-1] - step
                )
            fragments += cycle_patterns[positions[abs(cycle)]].query(
                low_instant, high_instant, chance
            )
        return fragments

    return combined(query, cycle_patterns, sum(part.cost for part in cycle_patterns))


@lru_cache(_WALKS_CACHED)
def _drawn_walk(chance: Chance, number: int, count: int) -> array[int]:
    """The part of a walk that has been drawn so far: each is drawn from its beginning."""
    return array("H", [0])


# --- copies -------------------------------------------------------------------------------------


def superimpose(change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """The pattern together with a change of it."""
    return stack([pattern, change(pattern)])


def superimpose_late(time: Fraction, change: Change[V], pattern: Cycles[V]) -> Cycles[V]:
    """The pattern together with a change of it that begins some time later."""
    return stack([pattern, change(late(time, pattern))])


def echo(
    n_echoes: int, time: Fraction, fade: Callable[[V, int], V], pattern: Cycles[V]
) -> Cycles[V]:
    """The pattern `n_echoes` times, each some time later; `fade` returns a value of a copy."""

    def copy(number: int) -> Cycles[V]:
        return late(time * number, mapped(lambda value: fade(value, number), pattern))

    return stack([pattern, *(copy(number) for number in range(1, n_echoes))])


def euclid(rhythm: Euclid, pattern: Cycles[V], copy: int = _OPERATOR_NUMBERS_PER_COPY) -> Cycles[V]:
    """The pattern within each pulse of a Euclidean rhythm; other steps are rests.

    The operators of each pulse are numbered `copy` higher than those of the pulse before.
    """
    steps: list[Cycles[V]] = [silence()] * rhythm.steps
    for pulse, position in enumerate(rhythm.positions()):
        steps[position] = renumbered(pulse * copy, pattern)
    return fast_sequence(steps)


# --- two patterns -------------------------------------------------------------------------------


def struct(rhythm: Cycles[W], pattern: Cycles[V]) -> Cycles[V]:
    """The events of a rhythm with the values that the pattern has there."""

    def query(query_begin: Fraction, query_end: Fraction, chance: Chance) -> list[Fragment[V]]:
        return [
            Fragment(beat.begin, beat.end, event.part_start, event.part_stop, event.value)
            for beat in rhythm.query(query_begin, query_end, chance)
            for event in pattern.query(beat.part_start, beat.part_stop, chance)
        ]

    return _onsets_within(query, rhythm, pattern)


def mask(opening_pattern: Cycles[W], pattern: Cycles[V]) -> Cycles[V]:
    """The events of the pattern that begin during the events of another."""

    def query(query_begin: Fraction, query_end: Fraction, chance: Chance) -> list[Fragment[V]]:
        fragments = []
        openings = opening_pattern.query(query_begin, query_end, chance)
        for event in pattern.query(query_begin, query_end, chance):
            for opening in openings:
                fragment = clipped(event, opening.part_start, opening.part_stop)
                if fragment is not None:
                    fragments.append(fragment)
        return fragments

    return _onsets_within(query, opening_pattern, pattern)


def _onsets_within(
    query: Callable[[Fraction, Fraction, Chance], list[Fragment[V]]],
    rhythm: Cycles[W],
    pattern: Cycles[V],
) -> Cycles[V]:
    depth = 1 + max(rhythm.depth, pattern.depth)
    return Cycles(query, rhythm.cost * pattern.cost, depth, pattern.leaves)
