"""Transformations of written gestures and of takes."""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.text.errors import TextError
from ergon.notation.text.values import Point, Time
from ergon.scores.gesture.notation import parse
from ergon.scores.gesture.transforms import (
    TakeTransform,
    apply,
    apply_to_take,
    parse_chain,
    parse_transform,
)

KNOCK = "0mm@0 smooth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/2"


class Extreme:
    """Every draw is the same end of its range."""

    def __init__(self, part):
        self.part = part

    def uniform(self, low, high):
        return high if self.part > 0 else low


def shaped(notation, do, chance=None, beat=1.0):
    points, notes = apply(parse(notation).points, parse_chain(do), chance or Extreme(1), beat)
    return [(p.at.beats, p.at.seconds, round(p.x * 1e3, 9), p.curve) for p in points], notes


@pytest.mark.parametrize(
    ("do", "rows"),
    [
        (
            "scale 0.5",
            [(0, 0, "smooth"), (1 / 8, 3, "smooth"), (1 / 4, 0, "throw"), (1 / 2, 0, "hold")],
        ),
        (
            "mirror, stretch 2",
            [(0, 0, "smooth"), (1 / 4, -6, "smooth"), (1 / 2, 0, "throw"), (1, 0, "hold")],
        ),
        (
            "reverse",
            [(0, 0, "smooth"), (1 / 4, 0, "hold"), (3 / 8, 6, "throw"), (1 / 2, 0, "smooth")],
        ),
        (
            "shift -1/8",
            [(-1 / 8, 0, "smooth"), (0, 6, "smooth"), (1 / 8, 0, "throw"), (3 / 8, 0, "hold")],
        ),
        (
            "quantise 1/8",
            [(0, 0, "smooth"), (1 / 8, 6, "smooth"), (1 / 4, 0, "throw"), (1 / 2, 0, "hold")],
        ),
    ],
)
def test_transformation_words_on_example_gesture(do, rows):
    points, notes = shaped(KNOCK, do)
    assert points == [(t, 0, x, curve) for t, x, curve in rows]
    assert notes == ()


def test_transformations_apply_left_to_right():
    assert shaped("0@0 6@1", "shift 1, stretch 2")[0][0][0] == 2
    assert shaped("0@0 6@1", "stretch 2, shift 1")[0][0][0] == 1


def test_reverse_keeps_where_a_gesture_begins_and_ends():
    points, _ = shaped("1@1 6@2 hold 6@4 smooth 0@+20ms", "reverse")
    assert [p[:3] for p in points] == [(1, 0, 0), (1, 0.02, 6), (3, 0.02, 6), (4, 0.02, 1)]


written = st.lists(
    st.tuples(
        st.integers(1, 40), st.integers(-10, 10), st.sampled_from(["smooth", "line", "hold"])
    ),
    min_size=1,
    max_size=12,
)


def gesture(rows):
    """Points 1/16 beats apart or more; a hold stays."""
    points, position, x = [Point(Time(), 0.0, "smooth", 0, 1)], 0, 0.0
    for step, mm, curve in rows:
        position += step
        x = x if curve == "hold" else mm * 1e-3
        points.append(Point(Time(position / 16), x, curve, position, 1))
    return tuple(points)


def is_playable(points):
    """Times rise; a hold stays."""
    times = [p.at.beats + p.at.seconds for p in points]
    assert all(a < b for a, b in itertools.pairwise(times))
    assert all(b.x == a.x for a, b in itertools.pairwise(points) if b.curve == "hold")


@given(written)
def test_reverse_and_mirror_are_involutions(rows):
    points = gesture(rows)
    for word in ("reverse", "mirror"):
        assert apply(points, parse_chain(f"{word}, {word}"), Extreme(1))[0] == points


@given(written, st.integers(0, 2**32), st.sampled_from(["1s 5mm", "4ms 0.2mm", "1/4 1mm"]))
def test_jitter_preserves_order_holds_and_first_point(rows, seed, reach):
    points = gesture(rows)
    moved, _ = apply(points, parse_chain(f"jitter {reach}"), random.Random(seed))
    is_playable(moved)
    assert moved[0] == points[0]
    assert len(moved) == len(points)


@pytest.mark.parametrize("part", [1, -1])
def test_jitter_amounts_stay_within_bounds(part):
    points, _ = shaped("0@0 6@1 0@2", "jitter 4ms 0.2mm", Extreme(part))
    assert points[1:] == [
        (1, part * 0.004, 6 + part * 0.2, "smooth"),
        (2, part * 0.004, part * 0.2, "smooth"),
    ]


def test_jitter_in_seconds_depends_on_tempo():
    points, _ = shaped("0@0 6@1/8 0@1/4", "jitter 1s 0mm", Extreme(-1), beat=0.5)
    assert points[1][1] == pytest.approx(-0.45 / 16)


@given(written, st.sampled_from(["1/8", "1", "3", "0.3"]))
def test_quantise_lands_on_multiples_and_stays_playable(rows, q):
    points = gesture(rows)
    moved, notes = apply(points, parse_chain(f"quantise {q}"), Extreme(1))
    is_playable(moved)
    step = parse_transform(f"quantise {q}").amount
    assert all(abs(p.at.beats / step - round(p.at.beats / step)) < 1e-9 for p in moved)
    assert bool(notes) == (len(moved) < len(points))
    assert moved[-1].x == points[-1].x


