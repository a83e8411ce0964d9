"""A model as a score under `units: ca`, which sounds the same sample for sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

from ergon.notation.tables.expressions import Amount
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import NAMES
from ergon.workshop.models.mims.heard import audible_ends, output
from ergon.workshop.models.mims.laws import Laws
from ergon.workshop.models.mims.links import link
from ergon.workshop.models.mims.masses import MAKERS, push
from ergon.workshop.models.mims.model import Model
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.naming import Params, metres
from ergon.workshop.models.page import RATE, Input, Line, Page, number


def written(
    model: Model,
    laws: Laws = "head",
    inputs_by_name: Mapping[str, Input] | None = None,
    score_title: str = "",
) -> str:
    """The text of a score with the same sound as a model. Raises ModelError with the line at fault.

    `laws`: those that mi-gen had in 2019, for which older models were made, or today's.
    """
    params = (
        statement.name
        for statement in model.statements_of("param")
        if statement.name not in model.signals
    )
    inputs_by_name = inputs_by_name or {}
    first_values = {
        signal: Amount(Fraction(inputs_by_name[source].first), "")
        for signal, source in model.signals.items()
        if source in inputs_by_name
    }
    if first_values:
        model = replace(model, params={**model.params, **first_values}, _numbers={})
    writing = Writing(model, laws, inputs_by_name, Params(params))
    try:
        for statement in model.statements_of("mass", "macro", "input"):
            MAKERS[statement.keyword](writing, statement)
        for statement in model.statements_of("input"):
            push(writing, statement)
        listened = audible_ends(writing)
        for statement in model.statements_of("link"):
            link(writing, statement, listened)
        for statement in model.statements_of("output"):
            output(writing, statement)
    except ModelError as error:
        error.file = model.file
        raise
    for macro in writing.macros.values():
        if macro.is_joined:
            place = "" if macro.height == "0" else f"X0: {metres(macro.height)}"
            writing.add(macro.edge, f"SOL: {{{place}}}", f"the fixed points of {macro.name}")
    return _page(writing, score_title).written()


def _page(writing: Writing, score_title: str) -> Page:
    model = writing.model
    laws_words = "2019" if writing.laws == "2019" else "today"
    params = {
        statement.name: float(model.params[statement.name].number)
        for statement in model.statements_of("param")
    }
    params = {name: value for name, value in params.items() if name not in model.signals}
    fed_names = [name for name in model.inputs if name in writing.inputs]
    return Page(
        head=[
            f"From {score_title or 'a model'}, in the language of {NAMES[model.dialect]}, laws of "
            f"{laws_words}.",
            f"One sample is 1/{RATE} s; the numbers are those of the discrete network.",
        ],
        parameters=[
            Line(writing.params.new_names[name], number(value)) for name, value in params.items()
        ],
        inputs={name: writing.inputs[name] for name in fed_names} | writing.takes,
        pushes=[
            statement.name
            for statement in model.statements_of("input")
            if statement.keyword == "frcInput"
        ],
        modules=writing.modules,
        outs=writing.outs,
        before_strikes=["An input jumps to its first value, which the model's dampers feel."],
        strikes=list(_strikes(writing)),
    )


def _strikes(writing: Writing) -> Iterator[Line]:
    for target, force in writing.kicks.items():
        name = writing.names.new(f"{target.replace('.', '_')}_kick")
        yield Line(name, f"{{to: model.{target}, at: 0s, impulse: {force / RATE!r}Ns}}")
