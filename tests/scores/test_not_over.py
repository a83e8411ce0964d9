"""Lines that are over are looked at once, and counted in the order in which they are written."""

from __future__ import annotations

import random

from ergon.scores.staging.not_over import UnfinishedLines


class Item:
    """A line, which is the same object as long as it does not change."""

    def __init__(self, what, end, often):
        self.what, self.end, self.often = what, end, often


def _plays(line):
    return line[0].what, line[0].often


def is_over(since):
    return lambda line: line[0].end < since


def drawn(chance, count):
    return tuple(
        Item(chance.choice("ab"), chance.random(), chance.randint(1, 3)) for _ in range(count)
    )


def test_ended_lines_are_checked_once():
    lines = tuple(Item("knock", float(n), 1) for n in range(1000))
    seen = []

    def looks(line, since):
        seen.append(line)
        return line[0].end < since

    known = UnfinishedLines()
    for since in (990.0, 991.0, 992.0):
        seen.clear()
        left, counts = known.select(
            (lines,), since, lambda line, since=since: looks(line, since), _plays
        )
        assert len(left) == 1000 - since
        assert counts == {"knock": since}
    assert len(seen) < 12
    seen.clear()
    more = (*lines, Item("knock", 2000.0, 1))
    left, _ = known.select((more,), 993.0, lambda line: looks(line, 993.0), _plays)
    assert len(left) == 8
    assert len(seen) < 12


def check_counts(lines, left, counts, since):
    assert [line for line in lines if line.end >= since] == [
        line for (line,) in left if line.end >= since
    ]
    for number, (line,) in enumerate(left):
        above = sum(one.often for one in lines[: lines.index(line)] if one.what == line.what)
        beside = sum(one.often for (one,) in left[:number] if one.what == line.what)
        assert counts.get(line.what, 0) + beside == above


def test_occurrence_counts_of_ended_lines():
    chance = random.Random(1)
    for _ in range(200):
        lines, known = drawn(chance, 9), UnfinishedLines()
        for since in (0.3, 0.8, 0.5, 0.9):
            left, counts = known.select((lines,), since, is_over(since), _plays)
            check_counts(lines, left, counts, since)


def test_occurrence_counts_with_changing_lines():
    chance = random.Random(2)
    for _ in range(400):
        lines, known = drawn(chance, 9), UnfinishedLines()
        for since in sorted(chance.random() for _ in range(6)):
            first = chance.randint(0, len(lines))
            last = min(len(lines), first + chance.randint(0, 2))
            lines = (*lines[:first], *drawn(chance, chance.randint(0, 2)), *lines[last:])
            left, counts = known.select((lines,), since, is_over(since), _plays)
            check_counts(lines, left, counts, since)
