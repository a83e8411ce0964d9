"""Searching rising beats with few questions finds what halving finds."""

from bisect import bisect_left
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ergon.scores.pattern.search import first_index_from, n_before

BEAT = st.one_of(st.floats(-1e6, 1e6), st.sampled_from([inf, -inf, 0.0, 1.0]))


@given(beats=st.lists(BEAT, max_size=40).map(sorted), wanted=BEAT)
def test_n_before_equals_bisect_left(beats: list[float], wanted: float):
    assert n_before(beats, wanted) == bisect_left(beats, wanted)
    for item in beats:
        assert n_before(beats, item) == bisect_left(beats, item)


@pytest.mark.parametrize("wanted", [0.0, 0.25, 1234.5, 1234.6, 249999.75, 249999.8, inf])
def test_first_from_on_even_line_needs_few_calls(wanted: float):
    asked = []

    def value_of_point(number: int) -> float:
        asked.append(number)
        return 0.25 * number

    result = first_index_from(value_of_point, 1_000_000, wanted)
    assert result == (1_000_000 if wanted > 249999.75 else -int(-wanted // 0.25))
    assert len(asked) <= 5
