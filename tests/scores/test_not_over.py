"""Lines that are over are looked at once, and counted in the order in which they are written."""

from __future__ import annotations

import random

from ergon.scores.staging.not_over import NotOver


def _plays(line):
    return line[0], line[2]


def test_lines_that_are_over_are_not_looked_at_again():
    lines = tuple(("knock", float(n), 1) for n in range(1000))
    looked = []

    def is_over(line, since):
        looked.append(line)
        return line[1] < since

    known = NotOver()
    for since in (990.0, 991.0, 992.0):
        looked.clear()
        left, counts = known.look(
            lines, lines, since, lambda line, since=since: is_over(line, since), _plays
        )
        assert len(left) == 1000 - since
        assert counts == {"knock": since}
    assert len(looked) < 12


def test_occurrences_before_each_line_are_those_of_all_lines_above_it():
    chance = random.Random(1)
    for _ in range(200):
        lines = tuple(
            (chance.choice("ab"), chance.random(), chance.randint(1, 3)) for _ in range(9)
        )
        known = NotOver()
        for since in (0.3, 0.8, 0.5, 0.9):
            left, counts = known.look(
                lines, lines, since, lambda line, since=since: line[1] < since, _plays
            )
            assert [line for line in lines if line[1] >= since] == [
                line for line in left if line[1] >= since
            ]
            for line in left:
                above = sum(one[2] for one in lines[: lines.index(line)] if one[0] == line[0])
                beside = sum(one[2] for one in left[: left.index(line)] if one[0] == line[0])
                assert counts.get(line[0], 0) + beside == above
