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
    mass_by_link: dict[int, str] = {}
    for statement in writing.model.statements_of("output"):
        mass_name = statement.points[0].name
        if statement.keyword != "frcOutput":
            continue
        if mass_name in writing.macros:
            raise ModelError(REFUSED["macro force"], statement.line)
        push_statements = (
            i for i in writing.model.statements_of("input") if i.name in writing.inputs
        )
        if any(
            point.name == mass_name
            for push_statement in push_statements
            for point in push_statement.points
        ):
            raise ModelError(REFUSED["pushed force"], statement.line)
        ending_links = list(_ending(writing, mass_name))
        if not ending_links:
            raise ModelError(REFUSED["still force"], statement.line)
        for link in ending_links:
            if mass_by_link.setdefault(id(link), mass_name) != mass_name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, statement.line)
    return mass_by_link


def output(writing: Writing, statement: Statement) -> None:
    """An output."""
    channel_number = int(statement.name.removeprefix("out"))
    if statement.keyword == "posOutput":
        targets = points(writing, statement, statement.points[0])
        for nth, (share, target) in enumerate(targets, 1):
            out_name = statement.name if len(targets) == 1 else f"{statement.name}_{nth}"
            writing.outs.append(Out(out_name, f"SOX: {target}", channel_number, gain(share)))
        return
    mass = statement.points[0].name
    link_names = [name for link, name in writing.links if any(p.name == mass for p in link.points)]
    kinds = {module.name: module.kind for module in writing.modules}
    for nth, link_name in enumerate(link_names, 1):
        out_name = statement.name if len(link_names) == 1 else f"{statement.name}_{nth}"
        writing.outs.append(
            Out(out_name, f"SOF: {{{kinds[link_name]}: {link_name}}}", channel_number)
        )
