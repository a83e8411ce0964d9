"""The part in which two nearly equal sequences differ."""

import random

import pytest

from ergon.common.changed import changed_part


def items(n_items: int) -> tuple[object, ...]:
    return tuple(object() for _ in range(n_items))


@pytest.mark.parametrize("seed", range(50))
def test_changed_part_of_spliced_sequence(seed):
    chance = random.Random(seed)
    before = items(chance.randrange(12))
    first = chance.randint(0, len(before))
    last = chance.randint(first, len(before))
    new = items(chance.randrange(4))
    now = (*before[:first], *new, *before[last:])
    changed = changed_part(before, now)
    assert changed.put(before, changed.now) == [*now]
    assert {*changed.before} == {*before[first:last]}
    assert {*changed.now} == {*new}
    assert bool(changed) == (first < last or bool(new))


def test_changed_part_of_equal_sequences():
    before = items(5)
    assert not changed_part(before, (*before,))


def test_changed_part_with_repeated_items():
    first, two = items(2)
    assert changed_part((first, first), (first, first, first)) == (2, (), (first,))
    assert changed_part((first, two, first), (first, first)) == (1, (two,), ())
