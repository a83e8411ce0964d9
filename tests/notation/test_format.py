"""`ergon fmt`: spacing changes, meaning and comments do not."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.notation.text.errors import TextError
from ergon.notation.text.format import _meaning, formatted

UNTIDY = """\
# yaml-language-server: $schema=./score-1.schema.json   
ergon: 1            # format version   
title: "deux  clés,  été "   
tempo:
  - { at: 1|1,bpm : 60,   meter: 4/4 }  # { kept ,as it is }
  - {at: 9|1, bpm: 60 -> 96,
     over: 4bar }
notes: |
  two spaces  
  stay here
gestures:
  é: {do: [ scale 0.5,stretch 1/4 ]}
  lean:
    points: |
      # t      x
      0  0mm
      1   3.5mm # up
      2.5   3.5mm hold   

      4 0mm
parts:
  remi: |
    # at   play
    A  lean   every 8
    3|2.5      remi-7


"""

TIDY = """\
# yaml-language-server: $schema=./score-1.schema.json
ergon: 1            # format version
title: "deux  clés,  été "
tempo:
  - {at: 1|1, bpm: 60, meter: 4/4}  # { kept ,as it is }
  - {at: 9|1, bpm: 60 -> 96,
     over: 4bar}
notes: |
  two spaces  
  stay here
gestures:
  é: {do: [scale 0.5, stretch 1/4]}
  lean:
    points: |
      # t      x
      0     0mm
      1     3.5mm  # up
      2.5   3.5mm   hold

      4     0mm
parts:
  remi: |
    # at   play
    A       lean every 8
    3|2.5   remi-7
"""


def test_format_spacing_of_examples():
    assert formatted(UNTIDY) == TIDY


def test_formatting_is_idempotent():
    assert formatted(TIDY) == TIDY


def test_format_preserves_aligned_columns():
    text = "points: |\n  # t      x\n  0        0mm\n  1        3.5mm   hold\n"
    assert formatted(text) == text


@pytest.mark.parametrize(
    "text",
    ["{a: , b: 1}\n", "a: |+\n  x\n\n\n", "? a\n: b\n", "a: {'b':1}\n", "[a: 1, {b}]\n", "", "\n"],
)
def test_format_of_unusual_yaml_keeps_meaning(text):
    try:
        result = formatted(text)
    except TextError as error:
        assert error.code == "E100"  # noqa: PT017
    else:
        assert _meaning(result) == _meaning(text)
        assert formatted(result) == result


@pytest.mark.parametrize("text", ["[" * 200_000, "{a: " * 50_000, "- " * 100_000])
def test_format_of_deep_yaml_is_bounded(text):
    with pytest.raises(TextError, match="the nesting is deeper than"):
        formatted(text)


def test_format_preserves_line_ends():
    assert formatted("a: {b:  1} \r\nc: [1,2]\r\n\r\n") == "a: {b: 1}\r\nc: [1, 2]\r\n"


def test_format_of_invalid_yaml_is_refused():
    with pytest.raises(TextError) as caught:
        formatted("ergon: 1\nkeys: {k1: [}\n")
    assert 9 <= caught.value.offset <= 22


@given(st.text(alphabet="ab:,{}[] \n|#-'\"é0", max_size=60))
def test_formatting_twice_is_formatting_once(text):
    try:
        once = formatted(text)
    except TextError:
        return
    assert formatted(once) == once
    assert _meaning(once) == _meaning(text)


cells = st.lists(st.sampled_from(["0", "1/2", "3.5mm", "hold", "# c", "A", "lean"]), max_size=5)


@given(st.lists(st.tuples(cells, st.integers(1, 4)), min_size=1, max_size=6), st.booleans())
def test_format_preserves_words_of_random_tables(rows, part):
    body = "\n".join("    " + (" " * gap).join(words) for words, gap in rows)
    text = ("parts:\n  ada: |\n" if part else "lean:\n  points: |\n") + body + "\n"
    try:
        once = formatted(text)
    except TextError:
        return
    assert once.split() == text.split()
    assert formatted(once) == once
