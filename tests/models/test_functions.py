"""Functions of numbers in models of mi-gen, beside those of Python."""

from __future__ import annotations

import math
import random

import pytest

from ergon.scores.reading.load import load
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims import functions
from ergon.workshop.models.mims.reading import parse
from ergon.workshop.models.mims.score import score_text

_SINGLE = {
    "abs": abs, "sqrt": math.sqrt, "exp": math.exp, "exp2": lambda x: 2.0**x, "ln": math.log,
    "log": math.log, "log2": math.log2, "log10": math.log10, "sin": math.sin, "cos": math.cos,
    "floor": math.floor, "ceil": math.ceil, "trunc": math.trunc, "tanh": math.tanh,
    "mtof": lambda x: 440.0 * 2.0 ** ((x - 69.0) / 12.0), "dbtoa": lambda x: 10.0 ** (x / 20.0),
}  # fmt: skip
_DOUBLE = {"pow": math.pow, "min": min, "max": max, "minimum": min, "maximum": max}


def _drawn(chance: random.Random, depth: int) -> tuple[str, float]:
    """An expression of gen~, and its value by Python."""
    kind = chance.choice(["number", "single", "double", "sum"]) if depth else "number"
    if kind == "number":
        number = round(chance.uniform(0.5, 4.0), 3)
        return f"{number}", number
    a, x = _drawn(chance, depth - 1)
    b, y = _drawn(chance, depth - 1)
    if kind == "sum":
        sign = chance.choice("+*")
        return f"({a} {sign} {b})", x + y if sign == "+" else x * y
    if kind == "single":
        name = chance.choice([*_SINGLE])
        return f"{name}({a})", float(_SINGLE[name](x))
    name = chance.choice([*_DOUBLE])
    return f"{name}( {a},{b} )", float(_DOUBLE[name](x, y))


def test_model_functions_equal_python() -> None:
    chance, compared = random.Random(5), 0
    while compared < 300:
        try:
            text, number = _drawn(chance, 3)
        except (ArithmeticError, ValueError):
            continue
        if not 1e-9 < abs(number) < 1e12 or len(text) > 180:
            continue
        value = float(functions.evaluate_with_functions(text, {}, "a parameter").number)
        assert value == pytest.approx(number, rel=1e-12), text
        compared += 1


def _drawn_sum(chance: random.Random, depth: int, names: tuple[str, ...]) -> str:
    """An expression of numbers, names, signs and parentheses, with spaces by chance."""
    space = chance.choice(["", "", " "])
    if not depth or chance.random() < 0.15:
        number = chance.choice(["1", "20", "2.", ".5", "0.25", "1.75", "3e-1", "1/20", "0.2/4"])
        return chance.choice([number, number, chance.choice(names or (number,))])
    if chance.random() < 0.25:
        return f"({_drawn_sum(chance, depth - 1, names)})"
    a, b = (_drawn_sum(chance, depth - 1, names) for _ in range(2))
    return f"{a}{space}{chance.choice('+-*///')}{space}{b}"


def test_random_expressions_compile_to_values_of_python() -> None:
    """Of parameters and values of both dialects; what is written is a score without mistakes."""
    chance, compared = random.Random(11), 0
    names_by_model = {"v1": (), "v2": ("k", "rate_2")}
    while compared < 120:
        dialect = chance.choice(["v1", "v2", "v2"])
        text = _drawn_sum(chance, chance.choice([1, 1, 2, 3]), names_by_model[dialect])
        try:
            number = eval(text, {}, {"k": 0.1, "rate_2": 2.5})
        except ZeroDivisionError:
            continue
        if not 1e-3 < number < 0.5 or len(text) > 120:
            continue
        written_text = text.replace(" ", "") if dialect == "v1" else f"[{text}]"
        model = (
            "@k param 0.1\n@rate_2 param 2.5\n@g ground 0.\n@m mass 2. 0. 0.\n"
            f"@s springDamper @m @g {written_text} {written_text}\n@out1 posOutput @m\n"
        )
        loaded = load("model.yaml", text=score_text(parse(model, dialect)))
        assert loaded.piece is not None, (text, [item.message for item in loaded.diagnostics])
        spring = loaded.piece.instruments["model"].modules[-1]
        values = [spring.fields["K"], spring.fields["Z"]]
        assert values == pytest.approx([number, number], rel=1e-12), text
        compared += 1


MODEL = """
@a param 4
@m mass [pow(a, 0.5)] 0 0
@g ground 0
@s springDamper @g @m [max(0.01, min(0.1, abs(0 - 0.05)))] [0.001*exp(-(a - 2))]
@t spring @g @m [0.001*pi]
@out1 posOutput @m
"""


def test_model_functions_in_mass_parameter() -> None:
    text = score_text(parse(MODEL, "v2"))
    assert "m: {MAS: {M: 2.0}}" in text
    assert f"K: 0.05, Z: {0.001 * math.exp(-2.0)!r}" in text
    assert f"K: {0.001 * math.pi!r}" in text
    louder = score_text(parse(MODEL, "v2", "", {"a": "9"}))
    assert "m: {MAS: {M: 3.0}}" in louder


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("pwo(a, 2)", "'pwo' is not a function"),
        ("pow(a)", "pow has 2 arguments, and here 1"),
        ("sqrt(0 - a)", "sqrt(-4) has no value"),
        ("exp(1000)", "exp(1000) has no value"),
        ("pow(a, 2", "never closed"),
    ],
)
def test_model_functions_with_mistakes_refused(expression: str, message: str) -> None:
    with pytest.raises(ModelError, match=r"M of 'm'") as refused:
        parse(MODEL.replace("pow(a, 0.5)", expression), "v2")
    assert message in str(refused.value)
    assert refused.value.line == 3
