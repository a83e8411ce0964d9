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


def _ending(writing: Writing, name: str) -> Iterator[Statement]:
    return (
        statement
        for statement in writing.model.statements_of("link")
        if any(point.name == name for point in statement.points)
    )


def audible_ends(writing: Writing) -> dict[int, str]:
    """Links whose force is heard, and for each the mass on which it is heard. Raises ModelError."""
    names_by_link: dict[int, str] = {}
    for statement in writing.model.statements_of("output"):
        name = statement.points[0].name
        if statement.keyword != "frcOutput":
            continue
        if name in writing.macros:
            raise ModelError(REFUSED["macro force"], statement.line)
        pushes = (i for i in writing.model.statements_of("input") if i.name in writing.inputs)
        if any(point.name == name for push in pushes for point in push.points):
            raise ModelError(REFUSED["pushed force"], statement.line)
        links = list(_ending(writing, name))
        if not links:
            raise ModelError(REFUSED["still force"], statement.line)
        for link in links:
            if names_by_link.setdefault(id(link), name) != name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, statement.line)
    return names_by_link


def output(writing: Writing, statement: Statement) -> None:
    """An output."""
    channel = int(statement.name.removeprefix("out"))
    if statement.keyword == "posOutput":
        targets = points(writing, statement, statement.points[0])
        for nth, (share, target) in enumerate(targets, 1):
            name = statement.name if len(targets) == 1 else f"{statement.name}_{nth}"
            writing.outs.append(Out(name, f"SOX: {target}", channel, gain(share)))
        return
    mass = statement.points[0].name
    link_names = [name for link, name in writing.links if any(p.name == mass for p in link.points)]
    kinds = {module.name: module.kind for module in writing.modules}
    for nth, name in enumerate(link_names, 1):
        out = statement.name if len(link_names) == 1 else f"{statement.name}_{nth}"
        writing.outs.append(Out(out, f"SOF: {{{kinds[name]}: {name}}}", channel))
