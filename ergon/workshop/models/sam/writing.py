"""A score of Synth-A-Modeler in the making: its modules, and parameters under `let:`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ergon.notation.tables.expressions import Amount, evaluate
from ergon.notation.text.errors import TextError
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.naming import Names, Params, metres
from ergon.workshop.models.page import Input, Line, Out, number
from ergon.workshop.models.sam.expressions import is_plain, names, parse
from ergon.workshop.models.sam.network import Link, Mass
from ergon.workshop.models.sam.reading import Sheet, Statement
from ergon.workshop.models.sam.values import Values, text_of_slider
from ergon.workshop.models.sam.words import LINKS, MASSES

_TEXT_MAX = 160  # characters of an expression; a score has 200


@dataclass(slots=True)
class Writing:
    """The state of the writing; `targets` are the names of statements in the score."""

    sheet: Sheet
    inputs: Mapping[str, Input]
    values: Values
    params: Params
    names: Names = field(default_factory=Names)
    parameters: dict[str, Line] = field(default_factory=dict)
    amounts: dict[str, Amount] = field(default_factory=dict)  # of `let:`
    modules: list[Line] = field(default_factory=list)
    targets: dict[str, str] = field(default_factory=dict)
    masses: dict[str, Mass] = field(default_factory=dict)
    links: dict[str, Link] = field(default_factory=dict)
    ears: dict[str, str] = field(default_factory=dict)  # springs that hear masses; "" is the ground
    outs: list[Out] = field(default_factory=list)
    hears_forces: bool = False  # whether forces of links are heard
    sixty: str = ""  # the parameter that makes a T60 of the model one of the score

    def add(self, text: str, statement: Statement, comment: str = "") -> None:
        """Add the module of a statement, with the comments of its line."""
        remark = "; ".join(word for word in (comment, statement.behind) if word)
        self.modules.append(
            Line(self.targets[statement.name], f"{{{text}}}", remark, statement.before)
        )


def let(
    writing: Writing,
    parameter_name: str,
    value_text: str,
    comment: str,
    comments_before: tuple[str, ...] = (),
    unit: str = "",
) -> None:
    """Add a parameter under `let:`. Raises ModelError."""
    score_name = writing.params.new_names[parameter_name]
    writing.parameters[score_name] = Line(
        score_name, f"{value_text}{unit}", comment, comments_before
    )
    try:
        writing.amounts[score_name] = evaluate(f"{value_text}{unit}", writing.amounts)
    except TextError as error:
        definition = writing.values.definitions.get(parameter_name)
        raise ModelError(
            f"{parameter_name}: {error.message}", definition.line if definition else 0
        ) from None


def _named(writing: Writing, value_name: str, line_number: int) -> bool:
    """Whether a name can be used under `let:`; it is added there, with the names that it needs."""
    definition = writing.values.definitions.get(value_name)
    if (
        value_name in writing.params.new_names
        and writing.params.new_names[value_name] in writing.parameters
    ):
        return True
    if definition is None or definition.arguments:
        return False
    named_value = writing.values.by_name(value_name, line_number)
    if not isinstance(named_value, float):
        return False
    if value_name in writing.values.overrides:
        let(writing, value_name, number(named_value), f"{definition.text} in the model")
        return True
    slider = text_of_slider(writing.values.tree(value_name))
    label, source = (definition.comment, definition.text) if slider is None else slider
    expression_text = _expression(writing, source, named_value, definition.line)
    remark = [label if slider is not None or expression_text is not None else definition.text]
    remark += [definition.comment] if definition.comment and remark != [definition.comment] else []
    let(
        writing,
        value_name,
        expression_text or number(named_value),
        "  ".join(filter(None, remark)),
        definition.before,
    )
    return True


def _expression(
    writing: Writing, expression_text: str, model_value: float, line_number: int
) -> str | None:
    """An expression of the score for one of the model, if it can be written and has the same
    value.
    """
    tree = parse(expression_text, line_number)
    if tree.kind == "number":
        return number(model_value)
    if not is_plain(tree) or len(expression_text) > _TEXT_MAX:
        return None
    order_by_name = {name: position for position, name in enumerate(writing.values.definitions)}
    used_names = sorted(names(tree), key=lambda name: order_by_name.get(name, -1))
    if not all(_named(writing, name, line_number) for name in used_names):
        return None
    score_expression = writing.params.written(expression_text)
    try:
        amount = evaluate(score_expression, writing.amounts)
    except TextError:
        return None
    is_same = math.isclose(float(amount.number), model_value, rel_tol=1e-15, abs_tol=0.0)
    return (
        score_expression
        if is_same and not amount.unit and len(score_expression) <= _TEXT_MAX
        else None
    )


def value_of(writing: Writing, model_statement: Statement, value_index: int) -> float:
    """A value of a statement as a number. Raises ModelError."""
    field_names = MASSES.get(model_statement.word) or LINKS[model_statement.word]
    return writing.values.number(
        model_statement.values[value_index],
        model_statement.line,
        f"{field_names[value_index % len(field_names)]} of {model_statement.name}",
    )


def text_of(writing: Writing, statement: Statement, value_index: int) -> str:
    """A value of a statement as an expression of the score. Raises ModelError."""
    value = value_of(writing, statement, value_index)
    expression = _expression(writing, statement.values[value_index], value, statement.line)
    return number(value) if expression is None else expression


def unit_of(value_text: str, unit: str) -> str:
    """An expression times a unit."""
    if metres(value_text) == f"{value_text}m":
        return f"{value_text}{unit}"
    return f"{value_text if value_text.isidentifier() else f'({value_text})'}*1{unit}"


def times(text: str, factor: str) -> str:
    """A product of expressions; a sum takes parentheses."""
    return f"({text})*{factor}" if any(sign in text[1:] for sign in "+-/") else f"{text}*{factor}"


def within(statement: Statement, name: str, value: float, limit: float) -> None:
    """Raises ModelError where a value is greater than a score holds."""
    if not abs(value) <= limit:
        raise ModelError(f"{name} is {value:g}: a score holds up to {limit:g}", statement.line)


def target(writing: Writing, mass_name: str) -> str:
    """A mass as a point of the score."""
    return (
        f"{writing.targets[mass_name]}.point"
        if writing.masses[mass_name].is_body
        else writing.targets[mass_name]
    )
