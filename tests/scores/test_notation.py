"""Gestures as written: points, groups, tables, and the place of every mistake."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.text.errors import TextError
from ergon.notation.text.values import Time
from ergon.scores.gesture.notation import CURVES, MAX_EVENTS, parse, parse_table


def plain(notation):
    """(beats, seconds, mm, curve) of every point."""
    return [(*p.at, round(p.x * 1e3, 9), p.curve) for p in notation.points]


def fault(read, text):
    """The message and the text under the caret."""
    with pytest.raises(TextError) as caught:
        read(text)
    error = caught.value
    return error, text[error.offset : error.offset + error.length]


def test_parse_of_example_gesture():
    assert plain(parse("0mm@0 smooth 6mm@1/8 throw 0mm@1/4 hold 0mm@1/2")) == [
        (0, 0, 0, "smooth"),
        (0.125, 0, 6, "smooth"),
        (0.25, 0, 0, "throw"),
        (0.5, 0, 0, "hold"),
    ]


def test_parse_units_of_points():
    notation = parse("1cm@0 -2@1beat 0.5m@1.5 40um@+250ms 6mm@+1/4s")
    assert [p.x for p in notation.points] == [0.01, -0.002, 0.5, 40e-6, 0.006]
    assert [p.at for p in notation.points] == [
        Time(0, 0), Time(1, 0), Time(1.5, 0), Time(1.5, 0.25), Time(1.5, 0.5),
    ]  # fmt: skip


def test_parse_final_hold_extends_length():
    assert parse("0@0 6@1 hold 6@3").points[-1].at == Time(3, 0)


def test_group_repeats_from_last_point():
    assert plain(parse("0mm@0 (6mm@1/8 0mm@1/4)*2 3@1")) == [
        (0, 0, 0, "smooth"),
        (0.125, 0, 6, "smooth"),
        (0.25, 0, 0, "smooth"),
        (0.375, 0, 6, "smooth"),
        (0.5, 0, 0, "smooth"),
        (1, 0, 3, "smooth"),
    ]


def test_group_with_explicit_first_point():
    assert plain(parse("0@0 (0@0 6@1/8 0@1/4)*3")) == plain(parse("0@0 (6@1/8 0@1/4)*3"))


def test_group_repetitions_have_equal_curves():
    curves = [p.curve for p in parse("0@0 line (6@1 throw 0@2)*2 6@5").points]
    assert curves == ["smooth", "line", "throw", "line", "throw", "throw"]


def test_parse_nested_groups():
    nested = plain(parse("0@0 ((1@1/2 0@1)*2 5@3 0@4)*2"))
    assert [beats for beats, *_ in nested] == [0, 0.5, 1, 1.5, 2, 3, 4, 4.5, 5, 5.5, 6, 7, 8]


def test_parse_repeated_group_without_drift():
    notation = parse("0@0 (1@1/20 0@1/10)*1000 3@101")
    drift = [p.at.beats - k / 10 for k, p in enumerate(notation.points[2:-1:2], 1)]
    assert max(map(abs, drift)) <= 2**-46  # two last places of 100


def test_parse_relative_times():
    assert [p.at.beats for p in parse("0@1 6@+1/8 0@+1/8 (3@+1 0@+1)*2").points] == [
        1, 1.125, 1.25, 2.25, 3.25, 4.25, 5.25,
    ]  # fmt: skip


def test_parse_bar_check_positions():
    checks = parse("0@0 6@4 | 0@5 (3@2 | 0@4)*2").bar_checks
    assert [(c.at.beats, c.offset) for c in checks] == [(4, 8), (7, 19), (11, 19)]


def test_curve_option_until_first_curve_word():
    assert [p.curve for p in parse("0@0 6@1 throw 0@2", "line").points] == ["line", "line", "throw"]


@pytest.mark.parametrize(
    ("text", "marked", "words", "suggestion"),
    [
        ("0mm@0 smoth 6mm@1/8", "smoth", "unknown word", "smooth"),
        ("0mm@0 thr 6mm@1/8", "thr", "unknown word", "throw"),
        ("0@0 LINE 6@1", "LINE", "unknown word", "line"),
        ("0@0 6N@1", "N", "does not measure position", None),
        ("0@0 6@1/3x", "x", "does not measure time", None),
        ("0@0 6@1bar", "bar", "write beats", None),
        ("0@0 6mm", "6mm", "has no time", None),
        ("0@0 6@", "@", "no time after", None),
        ("0@0 @1/8", "@1/8", "position is missing", None),
        ("0@0 six@1", "six", "not a position", None),
        ("0@0 6@one", "one", "not a time", None),
        ("0@0 6@-1", "-1", "shift", None),
        ("0@0 6@1/0", "1/0", "divides by zero", None),
        ("0@0 6@1e999", "1e999", "too large", None),
        ("1e999@0", "1e999", "too large", None),
        ("0@0 6@1 5@1/2", "1/2", "earlier than the point before", None),
        ("0@0 6@1s 5@500ms", "500ms", "earlier than the point before", None),
        ("0@0 6@1 5@1", "5@1", "the same time", None),
        ("0@0 hold 6@1", "6@1", "keeps the position 0mm", "smooth"),
        ("0@0 (hold 0@1 smooth 6@2)*2", "0@1", "keeps the position 6mm", "smooth"),
        ("0@0 6@1 hold", "hold", "has no point after it", None),
        ("0@0 throw smooth 6@1", "throw", "has no point after it", None),
        ("smooth 0@0", "smooth", "begins with a point", None),
        ("(0@0 1@1)*4", "(", "begins with a point; write 0mm@0 before the group", None),
        ("0@0 (6@1)", ")", "no number of repetitions", None),
        ("0@0 (6@1)*0", "0", "number of repetitions", None),
        ("0@0 (6@1)*x", "x", "number of repetitions", None),
        ("0@0 (6@1", "(", "not closed", None),
        ("0@0 6@1)*3", ")", "has no '(' before it", None),
        ("0@0 ()*3", "(", "no points", None),
        ("", "", "needs a point", None),
    ],
)
def test_parse_mistake_place_and_suggestion(text, marked, words, suggestion):
    error, under = fault(parse, text)
    assert under == marked
    assert words in error.message
    assert error.suggestion == suggestion


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0@0 (((6@1)*1000)*1000)*2", "500,000 points"),
        ("0@0 " + "(" * 9 + "6@1" + ")*1" * 9, "8 deep"),
        ("0@0 (|)*3", "no points"),
        ("0@0 (6@1e8)*400000", "lasts too long"),
        ("0@0 (6@1 |)*999999", "500,000 points"),
    ],
)
def test_parse_size_limits(text, words):
    error, _ = fault(parse, text)
    assert words in error.message


@pytest.mark.parametrize("text", [" " * 500_000, "9" * 500_000, "0@0 6@1" + "(" * 500_000])
def test_parse_of_hostile_lines_is_refused(text):
    fault(parse, text)
    fault(parse_table, text)


def test_parse_table_of_times_and_curves():
    text = "# t x\n0 0mm\n1   3.5mm  # up\r\n2.5 3.5mm hold\n\n4 0mm\n"
    notation = parse_table(text)
    assert plain(notation) == [
        (0, 0, 0, "smooth"),
        (1, 0, 3.5, "smooth"),
        (2.5, 0, 3.5, "hold"),
        (4, 0, 0, "smooth"),
    ]
    marked = [text[p.offset : p.offset + p.length] for p in notation.points]
    assert marked == ["0 0mm", "1   3.5mm", "2.5 3.5mm hold", "4 0mm"]
    assert [p.curve for p in parse_table("0 0\n1 2 throw\n2 0", "line").points] == [
        "line", "throw", "line",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("row", "marked", "words"),
    [
        ("1 2 smoth", "smoth", "unknown word"),
        ("1 2mm throw it", "it", "at most"),
        ("1", "1", "no position"),
        ("6mm@1/8", "6mm@1/8", "without '@'"),
        ("1 up", "up", "not a position"),
        ("one 2", "one", "not a time"),
        ("-1 2", "-1", "shift"),
        ("1 2kg", "kg", "does not measure position"),
        ("1 2mm,", "2mm,", "not a position"),
        ("0 0 $", "$", "unknown word"),
    ],
)
def test_parse_table_mistake_place(row, marked, words):
    before = "".join(f"{i / 100:.2f} {i % 5}mm\n" for i in range(90))
    text = before + row + "\n5 0mm\n"
    error, under = fault(parse_table, text)
    assert under == marked
    assert words in error.message
    assert error.offset >= len(before)


def test_parse_table_of_100000_rows():
    n = 100_000
    notation = parse_table("".join(f"{i / 100:.2f} {i % 7}mm\n" for i in range(n)))
    assert len(notation.points) == n < MAX_EVENTS
    assert notation.points[-1].at.beats == (n - 1) / 100


numbers = st.integers(0, 999).map(lambda n: Fraction(n, 8))


@given(st.lists(st.tuples(numbers, st.integers(-14, 14), st.sampled_from(CURVES)), min_size=1))
def test_parse_table_equals_parse_of_line(rows):
    times = [sum((t + 1 for t, _, _ in rows[: i + 1]), Fraction()) for i in range(len(rows))]
    rows = [
        (t, x, "smooth" if c == "hold" else c) for t, (_, x, c) in zip(times, rows, strict=True)
    ]
    table = parse_table("\n".join(f"{t} {x}mm {c}" for t, x, c in rows))
    line = parse(
        " ".join([f"{rows[0][1]}@{rows[0][0]}"] + [f"{c} {x}@{t}" for t, x, c in rows[1:]])
    )
    assert plain(table)[1:] == plain(line)[1:]
    assert [p.at.beats for p in table.points] == [float(t) for t, _, _ in rows]


@given(st.text(alphabet="0123456789.@+-/()*| \nsmothrwlined#e", max_size=60))
def test_parse_of_random_text(text):
    for read in (parse, parse_table):
        try:
            notation = read(text)
        except TextError as error:
            assert 0 <= error.offset <= len(text)  # noqa: PT017
        else:
            times = [tuple(p.at) for p in notation.points]
            assert times == sorted(times)