def test_quantise_merges_coinciding_points_with_note():
    points, notes = shaped("0@0 throw 6@0.9 hold 6@1.1 smooth 0@2", "quantise 1")
    assert points == [(0, 0, 0, "smooth"), (1, 0, 6, "throw"), (2, 0, 0, "smooth")]
    assert notes == ("quantise 1: 1 point falls on the time of the next point",)


def test_quantise_counts_seconds_as_beats():
    assert shaped("0@0 6@300ms", "quantise 1/4", beat=0.5)[0][1][:2] == (0.5, 0)


@pytest.mark.parametrize(
    ("do", "left"),
    [
        ("from 1/8", [(0, 0, 6, "smooth"), (0.125, 0, 6, "hold"), (0.875, 0, 0, "throw")]),
        (
            "from 50ms",
            [(0.125, -0.05, 6, "smooth"), (0.25, -0.05, 6, "hold"), (1, -0.05, 0, "throw")],
        ),
        ("from 1/4", [(0, 0, 6, "smooth"), (0.75, 0, 0, "throw")]),
        ("from 0.125s", [(0.25, -0.125, 6, "smooth"), (1, -0.125, 0, "throw")]),
        (
            "reverse, from 1/2",
            [(0.25, 0, 6, "smooth"), (0.375, 0, 6, "hold"), (0.5, 0, 0, "smooth")],
        ),
    ],
)
def test_from_leaves_out_the_points_before_it(do, left):
    points, notes = shaped("0@0 smooth 6@1/8 hold 6@1/4 throw 0@1", do, beat=0.5)
    assert (points, notes) == (left, ())


def test_from_beyond_the_end_leaves_the_end():
    points, notes = shaped("0@0 6@1/8 2@1", "from 3")
    assert points == [(0, 0, 2, "smooth")]
    assert notes == (
        "from: the start lies after the last point, so only the last position remains",
    )


@pytest.mark.parametrize(
    ("do", "take"),
    [
        ("scale 0.5, mirror", TakeTransform(scale=-0.5)),
        ("stretch 2, reverse, reverse", TakeTransform(stretch=2)),
        ("reverse, shift 1/2, stretch 1/4", TakeTransform(1, 0.25, True, Time(0.125))),
        ("shift -20ms, shift 1", TakeTransform(shift=Time(1, -0.02))),
        ("stretch 2, from 1", TakeTransform(stretch=2, front_cut=0.25)),
        ("from 1, stretch 2", TakeTransform(stretch=2, front_cut=0.5)),
        ("from 1, reverse, from 50ms", TakeTransform(reverse=True, front_cut=0.5, back_cut=0.05)),
        ("shift 1, from 100ms", TakeTransform(shift=Time(0, 0.4))),
        ("shift 1, from 2", TakeTransform(front_cut=0.5)),
        ("shift -1/2, from 1/2", TakeTransform(front_cut=0.5)),
    ],
)
def test_transformations_of_a_take_sum_up(do, take):
    assert apply_to_take(parse_chain(do), beat=0.5) == take


@pytest.mark.parametrize("do", ["jitter 4ms 0.2mm", "scale 2, quantise 1/8"])
def test_point_transformations_of_take_are_refused(do):
    with pytest.raises(TextError, match="a take has none") as caught:
        apply_to_take(parse_chain(do))
    error = caught.value
    assert do[error.offset : error.offset + error.length] == do.split(", ")[-1]


@pytest.mark.parametrize(
    ("do", "marked", "words", "suggestion"),
    [
        ("scale 0.5, miror", "miror", "unknown transformation", "mirror"),
        ("mirror, late 1/8", "late", "a hand moves: write shift 1/8", None),
        ("every 4 rev", "every", "a gesture by itself has none", None),
        ("ply 2", "ply", "it is in one place at a time", None),
        ("quantize 1/8", "quantize", "unknown transformation", "quantise"),
        ("scale", "scale", "write for instance scale 0.5", None),
        ("mirror 2", "2", "write for instance mirror", None),
        ("stretch 0", "0", "above 0", None),
        ("stretch -2", "-2", "above 0", None),
        ("scale x", "x", "not a number", None),
        ("scale 1/0", "1/0", "too large", None),
        ("scale 1e300", "1e300", "too large", None),
        ("jitter 4ms 2N", "N", "does not measure position", None),
        ("jitter 0.2mm 4ms", "mm", "does not measure time", None),
        ("quantise 250ms", "250ms", "not a number", None),
        ("shift 1bar", "bar", "write beats", None),
        ("scale 2,, mirror", ",", "is one of", None),
        ("", "", "is one of", None),
    ],
)
def test_parse_chain_mistake_place_and_suggestion(do, marked, words, suggestion):
    with pytest.raises(TextError) as caught:
        parse_chain(do)
    error = caught.value
    assert do[error.offset : error.offset + error.length] == marked
    assert words in error.message
    assert error.suggestion == suggestion
