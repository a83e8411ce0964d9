"""Values of Synth-A-Modeler's expressions: numbers, lists, and sums of positions and forces.

A slider has its initial value.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.sam.expressions import Definition, Node, names_in, parse
from ergon.workshop.models.sam.words import RATE

SLIDERS = ("hslider", "vslider", "nentry")
_SMOOTHERS = ("onePoleBLT", "smooth", "paramSmooth")
_LIMITER = "SAMlimiter"
_STEPS_MAX = 200_000
_DEPTH_MAX = 150  # parts of expressions inside one another, definitions included
_UNARY_FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "db2linear": lambda x: 10.0 ** (x / 20.0),
    "mtof": lambda x: 440.0 * 2.0 ** ((x - 69.0) / 12.0),
    "int": lambda x: float(math.trunc(x)),
    "float": float,
    "round": lambda x: float(math.trunc(x + 0.5)),
    **{name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "floor")},
    "log10": math.log10,
    "abs": abs,
}
_BINARY_FUNCTIONS: Mapping[str, Callable[[float, float], float]] = {
    "pow": lambda x, y: math.pow(x, y),
    "min": min,
    "max": max,
}
_OPERATORS: Mapping[str, Callable[[float, float], float]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "%": math.fmod,
    "^": lambda x, y: math.pow(x, y),
}


# Definitions of the language's library, besides functions of numbers.
LIBRARY = {
    name: Definition(name, (), text, 0)
    for name, text in (("defaultOutputDSP", "highpass(4,20.0):SAMlimiter"), ("fs", f"{RATE}.0"))
}


@dataclass(frozen=True, slots=True)
class Filter:
    """A Butterworth high-pass; order 0 stands for the limiter of the library."""

    order: int
    cutoff: float  # [Hz]


@dataclass(frozen=True, slots=True)
class Mix:
    """A sum of positions and forces by their names, each with a factor; then filters."""

    terms: Mapping[str, float]
    filters: tuple[Filter, ...] = ()
    constant: float = 0.0


Value = float | Mix | tuple["Value", ...]


@dataclass(slots=True)
class Values:
    """Values by name. `audible` are the names of positions and forces, as sums."""

    definitions: Mapping[str, Definition]
    audible: Mapping[str, Mix] = field(default_factory=dict)
    overrides: Mapping[str, float] = field(default_factory=dict)
    _trees: dict[str, Node] = field(default_factory=dict)
    _values: dict[str, Value] = field(default_factory=dict)
    _definitions_open: list[str] = field(default_factory=list)
    _n_steps: int = 0
    _depth: int = 0

    def number(self, text: str, line: int, label: str) -> float:
        """The value of an expression that must be a number. Raises ModelError."""
        number_value = self._evaluate(parse(text, line), {}, line)
        if not isinstance(number_value, float):
            raise ModelError(f"{label}: {quote(text[:60])} is not a number", line)
        return number_value

    def mix(self, text: str, line: int) -> Mix:
        """The value of an expression that must be a sum. Raises ModelError."""
        sound_value = self._evaluate(parse(text, line), {}, line)
        if isinstance(sound_value, tuple):
            raise ModelError(f"{quote(text[:60])} is a list; an output has one channel", line)
        return sound_value if isinstance(sound_value, Mix) else Mix({}, (), sound_value)

    def tree(self, name: str) -> Node:
        """The expression of a name. Raises ModelError."""
        if name not in self._trees:
            definition = self.definitions[name]
            self._trees[name] = parse(definition.text, definition.line)
        return self._trees[name]

    def names_needed(self, name: str) -> set[str]:
        """The defined names that the definition of a name uses."""
        return names_in(self.tree(name)) & set(self.definitions)

    def by_name(self, value_name: str, line_number: int) -> Value:
        """The value of a name. Raises ModelError."""
        if value_name in self.overrides:
            return self.overrides[value_name]
        if value_name in self.audible:
            return self.audible[value_name]
        if value_name == "PI" and value_name not in self.definitions:
            return math.pi
        if value_name not in self.definitions:
            suggestion = nearest(value_name, [*self.definitions, *self.audible])
            raise ModelError(f"nothing is called {quote(value_name)}", line_number, suggestion)
        if value_name not in self._values:
            self._begin_definition(value_name, line_number)
            self._values[value_name] = self._evaluate(
                self.tree(value_name), {}, self.definitions[value_name].line
            )
            self._definitions_open.pop()
        return self._values[value_name]

    def _begin_definition(self, name: str, line: int) -> None:
        """Begin to read a definition. Raises ModelError."""
        if name in self._definitions_open:
            raise ModelError(f"{quote(name)} is defined by itself", line)
        self._definitions_open.append(name)

    def _evaluate(self, node: Node, arguments: Mapping[str, Value], line: int) -> Value:
        """The value of an expression; `arguments` are arguments of the function around it."""
        self._count(line)
        self._depth += 1
        value = self._evaluate_operation(node, arguments, line)
        self._depth -= 1
        return value

    def _count(self, line: int) -> None:
        """Raises ModelError if expressions take too many steps, or are nested too deeply."""
        self._n_steps += 1
        if self._n_steps > _STEPS_MAX or self._depth > _DEPTH_MAX:
            raise ModelError("its expressions are nested too deeply, or are too many", line)

    def _evaluate_operation(self, node: Node, arguments: Mapping[str, Value], line: int) -> Value:
        if node.kind == "number":
            return _finite(float(node.word), line)
        if node.kind == "name":
            return arguments[node.word] if node.word in arguments else self.by_name(node.word, line)
        if node.kind == "negative":
            return _combine("*", -1.0, self._evaluate(node.parts[0], arguments, line), line)
        if node.kind == "call":
            return self._evaluate_call(node, arguments, line)
        if node.kind == "chain" and node.operators[0] == ",":
            return tuple(self._evaluate(part, arguments, line) for part in node.parts)
        if node.kind == "chain":
            value = self._evaluate(node.parts[0], arguments, line)
            for sign, operand in zip(node.operators, node.parts[1:], strict=True):
                if sign == ":":
                    value = self._apply_to_input(operand, value, arguments, line)
                else:
                    value = _combine(sign, value, self._evaluate(operand, arguments, line), line)
            return value
        raise ModelError(f"{quote(node.word)} has no value by itself", line)

    # --- functions ------------------------------------------------------------------------------

    def _evaluate_call(self, node: Node, scope: Mapping[str, Value], line: int) -> Value:
        function_name = node.word
        if function_name in SLIDERS and function_name not in self.definitions:
            if len(node.parts) != 5:
                message = (
                    f"{function_name} is written {function_name}(label, value, least, most, step)"
                )
                raise ModelError(message, line)
            return self._evaluate(node.parts[1], scope, line)
        if function_name in ("checkbox", "button") and function_name not in self.definitions:
            return 0.0
        if (
            function_name == "mytake"
            and function_name not in self.definitions
            and len(node.parts) == 3
        ):
            return self._evaluate(node.parts[2], scope, line)  # the list of a table
        arguments = [self._evaluate(part, scope, line) for part in node.parts]
        if (
            function_name == "rdtable"
            and function_name not in self.definitions
            and len(arguments) == 3
        ):
            return _table_value(arguments, line)
        if (definition := self.definitions.get(function_name)) is not None:
            if len(definition.arguments) != len(arguments):
                message = (
                    f"{function_name} has {len(definition.arguments)} arguments, and here "
                    f"{len(arguments)}"
                )
                raise ModelError(message, line)
            self._begin_definition(function_name, line)
            arguments_by_name = dict(zip(definition.arguments, arguments, strict=True))
            value = self._evaluate(self.tree(function_name), arguments_by_name, definition.line)
            self._definitions_open.pop()
            return value
        numbers = [argument for argument in arguments if isinstance(argument, float)]
        if len(numbers) == len(arguments) == 1 and function_name in _UNARY_FUNCTIONS:
            return _apply(_UNARY_FUNCTIONS[function_name], numbers, line)
        if len(numbers) == len(arguments) == 2 and function_name in _BINARY_FUNCTIONS:
            return _apply(_BINARY_FUNCTIONS[function_name], numbers, line)
        known_functions = [*_UNARY_FUNCTIONS, *_BINARY_FUNCTIONS, *SLIDERS, *self.definitions]
        raise ModelError(
            f"of Faust {quote(function_name)} is not read here",
            line,
            nearest(function_name, known_functions),
        )

    def _takes_input(self, node: Node, arguments: Mapping[str, Value], depth: int = 0) -> bool:
        """Whether an expression takes an input."""
        if node.kind in ("input", "partial") or depth > _DEPTH_MAX:
            return True
        if node.kind == "call":
            is_defined = node.word in self.definitions
            return not is_defined and node.word in ("highpass", *_SMOOTHERS)
        if node.kind == "name":
            if node.word in arguments or node.word in self.audible or node.word in self.overrides:
                return False
            if node.word in self.definitions:
                if self.definitions[node.word].arguments:
                    return False
                return self._takes_input(self.tree(node.word), {}, depth + 1)
            return node.word in (*_UNARY_FUNCTIONS, *_SMOOTHERS, _LIMITER)
        if node.kind == "chain" and node.operators[0] == ":":
            return self._takes_input(node.parts[0], arguments, depth + 1)
        return any(self._takes_input(part, arguments, depth + 1) for part in node.parts)

    def _apply_to_input(
        self, node: Node, input_value: Value, arguments: Mapping[str, Value], line: int
    ) -> Value:
        """The output of an expression for an input value. Raises ModelError."""
        self._count(line)
        if not self._takes_input(node, arguments):
            raise ModelError("what stands behind ':' takes nothing in", line)
        if node.kind == "input":
            return input_value
        if node.kind == "partial":
            if len(node.parts) != 1:
                raise ModelError(f"{node.word}(...) takes one value here", line)
            return _combine(
                node.word, input_value, self._evaluate(node.parts[0], arguments, line), line
            )
        if node.kind == "name":
            if node.word in self.definitions:
                self._begin_definition(node.word, line)
                self._depth += 1
                input_value = self._apply_to_input(self.tree(node.word), input_value, {}, line)
                self._depth -= 1
                self._definitions_open.pop()
                return input_value
            if node.word in _SMOOTHERS:
                return _smooth(input_value, line)
            if node.word == _LIMITER and isinstance(input_value, Mix):
                return Mix(
                    input_value.terms, (*input_value.filters, Filter(0, 0.0)), input_value.constant
                )
            if not isinstance(input_value, float) or node.word == _LIMITER:
                raise ModelError(f"{node.word} of a sound is not built", line)
            return _apply(_UNARY_FUNCTIONS[node.word], [input_value], line)
        if node.kind == "call":
            if node.word in _SMOOTHERS:
                return _smooth(input_value, line)
            return self._highpassed(node, input_value, arguments, line)
        if node.kind == "chain" and node.operators[0] == ":":
            for part in node.parts:
                input_value = self._apply_to_input(part, input_value, arguments, line)
            return input_value
        takes_input = [self._takes_input(part, arguments) for part in node.parts]
        if sum(takes_input) != 1 or node.kind != "chain" or "," in node.operators:
            raise ModelError("more than one part behind ':' takes a sound in", line)
        operands = [
            self._apply_to_input(part, input_value, arguments, line)
            if has_input
            else self._evaluate(part, arguments, line)
            for part, has_input in zip(node.parts, takes_input, strict=True)
        ]
        result = operands[0]
        for sign, operand in zip(node.operators, operands[1:], strict=True):
            result = _combine(sign, result, operand, line)
        return result

    def _highpassed(
        self, node: Node, input_value: Value, arguments: Mapping[str, Value], line_number: int
    ) -> Value:
        argument_values = [self._evaluate(part, arguments, line_number) for part in node.parts]
        if len(argument_values) != 2 or not all(
            isinstance(number, float) for number in argument_values
        ):
            raise ModelError("highpass is written highpass(order, frequency)", line_number)
        order, cutoff = (number for number in argument_values if isinstance(number, float))
        if not (1.0 <= order <= 64.0 and order == int(order) and 0.0 < cutoff < RATE / 2):
            message = "highpass has an order from 1 to 64 and a frequency between 0 and 22,050 Hz"
            raise ModelError(message, line_number)
        if not isinstance(input_value, Mix):
            return 0.0  # a constant has no filtered part
        return Mix(input_value.terms, (*input_value.filters, Filter(int(order), cutoff)), 0.0)


def text_of_slider(slider_node: Node) -> tuple[str, str] | None:
    """The label and the initial value of a slider, with any smoothing skipped."""
    while slider_node.kind == "chain" and slider_node.operators[0] == ":":
        if not all(part.word in _SMOOTHERS for part in slider_node.parts[1:]):
            return None
        slider_node = slider_node.parts[0]
    if slider_node.kind != "call" or slider_node.word not in SLIDERS or len(slider_node.parts) != 5:
        return None
    label = slider_node.parts[0].word if slider_node.parts[0].kind == "text" else ""
    return re.sub(r"\s+", " ", label), slider_node.parts[1].text


def _smooth(signal: Value, line: int) -> Value:
    if isinstance(signal, float):
        return signal  # a slider that nobody moves
    raise ModelError("a low-pass of a sound is not built: a route has a high-pass alone", line)


def _table_value(arguments: list[Value], line_number: int) -> Value:
    """A value of a table."""
    _, table_rows, row_index = arguments
    if (
        not isinstance(table_rows, tuple)
        or not isinstance(row_index, float)
        or not 0 <= int(row_index) < len(table_rows)
    ):
        raise ModelError("rdtable is written rdtable(size, mytake(...), index) here", line_number)
    return table_rows[int(row_index)]


def _finite(number: float, line: int) -> float:
    if not math.isfinite(number):
        raise ModelError("a number is too large", line)
    return number


def _apply(function: Callable[..., float], values: list[float], line_number: int) -> float:
    try:
        return _finite(float(function(*values)), line_number)
    except (ArithmeticError, ValueError, TypeError):
        raise ModelError(
            "an expression has no value: it divides by 0, or is too large", line_number
        ) from (None)


def _combine(sign: str, a: Value, b: Value, line: int) -> Value:
    """Two values joined by an operator. Raises ModelError if the result is not a sum."""
    if isinstance(a, tuple) or isinstance(b, tuple):
        raise ModelError(f"{sign} of a list is not built", line)
    if isinstance(a, float) and isinstance(b, float):
        return _apply(_OPERATORS[sign], [a, b], line)
    if sign in "+-":
        return _sum(a, b if sign == "+" else _combine("*", -1.0, b, line), line)
    if sign == "*" and isinstance(a, float):
        a, b = b, a
    if isinstance(a, Mix) and isinstance(b, float) and sign in "*/":

        def scaled(x: float) -> float:
            return _apply(_OPERATORS[sign], [x, b], line)

        terms = {name: scaled(factor) for name, factor in a.terms.items()}
        return Mix(terms, a.filters, scaled(a.constant))
    raise ModelError("a product of sounds is not built: outputs are sums with factors", line)


def _sum(a: Value, b: Value, line_number: int) -> Mix:
    sounds = [
        sound if isinstance(sound, Mix) else Mix({}, (), sound)
        for sound in (a, b)
        if not isinstance(sound, tuple)
    ]
    chains = {sound.filters for sound in sounds if sound.terms}
    if len(chains) > 1:
        raise ModelError("a sum of sounds with filters of their own is not built", line_number)
    terms: dict[str, float] = {}
    for sound in sounds:
        for name, factor in sound.terms.items():
            terms[name] = _finite(terms.get(name, 0.0) + factor, line_number)
    constant = _finite(sum(sound.constant for sound in sounds), line_number)
    return Mix(terms, chains.pop() if chains else (), constant)
