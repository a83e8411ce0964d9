"""Outputs of a model: positions, and forces at one end of links."""

from __future__ import annotations

from collections.abc import Iterator

from ergon.notation.text.errors import quote
from ergon.workshop.models.errors import ModelError
from ergon.workshop.models.mims.model import Statement
from ergon.workshop.models.mims.points import points
from ergon.workshop.models.mims.writing import Writing
from ergon.workshop.models.page import Out, gain
from ergon.workshop.models.refused import REFUSED


def _ending(writing: Writing, mass_name: str) -> Iterator[Statement]:
    return (
        statement
        for statement in writing.model.statements_of("link")
        if any(point.name == mass_name for point in statement.points)
    )


def audible_ends(writing: Writing) -> dict[int, str]:
    """Links whose force is heard, and for each the mass on which it is heard. Raises ModelError."""
    names_by_link: dict[int, str] = {}
    for model_statement in writing.model.statements_of("output"):
        mass_name = model_statement.points[0].name
        if model_statement.keyword != "frcOutput":
            continue
        if mass_name in writing.macros:
            raise ModelError(REFUSED["macro force"], model_statement.line)
        pushes = (i for i in writing.model.statements_of("input") if i.name in writing.inputs)
        if any(point.name == mass_name for push in pushes for point in push.points):
            raise ModelError(REFUSED["pushed force"], model_statement.line)
        ending_links = list(_ending(writing, mass_name))
        if not ending_links:
            raise ModelError(REFUSED["still force"], model_statement.line)
        for link in ending_links:
            if names_by_link.setdefault(id(link), mass_name) != mass_name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, model_statement.line)
    return names_by_link


def output(writing: Writing, model_statement: Statement) -> None:
    """An output."""
    channel_number = int(model_statement.name.removeprefix("out"))
    if model_statement.keyword == "posOutput":
        targets = points(writing, model_statement, model_statement.points[0])
        for nth, (target_share, mass_target) in enumerate(targets, 1):
            link_name = (
                model_statement.name if len(targets) == 1 else f"{model_statement.name}_{nth}"
            )
            writing.outs.append(
                Out(link_name, f"SOX: {mass_target}", channel_number, gain(target_share))
            )
        return
    mass = model_statement.points[0].name
    link_names = [name for link, name in writing.links if any(p.name == mass for p in link.points)]
    kinds = {module.name: module.kind for module in writing.modules}
    for nth, link_name in enumerate(link_names, 1):
        out = model_statement.name if len(link_names) == 1 else f"{model_statement.name}_{nth}"
        writing.outs.append(Out(out, f"SOF: {{{kinds[link_name]}: {link_name}}}", channel_number))
