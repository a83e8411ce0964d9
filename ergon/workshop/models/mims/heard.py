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


def _ending(own: Writing, name: str) -> Iterator[Statement]:
    return (one for one in own.model.of("link") if any(point.name == name for point in one.points))


def heard_ends(own: Writing) -> dict[int, str]:
    """Links whose force is heard, and for each the mass on which it is heard. Raises ModelError."""
    heard: dict[int, str] = {}
    for one in own.model.of("output"):
        name = one.points[0].name
        if one.keyword != "frcOutput":
            continue
        if name in own.macros:
            raise ModelError(REFUSED["macro force"], one.line)
        pushes = (i for i in own.model.of("input") if i.name in own.inputs)
        if any(point.name == name for push in pushes for point in push.points):
            raise ModelError(REFUSED["pushed force"], one.line)
        links = list(_ending(own, name))
        if not links:
            raise ModelError(REFUSED["still force"], one.line)
        for link in links:
            if heard.setdefault(id(link), name) != name:
                message = REFUSED["both ends"].format(link=quote(link.name))
                raise ModelError(message, one.line)
    return heard


def output(own: Writing, one: Statement) -> None:
    """An output."""
    channel = int(one.name.removeprefix("out"))
    if one.keyword == "posOutput":
        found = points(own, one, one.points[0])
        for nth, (share, target) in enumerate(found, 1):
            name = one.name if len(found) == 1 else f"{one.name}_{nth}"
            own.outs.append(Out(name, f"SOX: {target}", channel, gain(share)))
        return
    mass = one.points[0].name
    of = [name for link, name in own.links if any(p.name == mass for p in link.points)]
    kinds = {each.name: each.kind for each in own.modules}
    for nth, name in enumerate(of, 1):
        out = one.name if len(of) == 1 else f"{one.name}_{nth}"
        own.outs.append(Out(out, f"SOF: {{{kinds[name]}: {name}}}", channel))
