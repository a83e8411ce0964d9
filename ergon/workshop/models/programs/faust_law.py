"""Laws of LNL modules as functions of Faust, computed in the order in which the engine does."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from ergon.workshop.models.naming import Names
from ergon.workshop.models.programs.elements import Law

HELPERS = {
    "square": "square(x) = x*x;",
    "sign": "sign(x) = (x > 0.0) - (x < 0.0);",
    "tanh": 'tanh = ffunction(float tanhf|tanh|tanhl(float), <math.h>, "");',
}
_WORD = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[^\W\d]\w*")
_NO_LETTER = re.compile(r"\W", re.ASCII)
_CALLS = frozenset({"where", "abs", "min", "max", "sqrt", "sign", "exp", "tanh"})
# Infix operators and their precedence.
_INFIX: Mapping[type[ast.AST], tuple[str, int]] = {
    ast.Lt: (" < ", 1),
    ast.LtE: (" <= ", 1),
    ast.Gt: (" > ", 1),
    ast.GtE: (" >= ", 1),
    ast.Eq: (" == ", 1),
    ast.NotEq: (" != ", 1),
    ast.Add: (" + ", 2),
    ast.Sub: (" - ", 2),
    ast.Mult: ("*", 3),
    ast.Div: ("/", 3),
}
_PRECEDENCE_MAX = 4  # binds more tightly than any sign
_INTEGER_EXPONENT_MAX = (
    64.0  # the engine multiplies for whole exponents up to this, and calls pow beyond
)


@dataclass(slots=True)
class Laws:
    """Functions for the laws of a program: links with the same law share one."""

    name_by_law: dict[object, str] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    helpers: set[str] = field(default_factory=set)

    def function_name(self, law: Law, link_name: str) -> str:
        """The function (d [m], v [m/s]) -> force [N] of a law; `link_name` names the link."""
        law_fields = law.fields
        constants, points = law_fields["constants"], law_fields["points"]
        key = (law_fields["law"], law_fields["damping"], *sorted(constants.items()), str(points))
        if key not in self.name_by_law:
            self.name_by_law[key] = f"law_{link_name}"
            self.lines += self._function(
                f"law_{link_name}", law_fields["law"], law_fields["damping"], law
            )
        return self.name_by_law[key]

    def program_lines(self) -> Iterator[str]:
        """Lines of a program: what the functions need, and the functions."""
        yield from (text for name, text in HELPERS.items() if name in self.helpers)
        yield from self.lines

    def _function(
        self, function_name: str, law_text: str | None, damping: str | None, law: Law
    ) -> list[str]:
        constants, law_points = law.fields["constants"], law.fields["points"]
        faust_names = Names()
        faust_by_constant = {
            name: faust_names.new(f"c_{_NO_LETTER.sub('_', name)}") for name in constants
        }
        terms = [
            self._expression(name, faust_by_constant)
            for name in (law_text, damping)
            if name is not None
        ]
        if law_points:
            terms.insert(0, "line(d)")
        definitions = [
            f"  {faust_by_constant[name]} = {number_text(value)};"
            for name, value in constants.items()
        ]
        definitions += _piecewise_linear(law_points) if law_points else []
        head = f"{function_name}(d, v) = {' + '.join(terms)}"
        return [head, "with {", *definitions, "};"] if definitions else [f"{head};"]

    def _expression(self, text: str, faust_names: Mapping[str, str]) -> str:
        """An expression that the engine has accepted; its operators have the precedence of
        Python's.
        """
        python_names = {name: f"c{position}" for position, name in enumerate(faust_names)}

        def to_python_word(match: re.Match[str]) -> str:
            matched_word = match[0]
            is_reserved = matched_word in ("d", "v") or matched_word in _CALLS
            python_name = matched_word if is_reserved else python_names.get(matched_word)
            return python_name or repr(float(matched_word))

        tree = ast.parse(f"({_WORD.sub(to_python_word, text)})", mode="eval")
        faust_by_python_name = {
            f"c{position}": faust_name for position, faust_name in enumerate(faust_names.values())
        }
        return self._faust(tree.body, faust_by_python_name)

    def _faust(
        self, syntax_node: ast.expr, faust_names: Mapping[str, str], precedence_min: int = 0
    ) -> str:
        """A part of an expression, in parentheses if its precedence is below `precedence_min`."""

        def infix(a: ast.expr, operation: ast.AST, b: ast.expr) -> str:
            sign, precedence = _INFIX[type(operation)]
            text = (
                f"{self._faust(a, faust_names, precedence)}"
                f"{sign}{self._faust(b, faust_names, precedence + 1)}"
            )
            return f"({text})" if precedence < precedence_min else text

        match syntax_node:
            case ast.Constant(value=float(value)):
                return repr(value)
            case ast.Name(id=node_name):
                return faust_names.get(node_name, node_name)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self._faust(operand, faust_names, precedence_min)
            case ast.UnaryOp(operand=operand):
                return f"(0.0 - {self._faust(operand, faust_names, _PRECEDENCE_MAX)})"
            case ast.BinOp(left=a, op=ast.Pow(), right=b):
                return self._power(a, b, faust_names)
            case ast.BinOp(left=a, op=operation, right=b):
                return infix(a, operation, b)
            case ast.Compare(left=a, ops=[operation], comparators=[b]):
                return infix(a, operation, b)
            case ast.Call(func=ast.Name(id="where"), args=[condition, yes, no]):
                if isinstance(condition, ast.Compare):
                    condition_text = self._faust(condition, faust_names)
                else:
                    condition_text = f"{self._faust(condition, faust_names, 2)} != 0.0"
                branch_texts = f"{self._faust(no, faust_names)}, {self._faust(yes, faust_names)}"
                return f"select2({condition_text}, {branch_texts})"
            case ast.Call(func=ast.Name(id=node_name), args=arguments):
                self.helpers |= {node_name} & HELPERS.keys()
                argument_texts = ", ".join(
                    self._faust(argument, faust_names) for argument in arguments
                )
                return f"{node_name}({argument_texts})"
        raise AssertionError(ast.dump(syntax_node))

    def _power(self, base: ast.expr, exponent: ast.expr, faust_names: Mapping[str, str]) -> str:
        """A power by repeated squaring, from the highest bit of the exponent down, as the engine
        does.
        """
        degree = _integer_exponent(exponent)
        if degree is None:
            return f"pow({self._faust(base, faust_names)}, {self._faust(exponent, faust_names)})"
        base_text = power_text = self._faust(base, faust_names, _PRECEDENCE_MAX)
        for bit in bin(abs(degree))[3:]:
            self.helpers.add("square")
            power_text = f"square({power_text})" + (f"*{base_text}" if bit == "1" else "")
        power_text = power_text if abs(degree) == 1 else f"({power_text})" if degree else "1.0"
        return f"(1.0/{power_text})" if degree < 0 else power_text


def _integer_exponent(node: ast.expr) -> int | None:
    match node:
        case ast.Constant(value=float(degree)) if (
            degree == int(degree) and degree <= _INTEGER_EXPONENT_MAX
        ):
            return int(degree)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            magnitude = _integer_exponent(operand)
            return None if magnitude is None else -magnitude
    return None


def _piecewise_linear(points: Sequence[tuple[float, float]]) -> Iterator[str]:
    """Straight lines through points, extended beyond the first and the last; the segment is found
    by bisection.
    """
    segments = list(pairwise(points))
    slopes = [(f1 - f0) / (d1 - d0) for (d0, f0), (d1, f1) in segments]
    if len(slopes) == 1:
        ((d0, f0), _), (slope,) = segments[0], slopes
        yield f"  line(d) = {number_text(f0)} + {number_text(slope)}*(d - {number_text(d0)});"
        return
    steps = [2**bit for bit in reversed(range((len(slopes) - 1).bit_length()))]
    # The knots are padded with values that are never reached, so that every bisection step has a
    # knot to compare with.
    knots = [distance for distance, _ in points[1:-1]]
    knots += [sys.float_info.max] * (sum(steps) - len(knots))
    bisection = "".join(f" : next({step})" for step in steps)
    yield "  line(d) = force(at) + slope(at)*(d - from(at))"
    yield "  with {"
    yield f"    at = 0{bisection};"
    yield "    next(n, i) = i + n*(d >= knot(i + n - 1));"
    yield "  };"
    for table_name, table_values in (
        ("knot", knots),
        ("from", [distance for distance, _ in points[:-1]]),
        ("force", [force for _, force in points[:-1]]),
        ("slope", slopes),
    ):
        table_text = ", ".join(map(repr, table_values))
        yield f"  {table_name}(i) = waveform{{{table_text}}}, int(i) : rdtable;"


def number_text(number: float) -> str:
    """A number that Faust can read in any place."""
    return f"({number!r})" if number < 0 else repr(number)
