"""Levels: impulses with a unit, and strengths as words, numbers, velocities and decibels."""

import math
from itertools import pairwise

import pytest

from ergon.notation.tables.strengths import DYNAMICS, ImpulseRange, Level, level, levels, velocity
from ergon.notation.text.errors import TextError

REACH = ImpulseRange(3e-3, 40e-3)


def no_draw(low: float, high: float) -> float:
    raise AssertionError(f"nothing is drawn between {low} and {high}")


def impulse(text: str) -> float:
    return level(text).impulse(REACH, no_draw)


def test_impulse_of_words_geometric():
    steps = [impulse(word) for word in DYNAMICS]
    assert steps[0] == pytest.approx(REACH.soft)
    assert steps[-1] == pytest.approx(REACH.hard)
    ratios = [b / a for a, b in pairwise(steps)]
    assert ratios == pytest.approx([(40 / 3) ** (1 / 7)] * 7)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2mNs", 2e-3),
        ("0", REACH.soft),
        ("1", REACH.hard),
        ("0.5", math.sqrt(3e-3 * 40e-3)),
        ("1/2", math.sqrt(3e-3 * 40e-3)),
        ("v127", REACH.hard),
        ("v1", 3e-3 * (40 / 3) ** (1 / 127)),
        ("f!", 3e-3 * (40 / 3) ** (6 / 7)),
        ("fff!", REACH.hard),
        ("-6dB", 3e-3 * (40 / 3) ** (5 / 7) * 10 ** (-6 / 20)),
    ],
)
def test_impulse_of_one_level(text, expected):
    assert impulse(text) == pytest.approx(expected, rel=1e-12)


def test_velocity_of_midi_note():
    assert velocity(127) == level("fff")
    assert velocity(64) == level("v64")


def test_range_of_strengths_drawn_in_strength():
    middle = level("p..f").impulse(REACH, lambda low, high: (low + high) / 2)
    assert middle == pytest.approx(math.sqrt(impulse("p") * impulse("f")))


@pytest.mark.parametrize("text", ["2mNs", "1mNs..3mNs", "mf", "p..f", "v64", "-6dB", "0.3"])
@pytest.mark.parametrize("factor", [1.0, 0.5, 1.7])
def test_level_written_and_read(text, factor):
    scaled = level(text).scaled(factor)
    assert level(scaled.written) == scaled


def test_levels_in_turn_by_stroke():
    pattern = levels("f p 2mNs p..f")
    assert [pattern.step(n, 99) for n in range(5)] == [*map(level, ("f", "p", "2mNs", "p..f", "f"))]


def test_line_of_strengths_over_eight():
    line = levels("ppp -> fff")
    strengths = [line.step(n, 8).low for n in range(8)]
    assert strengths == pytest.approx([n / 7 for n in range(8)])
    assert line.step(0, 1) == level("ppp")


@pytest.mark.parametrize(
    ("text", "offset", "suggestion", "part"),
    [
        ("100", 0, "100mNs", "100mNs or 100Ns"),
        ("f 100", 2, "100mNs", "from 0 to 1"),
        ("1.5", 0, "1.5mNs", "has no unit"),
        ("loud", 0, "f", "neither an impulse"),
        ("fffff", 0, "fff", "neither an impulse"),
        ("v128", 0, None, "from v1 to v127"),
        ("2mNs..f", 0, None, "one end is an impulse"),
        ("f..p", 0, "p..f", "from the stronger"),
        ("p -> 2mNs", 2, None, "a line goes"),
        ("p -> f -> p", 2, None, "a line goes"),
        ("..f", 0, None, "two ends"),
        ("", 0, None, "is expected"),
        ("-6dB..f", 0, None, "decibels have no range"),
    ],
)
def test_level_refused_in_its_place(text, offset, suggestion, part):
    with pytest.raises(TextError) as caught:
        levels(text)
    assert part in caught.value.message
    assert caught.value.offset == offset
    assert caught.value.suggestion == suggestion


def test_levels_with_too_many_steps_are_refused():
    with pytest.raises(TextError):
        levels("f " * 2_000)
    assert len(levels("f " * 1_000).steps) == 1_000
    assert isinstance(levels("f").steps[0], Level)
