"""Values of what varies, and the mistakes in writing them."""

import pytest

from ergon.notation.text.edit import EditError
from ergon.scores.edits.varying import parse, value_combinations


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("bell.m.K=1kN/m..9kN/m:3", ("1kN/m", "5kN/m", "9kN/m")),
        ("a.f=20Hz..2000Hz:3 log", ("20Hz", "200Hz", "2000Hz")),
        ("seed=3..6", ("3", "4", "5", "6")),
        ("seed = 1..9:3", ("1", "5", "9")),
        ("a.X0=-1mm..1mm:3", ("-1mm", "0mm", "1mm")),
        ("a.M=2e-3kg..1e-3kg:2", ("0.002kg", "0.001kg")),
        ("a.hardening=1N/m3..3N/m3:3", ("1N/m3", "2N/m3", "3N/m3")),
        ("a.f=A3, C4 ,200Hz", ("A3", "C4", "200Hz")),
        ("a.K=x0.5,x2", ("x0.5", "x2")),
    ],
)
def test_varying_values_by_form(text: str, values: tuple[str, ...]):
    assert parse(text).values == values
    assert parse(text).target == text.partition("=")[0].strip()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bell.m.K", "is not TARGET=VALUES"),
        ("=1", "is not TARGET=VALUES"),
        ("a.K=1,,2", "has an empty value; write a.K=1,2,5"),
        ("a.K=1,2,1", "has the value 1 twice"),
        ("a.K=1kN/m..2N/m:3", "write both ends in one unit; these are kN/m and N/m"),
        ("a.K=1kN/m..2kN/m:1", "from 2 to 10,000 points, not 1"),
        ("a.K=1kN/m..2kN/m:99999", "not 99999"),
        ("a.K=0N/m..2N/m:3 log", "both ends above 0"),
        ("a.K=2N/m..2N/m:3", "both ends of the range are 2N/m"),
        ("a.K=1.5N/m..2N/m", "say how many points the range has, such as a.K=1.5N/m..2N/m:8"),
        ("a.K=C4..D4:3", "is not a range"),
        ("seed=5..1", "a range rises"),
        ("seed=1..2:3", "a seed is a whole number"),
    ],
)
def test_varying_value_mistakes(text: str, message: str):
    with pytest.raises(EditError) as raised:
        parse(text)
    assert message in str(raised.value)


def test_products_and_pairs():
    a, b = parse("a=1,2"), parse("b=3,4")
    assert value_combinations([a, b], is_zipped=False) == [
        ("1", "3"),
        ("1", "4"),
        ("2", "3"),
        ("2", "4"),
    ]
    assert value_combinations([a, b], is_zipped=True) == [("1", "3"), ("2", "4")]
    for source, is_zipped, message in (
        ([a, parse("c=1,2,3")], True, "a has 2, c has 3"),
        ([a, a], False, "a varies twice"),
        ([parse("a=1..5000"), parse("b=1..5000")], False, "25,000,000 variants"),
    ):
        with pytest.raises(EditError, match=message):
            value_combinations(source, is_zipped=is_zipped)
