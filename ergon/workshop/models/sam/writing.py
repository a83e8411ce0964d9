"""A score of Synth-A-Modeler in the making: its modules, and parameters under `let:`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ergon.notation.tables.expressions import Amount, evaluate
from ergon.notation.text.errors import TextError
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.naming import Names, Params, is_read_alike, length_text
from ergon.workshop.models.page import Input, Line, Output, number_text
from ergon.workshop.models.sam.expressions import is_plain, names_in, parse
from ergon.workshop.models.sam.network import Link, Mass
from ergon.workshop.models.sam.reading import Sheet, Statement
from ergon.workshop.models.sam.values import Values, text_of_slider
from ergon.workshop.models.sam.words import LINKS, MASSES

_TEXT_MAX = 160  # characters of an expression; a score has 200


@dataclass(slots=True)
class ScoreDraft:
    """A score in the making; `module_names` are the names of statements in the score."""

    sheet: Sheet
    inputs: Mapping[str, Input]
    values: Values
    params: Params
    names: Names = field(default_factory=Names)
    parameters: dict[str, Line] = field(default_factory=dict)
    amounts: dict[str, Amount] = field(default_factory=dict)  # of `let:`
    modules: list[Line] = field(default_factory=list)
    module_names: dict[str, str] = field(default_factory=dict)
    masses: dict[str, Mass] = field(default_factory=dict)
    links: dict[str, Link] = field(default_factory=dict)
    position_springs: dict[str, str] = field(
        default_factory=dict
    )  # springs that hear masses; "" is the ground
    outputs: list[Output] = field(default_factory=list)
    hears_forces: bool = False  # whether forces of links are heard
    t60_parameter: str = ""  # the parameter that makes a T60 of the model one of the score

    def add(self, text: str, statement: Statement, comment: str = "") -> None:
        """Add the module of a statement, with the comments of its line."""
        remark = "; ".join(word for word in (comment, statement.comment) if word)
        self.modules.append(
            Line(
                self.module_names[statement.name], f"{{{text}}}", remark, statement.comments_before
            )
        )


def add_parameter(
    draft: ScoreDraft,
    parameter_name: str,
    value_text: str,
    comment: str,
    comments_before: tuple[str, ...] = (),
    unit: str = "",
) -> None:
    """Add a parameter under `let:`. Raises ModelError."""
    score_name = draft.params.names_in_score[parameter_name]
    draft.parameters[score_name] = Line(score_name, f"{value_text}{unit}", comment, comments_before)
    try:
        draft.amounts[score_name] = evaluate(f"{value_text}{unit}", draft.amounts)
    except TextError as error:
        definition = draft.values.definitions.get(parameter_name)
        raise ModelError(
            f"{parameter_name}: {error.message}", definition.line if definition else 0
        ) from None


def _add_named(draft: ScoreDraft, value_name: str, line_number: int) -> bool:
    """Whether a name can be used under `let:`; it is added there, with the names that it needs."""
    definition = draft.values.definitions.get(value_name)
    if (
        value_name in draft.params.names_in_score
        and draft.params.names_in_score[value_name] in draft.parameters
    ):
        return True
    if definition is None or definition.arguments:
        return False
    named_value = draft.values.by_name(value_name, line_number)
    if not isinstance(named_value, float):
        return False
    if value_name in draft.values.overrides:
        add_parameter(
            draft, value_name, number_text(named_value), f"{definition.text} in the model"
        )
        return True
    slider = text_of_slider(draft.values.tree(value_name))
    label, source = (definition.comment, definition.text) if slider is None else slider
    expression_text = _expression(draft, source, named_value, definition.line)
    remark = [label if slider is not None or expression_text is not None else definition.text]
    remark += [definition.comment] if definition.comment and remark != [definition.comment] else []
    add_parameter(
        draft,
        value_name,
        expression_text or number_text(named_value),
        "  ".join(filter(None, remark)),
        definition.comments_before,
    )
    return True


def _expression(draft: ScoreDraft, text: str, number: float, line: int) -> str | None:
    """An expression of the score for one of the model, if it can be written and has the same
    value.
    """
    tree = parse(text, line)
    if tree.kind == "number":
        return number_text(number)
    if not is_plain(tree) or len(text) > _TEXT_MAX:
        return None
    order_by_name = {name: position for position, name in enumerate(draft.values.definitions)}
    used_names = sorted(names_in(tree), key=lambda name: order_by_name.get(name, -1))
    if not all(_add_named(draft, name, line) for name in used_names):
        return None
    score_expression = draft.params.translated(text)
    if not used_names and not is_read_alike(score_expression):
        return None
    try:
        amount = evaluate(score_expression, draft.amounts)
    except TextError:
        return None
    is_same = math.isclose(float(amount.number), number, rel_tol=1e-15, abs_tol=0.0)
    return (
        score_expression
        if is_same and not amount.unit and len(score_expression) <= _TEXT_MAX
        else None
    )


def value_of(draft: ScoreDraft, model_statement: Statement, value_index: int) -> float:
    """A value of a statement as a number. Raises ModelError."""
    field_names = MASSES.get(model_statement.word) or LINKS[model_statement.word]
    return draft.values.number(
        model_statement.values[value_index],
        model_statement.line,
        f"{field_names[value_index % len(field_names)]} of {model_statement.name}",
    )


def text_of(draft: ScoreDraft, statement: Statement, value_index: int) -> str:
    """A value of a statement as an expression of the score. Raises ModelError."""
    value = value_of(draft, statement, value_index)
    expression = _expression(draft, statement.values[value_index], value, statement.line)
    return number_text(value) if expression is None else expression


def with_unit(value_text: str, unit: str) -> str:
    """An expression times a unit."""
    if length_text(value_text) == f"{value_text}m":
        return f"{value_text}{unit}"
    return f"{value_text if value_text.isidentifier() else f'({value_text})'}*1{unit}"


def product_of(text: str, factor: str) -> str:
    """A product of expressions; a sum takes parentheses."""
    return f"({text})*{factor}" if any(sign in text[1:] for sign in "+-/") else f"{text}*{factor}"


def check_range(statement: Statement, name: str, checked_value: float, limit: float) -> None:
    """Raises ModelError where a value is greater than a score holds."""
    if not abs(checked_value) <= limit:
        raise ModelError(
            f"{name} is {checked_value:g}: a score holds up to {limit:g}", statement.line
        )


def target_text(draft: ScoreDraft, mass_name: str) -> str:
    """A mass as a point of the score."""
    return (
        f"{draft.module_names[mass_name]}.point"
        if draft.masses[mass_name].is_body
        else draft.module_names[mass_name]
    )
