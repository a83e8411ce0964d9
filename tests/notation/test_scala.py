"""Scales and keyboard maps of Scala, against values computed in exact fractions."""

from fractions import Fraction
from math import log2

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.tables.scala import KeyMap, ScalaError, Scale, parse_key_map, parse_scale

MEANTONE = """! meantone.scl
!
Five notes, written in every way
 5
! a comment between
 200.0 cents, a text after it
 5/4   E\\
498.
 3/2 ! comment
 2
"""
PITCHES = st.one_of(
    st.fractions(min_value=Fraction(1, 50), max_value=50, max_denominator=5000).map(
        lambda ratio: (f"{ratio.numerator}/{ratio.denominator}", float(ratio))
    ),
    st.decimals(min_value=-2400, max_value=4800, places=5).map(
        lambda cents: (f"{cents:.5f}", 2.0 ** (float(cents) / 1200.0))
    ),
    st.integers(1, 64).map(lambda number: (str(number), float(number))),
)


def test_scale_of_every_form():
    scale = parse_scale(MEANTONE)
    assert scale.title == "Five notes, written in every way"
    cents = [1200.0 * log2(ratio) for ratio in scale.ratios]
    assert cents == pytest.approx([200.0, 386.313714, 498.0, 701.955001, 1200.0], abs=1e-6)


@given(st.lists(PITCHES, min_size=1, max_size=40), st.sampled_from(["\n", "\r\n"]))
def test_scale_of_random_pitches(pitches, line_end):
    lines = ["! x.scl", "", f" {len(pitches)} notes", *(f"\t {word} a text" for word, _ in pitches)]
    read = parse_scale(line_end.join(lines))
    assert read.ratios == pytest.approx([ratio for _, ratio in pitches], rel=1e-12)


def read_or_line(read, lines):
    """What is read, or the refusal's line, which is one of the text."""
    try:
        return read()
    except ScalaError as error:
        return () if error.line in lines else (-1.0,)


@given(st.text(alphabet="!0123456789/. \nx-", max_size=80))
def test_scale_of_random_text(text):
    lines = range(1, text.count("\n") + 2)
    assert all(ratio > 0.0 for ratio in read_or_line(lambda: parse_scale(text).ratios, lines))
    assert all(low >= 0 for low in read_or_line(lambda: (parse_key_map(text).low,), lines))


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("t\nmany\n", 2, "the number of degrees"),
        ("t\n0\n", 2, "0 degrees are announced"),
        ("t\n9000\n", 2, "9,000 degrees are announced"),
        ("t\n2\n3/2\n", 4, "2 degrees are announced, but the file has 1"),
        ("! c\nt\n1\n3/0\n", 4, "is not a ratio above 0"),
        ("t\n1\n-3/2\n", 3, "is not a ratio above 0"),
        ("t\n1\nquint\n", 3, "is no pitch"),
        ("t\n1\n697//441\n", 3, "is no pitch"),
        ("t\n1\n999999999.0\n", 3, "lies outside"),
        ("t\n1\n1" + "0" * 300 + "/1\n", 3, "more than 100 octaves"),
    ],
)
def test_scale_refused_at_its_line(text, line, message):
    with pytest.raises(ScalaError, match=message) as raised:
        parse_scale(text)
    assert raised.value.line == line


def test_scale_above_and_below_its_octave():
    scale = Scale((1.25, 1.5, 3.0))
    degrees = range(-4, 5)
    expected = [1.5 / 9, 1 / 3, 1.25 / 3, 0.5, 1.0, 1.25, 1.5, 3.0, 3.75]
    assert [scale.ratio(degree) for degree in degrees] == pytest.approx(expected, rel=1e-15)


WHITE = """! white keys
12
0
127
60
69
440.0
7
0
x
1
x
2
3
x
4
x
5
x
6
"""


def test_key_map_of_white_keys():
    scale = Scale(tuple(2.0 ** (step / 7) for step in range(1, 8)))
    keys = parse_key_map(WHITE)
    assert keys.hertz(69, scale) == 440.0
    assert keys.hertz(60, scale) == pytest.approx(440.0 * 2.0 ** (-5 / 7), rel=1e-15)
    assert keys.hertz(61, scale) is None
    assert keys.hertz(72, scale) == pytest.approx(440.0 * 2.0 ** (2 / 7), rel=1e-15)


def test_key_map_without_degrees():
    keys = parse_key_map("0\n10\n100\n60\n60\n264.0\n0\n")
    assert keys == KeyMap(10, 100, 60, 60, 264.0, 0, ())
    scale = Scale((9 / 8, 2.0))
    assert [keys.hertz(key, scale) for key in (9, 60, 61, 62, 101)] == [None, 264, 297, 528, None]


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("big\n", 1, "the size of the map"),
        ("0\n0\n200\n", 3, "the last key"),
        ("0\n0\n127\n60\n69\nloud\n", 6, "the reference frequency in hertz"),
        ("0\n0\n127\n60\n", 5, "the reference key is missing"),
        ("1\n0\n127\n60\n69\n440\n0\ny\n", 8, "neither a degree nor x"),
        ("1\n0\n127\n60\n69\n440\n0\nx\n", 8, "has no degree in the map"),
    ],
)
def test_key_map_refused_at_its_line(text, line, message):
    with pytest.raises(ScalaError, match=message) as raised:
        parse_key_map(text)
    assert raised.value.line == line
