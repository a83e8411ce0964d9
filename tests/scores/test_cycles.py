"""Patterns in cycles: laws of the algebra over random rhythms, and its draws by chance."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from random import Random

import pytest

from ergon.scores.pattern import cycle_operations as change
from ergon.scores.pattern.cycles import (
    MAX_DEPTH,
    Cycles,
    Event,
    chance_from,
    early,
    fast,
    fast_sequence,
    late,
    mapped,
    pure,
    silence,
    slow,
    stack,
)
from ergon.scores.pattern.rhythm import Euclid
from ergon.scores.pattern.rhythm_text import parse

CYCLES = range(4)
SEEDS = range(30)
THIRD = Fraction(1, 3)


def random_text(random: Random, depth: int = 3, is_steady: bool = False) -> str:
    """A rhythm; a steady one plays the same in each cycle."""
    return " ".join(random_step(random, depth, is_steady) for _ in range(random.randint(1, 3)))


def random_step(random: Random, depth: int, is_steady: bool) -> str:
    if depth == 0 or random.random() < 0.4:
        step = random.choice(["a", "b", "c", "d", "~"])
    else:
        inner = random_text(random, depth - 1, is_steady)
        other = random_text(random, depth - 1, is_steady)
        brackets = ["[{0}]", "[{0}, {1}]", "[{0} . {1}]"]
        if not is_steady:
            brackets += ["<{0}>", "{{{0}, {1}}}%3", "[{0}|{1}]"]
        step = random.choice(brackets).format(inner, other)
    ends = ["", "", "", "*2", "!2", "@3", "(3,8,2)"]
    if not is_steady:
        ends += ["/2", "*1.5", "?", "?0.2"]
    return step + random.choice(ends)


def random_rhythms(is_steady: bool = False) -> list[Cycles[str]]:
    texts = [random_text(Random(seed), 2, is_steady) for seed in SEEDS]
    return [parse(text, lambda word, _: word) for text in texts]


RHYTHMS = random_rhythms()
STEADY = random_rhythms(is_steady=True)


def played(part: Cycles[str], cycles: range = CYCLES) -> list[list[Event[str]]]:
    """The events of some cycles, those of one instant in alphabetical order."""
    order = lambda event: (event.begin, event.value, event.end)  # noqa: E731
    return [sorted(part.onsets(cycle), key=order) for cycle in cycles]


def upper(part: Cycles[str]) -> Cycles[str]:
    return mapped(str.upper, part)


def same(part: Cycles[str]) -> Cycles[str]:
    return part


# --- laws ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "law",
    [
        lambda p: change.rev(change.rev(p)),
        lambda p: fast(2, slow(2, p)),
        lambda p: slow(THIRD, fast(THIRD, p)),
        lambda p: early(THIRD, late(THIRD, p)),
        lambda p: late(Fraction(2), early(Fraction(2), p)),
        lambda p: change.ply(1, p),
        lambda p: change.iterate(1, p),
        lambda p: change.swing(Fraction(0), 4, p),
        lambda p: change.degrade(99, 0.0, p),
        lambda p: stack([p, change.degrade(99, 1.0, p)]),
        lambda p: stack([silence(), p]),
        lambda p: change.sometimes(99, 0.5, same, p),
        lambda p: change.chunk(4, same, p),
        lambda p: change.every(3, same, p),
        lambda p: change.whenmod(4, 2, same, p),
        lambda p: change.mask(pure("t"), p),
        lambda p: change.euclid(Euclid(1, 1), p),
        lambda p: fast_sequence([p]),
        lambda p: change.echo(1, THIRD, lambda what, _: what, p),
    ],
    ids=range(19),
)
def test_transformation_identities_on_random_rhythms(law):
    for rhythm in RHYTHMS:
        assert played(law(rhythm)) == played(rhythm)


def test_stack_commutes():
    for first, second in pairwise(RHYTHMS):
        assert played(stack([first, second])) == played(stack([second, first]))


def test_stack_order_in_an_instant():
    together = stack([pure("b"), pure("a"), pure("c")])
    assert [event.value for event in together.onsets(3)] == ["b", "a", "c"]


def test_off_zero_as_superimpose():
    for rhythm in RHYTHMS:
        off = change.superimpose_late(Fraction(0), upper, rhythm)
        assert played(off) == played(change.superimpose(upper, rhythm))


def test_palindrome_odd_cycles():
    for rhythm in RHYTHMS:
        for cycle in CYCLES:
            expected = change.rev(rhythm) if cycle % 2 else rhythm
            assert change.palindrome(rhythm).onsets(cycle) == expected.onsets(cycle)


def test_rev_mirrors_events():
    for rhythm in STEADY:
        for cycle in CYCLES:
            both = 2 * cycle + 1
            mirrored = {(both - e.end, both - e.begin, e.value) for e in rhythm.onsets(cycle)}
            reversed_ = change.rev(rhythm).onsets(cycle)
            assert {(e.begin, e.end, e.value) for e in reversed_} == mirrored


@pytest.mark.parametrize("count", [2, 3, 4])
def test_iterate_repeats(count):
    for rhythm in STEADY:
        turned = change.iterate(count, rhythm)
        again = [
            [Event(e.begin - count, e.end - count, e.value) for e in turned.onsets(cycle + count)]
            for cycle in CYCLES
        ]
        assert again == [turned.onsets(cycle) for cycle in CYCLES]
        first = early(Fraction(1, count), rhythm)
        assert turned.onsets(1) == first.onsets(1)


def test_degrade_one():
    for rhythm in RHYTHMS:
        assert not any(played(change.degrade(99, 1.0, rhythm)))


def test_undegrade_complements_degrade():
    for rhythm in RHYTHMS:
        left, rest = change.degrade(9, 0.3, rhythm), change.undegrade(9, 0.3, rhythm)
        assert played(stack([left, rest])) == played(rhythm)


def test_apply_every_whenmod_and_chunk_by_cycle():
    for rhythm in RHYTHMS:
        for cycle in CYCLES:
            plain, changed = rhythm.onsets(cycle), upper(rhythm).onsets(cycle)
            expected = plain if cycle % 3 else changed
            assert change.every(3, upper, rhythm).onsets(cycle) == expected
            expected = changed if cycle % 4 >= 2 else plain
            assert change.whenmod(4, 2, upper, rhythm).onsets(cycle) == expected
            share = [
                b if (a.begin - cycle) * 4 // 1 == cycle % 4 else a
                for a, b in zip(plain, changed, strict=True)
            ]
            chunked = change.chunk(4, upper, rhythm)
            assert played(chunked, range(cycle, cycle + 1)) == [
                sorted(share, key=lambda e: (e.begin, e.value, e.end))
            ]


def test_onsets_disjoint_and_complete():
    for rhythm in RHYTHMS:
        begun = [event for cycle in CYCLES for event in rhythm.onsets(cycle)]
        assert all(cycle <= e.begin < cycle + 1 for cycle in CYCLES for e in rhythm.onsets(cycle))
        first, last = Fraction(CYCLES[0]), Fraction(CYCLES[-1] + 1)
        fragments = rhythm.query(first, last, chance_from(0, ""))
        assert sorted(begun, key=repr) == sorted(
            (Event(f.begin, f.end, f.value) for f in fragments if f.part_start == f.begin), key=repr
        )


def test_query_cut_anywhere():
    for seed, rhythm in enumerate(RHYTHMS):
        random, chance = Random(seed), chance_from(0, "")
        cuts = sorted(Fraction(random.randint(1, 59), 30) for _ in range(4))
        bounds = [Fraction(0), *cuts, Fraction(2)]
        begun = [
            Event(f.begin, f.end, f.value)
            for begin, end in pairwise(bounds)
            for f in rhythm.query(begin, end, chance)
            if f.part_start == f.begin
        ]
        expected = [event for cycle in range(2) for event in rhythm.onsets(cycle)]
        assert sorted(begun, key=repr) == sorted(expected, key=repr)


def test_leaves_of_random_rhythms():
    for rhythm in RHYTHMS:
        values = {e.value for cycle in range(24) for e in rhythm.onsets(cycle)}
        assert values <= set(rhythm.leaves)
        assert len(rhythm.leaves) == len(set(rhythm.leaves))
        both = change.every(2, upper, rhythm)
        assert set(both.leaves) == set(rhythm.leaves) | {leaf.upper() for leaf in rhythm.leaves}


def test_cost_bounds_onsets():
    for rhythm in RHYTHMS:
        for part in (
            rhythm,
            change.ply(3, rhythm),
            change.superimpose_late(THIRD, change.rev, rhythm),
        ):
            assert all(len(part.onsets(cycle)) <= part.cost for cycle in CYCLES)


# --- operations by hand -------------------------------------------------------------------------


def test_swing_eighths():
    eighths = fast(8, pure("a"))
    begins = [event.begin for event in change.swing(THIRD, 4, eighths).onsets(0)]
    late_by = [Fraction(step, 8) + (Fraction(1, 12) if step % 2 else 0) for step in range(8)]
    assert begins == late_by


def test_ply_halves():
    part = change.ply(3, fast(2, pure("a")))
    assert [event.begin for event in part.onsets(1)] == [1 + Fraction(n, 6) for n in range(6)]
    assert {event.end - event.begin for event in part.onsets(1)} == {Fraction(1, 6)}


def test_ply_long_event():
    part = change.ply(4, slow(2, pure("a")))
    assert [[e.begin for e in part.onsets(cycle)] for cycle in range(2)] == [
        [Fraction(0), Fraction(1, 2)],
        [Fraction(1), Fraction(3, 2)],
    ]


def test_mask_quarters():
    part = change.mask(parse("t ~ t ~", lambda word, _: word), fast(8, pure("a")))
    assert [event.begin * 8 for event in part.onsets(0)] == [0, 1, 4, 5]


def test_struct_values():
    values = parse("a b", lambda word, _: word)
    part = change.struct(parse("t(3,8)", lambda word, _: word), values)
    assert [(e.begin * 8, e.value) for e in part.onsets(0)] == [(0, "a"), (3, "a"), (6, "b")]


def test_euclid_with_rotation():
    part = change.euclid(Euclid(3, 8, 2), pure("a"))
    assert [event.begin * 8 for event in part.onsets(0)] == [1, 4, 6]


# --- chance -------------------------------------------------------------------------------------


def test_chance_from_different_keys():
    draws = {
        chance_from(seed, who)(number, instant)
        for seed in (1, 2)
        for who in ("ada", "ben")
        for number in (0, 1, 1 << 50)
        for instant in (Fraction(0), Fraction(-1, 3), Fraction(1, 3), Fraction(1, 10**9))
    }
    assert len(draws) == 48
    assert all(0.0 <= draw < 1.0 for draw in draws)


def test_chance_from_large_fraction():
    instant = Fraction(3**20_000, 2**30_000)
    assert chance_from(1, "ada")(0, instant) == chance_from(1, "ada")(0, instant)


def test_degrade_cycles_in_any_order():
    part = change.degrade(0, 0.5, fast(16, pure("a")))
    forward = [part.onsets(cycle, chance_from(7, "ada")) for cycle in range(9)]
    backward = [part.onsets(cycle, chance_from(7, "ada")) for cycle in reversed(range(9))]
    assert forward == backward[::-1]
    assert forward != [part.onsets(cycle, chance_from(7, "ben")) for cycle in range(9)]


def test_degrade_share():
    part = change.degrade(0, 0.3, fast(1_000, pure("a")))
    assert len(part.onsets(0)) == pytest.approx(700, abs=5 * (1_000 * 0.3 * 0.7) ** 0.5)


# --- bounds -------------------------------------------------------------------------------------


def test_excess_depth():
    part = fast(2, pure("a"))
    while part.depth < MAX_DEPTH:
        part = change.rev(part) if part.depth % 2 else change.degrade(part.depth, 0.0, part)
    assert part.excess() is None
    assert len(part.onsets(0)) == 2
    assert "inside one another" in str(change.rev(part).excess())


def test_excess_cost():
    assert fast(4_096, pure("a")).excess() is None
    assert "4,097" in str(fast(4_097, pure("a")).excess())


def test_excess_leaves():
    part = fast_sequence([pure(str(n)) for n in range(4_000)])
    assert part.excess() is None
    assert "different strokes" in str(
        change.every(2, lambda p: mapped("x".__add__, p), part).excess()
    )
