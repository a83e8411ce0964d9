"""Plays in words, rows of parts, and when their occurrences begin."""

import itertools
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.clock.occurrences import parse_times, starts
from ergon.notation.clock.positions import Length, parse_length, parse_position
from ergon.notation.clock.tempo import Entry, TempoMap
from ergon.notation.text.errors import TextError
from ergon.scores.pattern.words import parse, parse_row, rows

FLAT = TempoMap()
RAMP = TempoMap([Entry(parse_position("0"), 60.0, 120.0, Length(beats=64))])


def test_parse_words_of_play():
    text = "knock at A every 1 times 16 do scale 0.5, mirror until C layer touch tracked"
    play = parse(text)
    assert play.played == ("knock", 0)
    assert {name: word.text for name, word in play.options.items()} == {
        "at": "A",
        "every": "1",
        "times": "16",
        "until": "C",
        "layer": "true",
        "touch": "tracked",
    }
    assert [(t.word, t.amount) for t in play.transforms] == [("scale", 0.5), ("mirror", 1.0)]
    for word in [w for name, w in play.options.items() if name != "layer"]:
        assert text[word.offset :].startswith(word.text)
    assert [text[t.offset : t.offset + t.length] for t in play.transforms] == [
        "scale 0.5",
        "mirror",
    ]


def test_parse_transformations_in_play():
    play = parse("solo from 4 stretch 2 reverse")
    assert [t.word for t in play.transforms] == ["from", "stretch", "reverse"]
    jitter = parse("a do jitter 4ms 0.2mm, scale 2 every 1").transforms
    assert [t.word for t in jitter] == ["jitter", "scale"]


@pytest.mark.parametrize(
    ("text", "marked", "words", "suggestion"),
    [
        ("lean evry 8", "evry", "unknown word", "every"),
        ("lean 8", "8", "unknown word", None),
        ("lean every", "every", "needs a value: every 1", None),
        ("lean every times 2", "every", "needs a value", None),
        ("lean every 1 every 2", "every", "written twice", None),
        ("lean do", "do", "needs a transformation", None),
        ("lean do scale 0.5,", ",", "needs a transformation", None),
        ("lean do scale 0.5 evry 8", "evry", "unknown word", "every"),
        ("lean do miror", "miror", "unknown transformation", "mirror"),
        ("lean do scale", "scale", "another number of values", None),
        ("lean, every 1", ",", "unknown word", None),
        ("lean layer true", "true", "'layer' takes no value", None),
        ("every 1", "every", "gesture or take is missing", None),
        ("", "", "gesture or take is missing", None),
    ],
)
def test_parse_mistake_place_and_suggestion(text, marked, words, suggestion):
    with pytest.raises(TextError) as caught:
        parse(text)
    error = caught.value
    where = error.offset if text.count(marked) < 2 else text.index(marked)
    assert text[where : where + error.length] == marked
    assert words in error.message
    assert error.suggestion == suggestion


def test_parse_mistake_with_offset():
    with pytest.raises(TextError) as caught:
        parse("lean evry 8", 100)
    assert caught.value.offset == 105


TABLE = """# at   play
A      lean every 8 times 2   # twice
\t
3|2.5  remi-7 do mirror
"""


def parse_rows(text):
    return [parse_row(row, offset) for row, offset in rows(text)]


def test_parse_rows_of_part_table():
    read = parse_rows(TABLE)
    assert [(r.at.text, r.play.played.text) for r in read] == [("A", "lean"), ("3|2.5", "remi-7")]
    for row in read:
        for word in (row.at, row.play.played, *row.play.options.values()):
            assert TABLE[word.offset :].startswith(word.text)
        for t in row.play.transforms:
            assert TABLE[t.offset : t.offset + t.length] == "mirror"


def test_parse_row_mistake_offsets():
    mistakes = []
    for row, offset in rows("A knok evry 1\nB lean\nC lean at 4\nD\n"):
        try:
            parse_row(row, offset)
        except TextError as error:
            mistakes.append(error.offset)
    assert mistakes == [7, 31, 33]


@pytest.mark.parametrize(
    ("row", "example"), [("  bad", "write 1|1 bad"), ("3|1", "write 3|1 knock")]
)
def test_parse_row_of_one_word_is_refused(row, example):
    with pytest.raises(TextError, match=re.escape(example)) as caught:
        parse_row(row)
    error = caught.value
    assert row[error.offset : error.offset + error.length] == row.strip()


@given(st.text(alphabet="abdeilmnorstuvxy ,0123456789.#\n", max_size=50))
def test_parse_rows_of_random_text(text):
    try:
        parse_rows(text)
    except TextError as error:
        assert 0 <= error.offset <= len(text)  # noqa: PT017


def begin(tempo=FLAT, at=0.0, length=(2.0, 0.0), every=None, times=None, until=None, **more):
    apart = None if every is None else parse_length(every)
    return starts(tempo, at, Length(0.0, *length), every=apart, times=times, until=until, **more)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, [0]),
        ({"times": 3}, [0, 2, 4]),
        ({"times": 3, "every": "1"}, [0, 1, 2]),
        ({"until": 6}, [0, 2, 4]),
        ({"until": 6.5}, [0, 2, 4, 6]),
        ({"until": 6, "times": 2}, [0, 2]),
        ({"until": 3, "times": 9}, [0, 2]),
        ({"at": 4.0, "until": 4}, []),
        ({"at": 1.0, "every": "1bar", "times": 3}, [1, 5, 9]),
        ({"every": "1/3", "until": 1}, [0, 1 / 3, 2 / 3]),
        ({"length": (0, 0.5), "times": 3}, [0, 0.5, 1]),
        ({"length": (0, 0), "times": 1}, [0]),
    ],
)
def test_occurrences_of_play_options(options, expected):
    assert begin(**options) == expected


def test_occurrences_follow_the_tempo():
    apart = begin(RAMP, every="500ms", times=5)
    assert [RAMP.seconds(b) for b in apart] == pytest.approx([0, 0.5, 1, 1.5, 2])
    mixed = begin(RAMP, at=8.0, length=(1, 0.25), times=4)
    for a, b in itertools.pairwise(mixed):
        assert RAMP.seconds(b) == pytest.approx(RAMP.seconds(a + 1) + 0.25)


def test_occurrences_do_not_drift():
    assert begin(every="0.1", times=1001)[-1] == 100.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"length": (0, 0), "times": 2}, "has no duration"),
        ({"every": "0", "times": 2}, "above 0"),
        ({"every": "0", "until": 2}, "above 0"),
        ({"until": 1e9, "every": "1"}, "more than 1,000,000"),
        ({"times": 11, "room": 10}, "more than 1,000,000"),
    ],
)
def test_occurrences_are_bounded(options, words):
    with pytest.raises(TextError, match=words):
        begin(**options)


@pytest.mark.parametrize("text", ["0", "-1", "1.5", "x", "", "99999999", "1000001"])
def test_parse_times_of_invalid_numbers(text):
    with pytest.raises(TextError, match="number of repetitions"):
        parse_times(text)
    assert parse_times(" 16 ") == 16
