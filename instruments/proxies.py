"""PROXY: a massless point between masses, which moves with them and passes forces on to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ergon import _core
from ergon.instruments.model import Target
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Shape

_WAYS = ("shares", "at", "follows")


def table(endpoint: Shape) -> Record:
    """The fields of a PROXY; `endpoint` reads one module or some of its members."""
    fields = (
        Field(
            "of",
            ListOf(endpoint, 1, single=True),
            "the masses that it lies between, in order, such as string or [nut, string.all]",
            required=True,
        ),
        Field("shares", ListOf(k.NUMBER, 1, single=True), "how much of each it is"),
        Field(
            "at",
            ListOf(k.NUMBER, 1, 2, single=True),
            "where it is, in masses from the first: 12.4; on a mesh its row and its column",
        ),
        Field(
            "follows",
            ListOf(endpoint, 1, 2, single=True),
            "MATs whose positions move it: at 0 m it is at the first mass, at `span` at the last",
        ),
        Field("offset", ListOf(k.POSITION, 1, 2, single=True), "added to what it follows", (0.0,)),
        Field("span", ListOf(k.POSITION, 1, 2, single=True), "from end to end", (1.0,)),
        Field(
            "columns",
            k.integer(1, 100_000, "35"),
            "how many masses of a mesh are in a row",
            shown="all, or those of a rectangle",
        ),
        Field("rim", endpoint, "what holds the masses all around: the first and last place"),
    )
    return Record("module", "a massless point between masses", fields)


def check(values: Values) -> None:
    """Report fields that do not go together."""
    ways = values.written(*_WAYS)
    if not ways:
        message = f"{values.context.label('')}: a PROXY needs at, follows or shares"
        values.error("E103", message)
    elif len(ways) > 1:
        message = (
            f"{values.context.label(ways[1])}: `{ways[0]}` is written too; keep one of the two"
        )
        values.error("E111", message, ways[1])
    only: dict[str, tuple[str, ...]] = dict.fromkeys(("offset", "span"), ("follows",))
    only |= dict.fromkeys(("columns", "rim"), ("at", "follows"))
    for name in values.written(*only):
        if not values.written(*only[name]):
            message = (
                f"{values.context.label(name)}: only a PROXY with {' or '.join(only[name])} has "
            )
            values.error("E111", f"{message}this field", name)
    if 0.0 in (values["span"] or ()):
        message = f"{values.context.label('span')}: a span of 0 m would not move it; write a length"
        values.error("E105", message, "span")


def add(
    network: _core.Network,
    name: str,
    fields: Mapping[str, Any],
    members: Callable[[Target], Sequence[int]],
) -> int:
    """Add a PROXY; returns the index of its MAT. Raises EngineError."""
    mats = [mat for target in fields["of"] for mat in members(target)]
    if fields["shares"] is not None:
        return network.proxy(name, list(zip(mats, fields["shares"], strict=True)))
    columns = fields["columns"]
    rows = [mats[first : first + columns] for first in range(0, len(mats), columns)]
    if fields["rim"] is not None:
        held = members(fields["rim"])[0]
        rows = [[held, *row, held] for row in rows]
        if len(rows) > 1:
            around = [held] * len(rows[0])
            rows = [around, *rows, around]
    if fields["follows"]:
        guides = [members(target)[0] for target in fields["follows"]]
        lengths = (_each(fields[name], len(guides)) for name in ("offset", "span"))
        along = list(zip(guides, *lengths, strict=True))
    else:
        along = [(None, at, 1.0) for at in fields["at"]]
    still = (None, 0.0, 1.0)
    pair = along[0], along[-1]
    if len(along) == 1:
        pair = (still, along[0]) if len(rows) == 1 else (along[0], still)
    all_mats = [mat for row in rows for mat in row]
    return network.moving_proxy(name, all_mats, len(rows[0]), pair)


def _each(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    return values if len(values) == count else values * count


def targets(fields: Mapping[str, Any]) -> list[Target]:
    """All targets in its fields."""
    rim = [fields["rim"]] if fields["rim"] else []
    return [*fields["of"], *fields["follows"], *rim]
