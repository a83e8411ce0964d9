"""A model as written: statements with their lines, macros not expanded, values as expressions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ergon.notation.tables.expressions import Amount
from ergon.notation.text.errors import TextError, quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims import functions
from ergon.workshop.models.mims.grammar import Dialect, Family


@dataclass(frozen=True, slots=True)
class Point:
    """A mass, or a place on a macro from 0 to 1, along one or two sides."""

    name: str
    places: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Statement:
    """One line: a name, a word of the grammar, the points that it joins, its values as written."""

    name: str
    keyword: str
    family: Family
    line: int
    points: tuple[Point, ...]
    values: Mapping[str, str]


@dataclass(slots=True)
class Model:
    """A whole model, and the values of its parameters."""

    file: str
    dialect: Dialect
    statements: tuple[Statement, ...]
    params: dict[str, Amount] = field(default_factory=dict)
    _numbers: dict[str, float] = field(default_factory=dict)  # values of expressions that were read

    def statements_of(self, *families: Family) -> tuple[Statement, ...]:
        """Statements of some families, in order."""
        return tuple(statement for statement in self.statements if statement.family in families)

    @property
    def signals(self) -> dict[str, str]:
        """Parameters that follow a signal, and the input of each."""
        params = (statement for statement in self.statements if statement.keyword == "audioParam")
        return {statement.name: statement.values["input"].removeprefix("@") for statement in params}

    @property
    def inputs(self) -> list[str]:
        """All inputs, of masses and of parameters."""
        declared = (statement.name for statement in self.statements_of("input"))
        return list(dict.fromkeys((*declared, *self.signals.values())))

    def value(self, statement: Statement, name: str, default: float = 0.0) -> float:
        """A value of a statement as a number; `default` where it is left out. Raises ModelError."""
        value_text = statement.values.get(name)
        if value_text is None:
            return default
        return self.number(value_text, f"{name} of {quote(statement.name)}", statement.line)

    def number(self, text: str, label: str, line: int) -> float:
        """The value of an expression, computed once. Raises ModelError."""
        if text not in self._numbers:
            self._numbers[text] = evaluate_number(text, self.params, label, line)
        return self._numbers[text]


def evaluate_number(
    expression_text: str, params: Mapping[str, Amount], error_label: str, line_number: int
) -> float:
    """The value of an expression of parameters and functions. Raises ModelError."""
    try:
        amount = functions.evaluate_with_functions(expression_text, params, "a parameter")
    except TextError as error:
        raise ModelError(f"{error_label}: {error.message}", line_number, error.suggestion) from None
    if amount.unit:
        raise ModelError(
            f"{error_label}: {quote(expression_text)} is neither a number nor a parameter",
            line_number,
        )
    return float(amount.number)
