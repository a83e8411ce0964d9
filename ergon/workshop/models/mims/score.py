"""A model as a score under `units: ca`, which sounds the same sample for sample."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

from ergon.notation.tables.expressions import Amount
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.grammar import DIALECT_NAMES
from ergon.workshop.models.mims.heard import add_output, mass_by_heard_link
from ergon.workshop.models.mims.laws import Laws
from ergon.workshop.models.mims.links import add_link
from ergon.workshop.models.mims.masses import MAKERS, add_force_input
from ergon.workshop.models.mims.model import Model
from ergon.workshop.models.mims.writing import ScoreDraft
from ergon.workshop.models.naming import Params, length_text
from ergon.workshop.models.page import RATE, Input, Line, Page, number_text


def score_text(
    model: Model,
    laws: Laws = "head",
    inputs: Mapping[str, Input] | None = None,
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
    inputs = inputs or {}
    first_values = {
        signal: Amount(Fraction(inputs[source].first_sample), "")
        for signal, source in model.signals.items()
        if source in inputs
    }
    if first_values:
        model = replace(model, params={**model.params, **first_values}, _numbers={})
    draft = ScoreDraft(model, laws, inputs, Params(params))
    try:
        for statement in model.statements_of("mass", "macro", "input"):
            MAKERS[statement.keyword](draft, statement)
        for statement in model.statements_of("input"):
            add_force_input(draft, statement)
        mass_by_link = mass_by_heard_link(draft)
        for statement in model.statements_of("link"):
            add_link(draft, statement, mass_by_link)
        for statement in model.statements_of("output"):
            add_output(draft, statement)
    except ModelError as error:
        error.file = model.file
        raise
    for macro in draft.macros.values():
        if macro.needs_edge:
            x0_field = "" if macro.x0 == "0" else f"X0: {length_text(macro.x0)}"
            draft.add(macro.edge_name, f"SOL: {{{x0_field}}}", f"the fixed points of {macro.name}")
    return _page(draft, score_title).text()


def _page(draft: ScoreDraft, score_title: str) -> Page:
    model = draft.model
    laws_label = "2019" if draft.laws == "2019" else "today"
    params = {
        statement.name: float(model.params[statement.name].number)
        for statement in model.statements_of("param")
    }
    params = {name: value for name, value in params.items() if name not in model.signals}
    fed_names = [name for name in model.inputs if name in draft.inputs]
    return Page(
        header=[
            f"From {score_title or 'a model'}, in the language of {DIALECT_NAMES[model.dialect]}, "
            f"laws of {laws_label}.",
            f"One sample is 1/{RATE} s; the numbers are those of the discrete network.",
        ],
        parameters=[
            Line(draft.params.names_in_score[name], number_text(value))
            for name, value in params.items()
        ],
        inputs={name: draft.inputs[name] for name in fed_names} | draft.takes,
        force_inputs=[
            statement.name
            for statement in model.statements_of("input")
            if statement.keyword == "frcInput"
        ],
        modules=draft.modules,
        outputs=draft.outputs,
        strike_comments=["An input jumps to its first value, which the model's dampers feel."],
        strikes=list(_strikes(draft)),
    )


def _strikes(draft: ScoreDraft) -> Iterator[Line]:
    for target, force in draft.initial_forces.items():
        name = draft.names.new(f"{target.replace('.', '_')}_kick")
        yield Line(name, f"{{to: model.{target}, at: 0s, impulse: {force / RATE!r}Ns}}")
