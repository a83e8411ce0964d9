"""Functions of numbers in values of a model, which are those of expressions of gen~."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Container, Mapping
from fractions import Fraction

from ergon import _core
from ergon.notation.tables.expressions import MAX_DEPTH, Amount, evaluate
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

_CALL = re.compile(r"(?<![\w.])([A-Za-z]\w*)\s*\(")
_WORD = re.compile(r"[A-Za-z_]\w*")
_CONSTANTS = {"pi": math.pi, "twopi": 2.0 * math.pi, "halfpi": 0.5 * math.pi, "e": math.e}


def _clip(x: float, low: float, high: float) -> float:
    return min(max(x, low), high)


# Each with its number of arguments.
_FUNCTIONS: Mapping[str, tuple[int, Callable[..., float]]] = {
    "abs": (1, abs),
    "sqrt": (1, math.sqrt),
    "exp": (1, _core.exp),
    "exp2": (1, lambda x: _core.pow(2.0, x)),
    "ln": (1, math.log),
    "log": (1, math.log),
    "log2": (1, math.log2),
    "log10": (1, math.log10),
    "sin": (1, _core.sin),
    "cos": (1, _core.cos),
    "tan": (1, math.tan),
    "asin": (1, math.asin),
    "acos": (1, math.acos),
    "atan": (1, math.atan),
    "sinh": (1, math.sinh),
    "cosh": (1, math.cosh),
    "tanh": (1, math.tanh),
    "floor": (1, math.floor),
    "ceil": (1, math.ceil),
    "trunc": (1, math.trunc),
    "fract": (1, lambda x: x - math.trunc(x)),
    "sign": (1, lambda x: (x > 0.0) - (x < 0.0)),
    "neg": (1, lambda x: -x),
    "mtof": (1, lambda x: 440.0 * _core.pow(2.0, (x - 69.0) / 12.0)),
    "ftom": (1, lambda x: 69.0 + 12.0 * math.log2(x / 440.0)),
    "dbtoa": (1, lambda x: _core.pow(10.0, x / 20.0)),
    "atodb": (1, lambda x: 20.0 * math.log10(x)),
    "pow": (2, _core.pow),
    "min": (2, min),
    "minimum": (2, min),
    "max": (2, max),
    "maximum": (2, max),
    "mod": (2, math.fmod),
    "hypot": (2, math.hypot),
    "atan2": (2, math.atan2),
    "clip": (3, _clip),
    "clamp": (3, _clip),
    "mix": (3, lambda x, y, share: x + (y - x) * share),
}


def is_score_expression(text: str, params: Container[str]) -> bool:
    """Whether a score can have an expression: it has no functions but `sqrt`, and no constants."""
    constants = (word in _CONSTANTS and word not in params for word in _WORD.findall(text))
    return all(word == "sqrt" for word in _CALL.findall(text)) and not any(constants)


def evaluate_with_functions(
    text: str, amounts_by_name: Mapping[str, Amount], expected: str
) -> Amount:
    """The value of an expression of numbers, names and functions. Raises TextError."""
    constants = {name: Amount(Fraction(number), "") for name, number in _CONSTANTS.items()}
    return _evaluate(text, {**constants, **amounts_by_name}, expected, 0)


def _evaluate(
    text: str, amounts_by_name: Mapping[str, Amount], expected: str, depth: int
) -> Amount:
    if depth > MAX_DEPTH:
        raise TextError(f"functions are nested at most {MAX_DEPTH} deep")
    amounts, position, call_free_text = dict(amounts_by_name), 0, ""
    while (call := _CALL.search(text, position)) is not None:
        arguments, call_end = _arguments(text, call.end())
        call_name = f"call_{depth}_{call_end}"
        argument_values = [
            _evaluate(part, amounts_by_name, expected, depth + 1) for part in arguments
        ]
        amounts[call_name] = Amount(Fraction(_apply(call[1], argument_values)), "")
        call_free_text += f"{text[position : call.start()]} {call_name} "
        position = call_end
    return evaluate(call_free_text + text[position:], amounts, expected=expected)


def _arguments(text: str, text_position: int) -> tuple[list[str], int]:
    """The arguments between parentheses, and where what follows them begins."""
    arguments, depth, argument_begin = [], 0, text_position
    for index in range(text_position, len(text)):
        character = text[index]
        if depth == 0 and character in ",)":
            arguments.append(text[argument_begin:index])
            argument_begin = index + 1
            if character == ")":
                return arguments, argument_begin
        depth += (character == "(") - (character == ")")
    raise TextError(f"a parenthesis is never closed in {quote(text)}")


def _apply(function_name: str, arguments: list[Amount]) -> float:
    if function_name not in _FUNCTIONS:
        message = f"{quote(function_name)} is not a function of gen~ that is read here"
        raise TextError(message, suggestion=nearest(function_name, _FUNCTIONS))
    n_arguments, function = _FUNCTIONS[function_name]
    if len(arguments) != n_arguments:
        message = f"{function_name} has {n_arguments} arguments, and here {len(arguments)}"
        raise TextError(message if n_arguments > 1 else message.replace("arguments", "argument"))
    if any(argument.unit for argument in arguments):
        raise TextError(f"{function_name} takes plain numbers")
    try:
        number = float(function(*(float(argument.number) for argument in arguments)))
    except (ArithmeticError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        argument_texts = ", ".join(f"{float(argument.number):g}" for argument in arguments)
        raise TextError(f"{function_name}({argument_texts}) has no value")
    return number
