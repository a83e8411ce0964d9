"""Outputs of a model: positions, and forces at one end of links."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.points import targets_of_point
from ergon.workshop.models.mims.writing import ScoreDraft
from ergon.workshop.models.page import Output, gain_option
from ergon.workshop.models.refused import REFUSED


def _links_on(draft: ScoreDraft, mass_name: str) -> Iterator[Statement]:
    return (
        statement
        for statement in draft.model.statements_of("link")
        if any(point.name == mass_name for point in statement.points)
    )


def mass_by_heard_link(draft: ScoreDraft) -> dict[int, str]:
    """Links whose force is heard, and for each the mass on which it is heard. Raises ModelError."""
    mass_by_link: dict[int, str] = {}
    for statement in draft.model.statements_of("output"):
        mass_name = statement.points[0].name
        if statement.keyword != "frcOutput":
            continue
        if mass_name in draft.macros:
            raise ModelError(REFUSED["macro force"], statement.line)
        force_inputs = (i for i in draft.model.statements_of("input") if i.name in draft.inputs)
        if any(
            point.name == mass_name for force_input in force_inputs for point in force_input.points
        ):
            raise ModelError(REFUSED["pushed force"], statement.line)
        links = list(_links_on(draft, mass_name))
        if not links:
            raise ModelError(REFUSED["still force"], statement.line)
        for link in links:
            if mass_by_link.setdefault(id(link), mass_name) != mass_name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, statement.line)
    return mass_by_link


def add_output(draft: ScoreDraft, statement: Statement) -> None:
    """An output."""
    channel = int(statement.name.removeprefix("out"))
    if statement.keyword == "posOutput":
        targets = targets_of_point(draft, statement, statement.points[0])
        for output_number, (gain_factor, target) in enumerate(targets, 1):
            out_name = statement.name if len(targets) == 1 else f"{statement.name}_{output_number}"
            draft.outputs.append(
                Output(out_name, f"SOX: {target}", channel, gain_option(gain_factor))
            )
        return
    mass = statement.points[0].name
    link_names = [name for link, name in draft.links if any(p.name == mass for p in link.points)]
    kinds = {module.name: module.kind for module in draft.modules}
    for output_number, link_name in enumerate(link_names, 1):
        out_name = statement.name if len(link_names) == 1 else f"{statement.name}_{output_number}"
        draft.outputs.append(Output(out_name, f"SOF: {{{kinds[link_name]}: {link_name}}}", channel))
