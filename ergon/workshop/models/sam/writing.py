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

_MOST_TEXT = 160  # characters of an expression; a score has 200


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
    ears: dict[str, str] = field(default_factory=dict)  # of masses; "" is what stands still
    outs: list[Out] = field(default_factory=list)
    hears_forces: bool = False  # of links, not by springs that hear a position
    sixty: str = ""  # the parameter that makes a T60 of the model one of the score

    def add(self, text: str, one: Statement, comment: str = "") -> None:
        """Add the module of a statement, with the comments of its line."""
        said = "; ".join(word for word in (comment, one.behind) if word)
        self.modules.append(Line(self.targets[one.name], f"{{{text}}}", said, one.before))


def let(
    own: Writing, name: str, text: str, comment: str, before: tuple[str, ...] = (), unit: str = ""
) -> None:
    """Add a parameter under `let:`. Raises ModelError."""
    said = own.params.of[name]
    own.parameters[said] = Line(said, f"{text}{unit}", comment, before)
    try:
        own.amounts[said] = evaluate(f"{text}{unit}", own.amounts)
    except TextError as error:
        one = own.values.definitions.get(name)
        raise ModelError(f"{name}: {error.message}", one.line if one else 0) from None


def _named(own: Writing, name: str, line: int) -> bool:
    """Whether a name can be used under `let:`; it is added there, with the names that it needs."""
    one = own.values.definitions.get(name)
    if name in own.params.of and own.params.of[name] in own.parameters:
        return True
    if one is None or one.arguments:
        return False
    value = own.values.by_name(name, line)
    if not isinstance(value, float):
        return False
    if name in own.values.given:
        let(own, name, number(value), f"{one.text} in the model")
        return True
    slider = text_of_slider(own.values.tree(name))
    label, said = (one.comment, one.text) if slider is None else slider
    text = _expression(own, said, value, one.line)
    remark = [label if slider is not None or text is not None else one.text]
    remark += [one.comment] if one.comment and remark != [one.comment] else []
    let(own, name, text or number(value), "  ".join(filter(None, remark)), one.before)
    return True


def _expression(own: Writing, text: str, value: float, line: int) -> str | None:
    """An expression of the score for one of the model, if it can be written and has the same
    value.
    """
    tree = parse(text, line)
    if tree.kind == "number":
        return number(value)
    if not is_plain(tree) or len(text) > _MOST_TEXT:
        return None
    order = {name: at for at, name in enumerate(own.values.definitions)}
    used = sorted(names(tree), key=lambda name: order.get(name, -1))
    if not all(_named(own, name, line) for name in used):
        return None
    said = own.params.written(text)
    try:
        found = evaluate(said, own.amounts)
    except TextError:
        return None
    same = math.isclose(float(found.number), value, rel_tol=1e-15, abs_tol=0.0)
    return said if same and not found.unit and len(said) <= _MOST_TEXT else None


def value_of(own: Writing, one: Statement, at: int) -> float:
    """A value of a statement as a number. Raises ModelError."""
    what = MASSES.get(one.word) or LINKS[one.word]
    return own.values.number(one.values[at], one.line, f"{what[at % len(what)]} of {one.name}")


def text_of(own: Writing, one: Statement, at: int) -> str:
    """A value of a statement as an expression of the score. Raises ModelError."""
    value = value_of(own, one, at)
    found = _expression(own, one.values[at], value, one.line)
    return number(value) if found is None else found


def unit_of(text: str, unit: str) -> str:
    """An expression times a unit."""
    if metres(text) == f"{text}m":
        return f"{text}{unit}"
    return f"{text if text.isidentifier() else f'({text})'}*1{unit}"


def times(text: str, factor: str) -> str:
    """A product of expressions; a sum takes parentheses."""
    return f"({text})*{factor}" if any(sign in text[1:] for sign in "+-/") else f"{text}*{factor}"


def within(one: Statement, name: str, value: float, most: float) -> None:
    """Raises ModelError where a value is greater than a score holds."""
    if not abs(value) <= most:
        raise ModelError(f"{name} is {value:g}: a score holds up to {most:g}", one.line)


def target(own: Writing, mass: str) -> str:
    """A mass as a point of the score."""
    return f"{own.targets[mass]}.point" if own.masses[mass].is_body else own.targets[mass]
