"""Laws of non-linear links as Python meets them."""

import math
from types import MappingProxyType

import pytest

from ergon._core import EngineError, Law, LawError


def test_law_force_and_potential_of_expression() -> None:
    law = Law("k*d + q*d**3", "z*v", {"k": 400.0, "q": 3e7, "z": 0.2})
    assert law.force(2e-3, 0.5) == pytest.approx(400 * 2e-3 + 3e7 * 8e-9 + 0.1, rel=1e-15)
    assert law.potential(2e-3) == pytest.approx(200 * 4e-6 + 7.5e6 * 1.6e-11, rel=1e-14)
    assert not law.is_active(0.01, 1.0)


def test_law_with_lever_preserves_power() -> None:
    near = Law("a*tanh(d/w)", constants={"a": 2.0, "w": 1e-3})
    far = Law("a*tanh(d/w)", constants={"a": 2.0, "w": 1e-3}, reach=3.0)
    for d in (-4e-3, 1e-4, 2e-3):
        assert 3.0 * far.force(3.0 * d) == pytest.approx(near.force(d), rel=1e-14)
        assert far.potential(3.0 * d) == pytest.approx(near.potential(d), rel=1e-13)
        closed = 2.0 * 1e-3 * math.log(math.cosh(d / 1e-3))
        assert near.potential(d) == pytest.approx(closed, rel=1e-11)


def test_law_of_points_and_of_bow() -> None:
    law = Law(
        points=[(-1.0, -2.0), (0.0, 0.0), (1.0, 1.0)],
        damping="f*tanh((v - 0.2)/w)",
        constants={"f": 0.3, "w": 1e-3},
    )
    assert law.force(5.0, 0.2) == 5.0
    assert law.is_active(0.01, 1.0)


@pytest.mark.parametrize(
    ("expression", "damping", "which", "offset", "length", "suggestion"),
    [
        ("stifness*d", None, "law", 0, 8, "stiffness"),
        ("d", "stiffness*v + tnah(v)", "damping", 14, 4, "tanh"),
        ("__import__", None, "law", 0, 10, None),
    ],
)
def test_law_error_offset_and_suggestion(
    expression: str, damping: str | None, which: str, offset: int, length: int, suggestion: str
) -> None:
    with pytest.raises(LawError) as caught:
        Law(expression, damping, MappingProxyType({"stiffness": 1.0}))
    error = caught.value
    assert isinstance(error, EngineError)
    assert isinstance(error, ValueError)
    assert (error.args[1], error.offset, error.length) == (which, offset, length)
    assert vars(error)["suggestion"] == suggestion
    assert error.module is None
