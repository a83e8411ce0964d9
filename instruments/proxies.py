"""PROXY: a massless point between masses, which moves with them and passes forces on to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ergon import _core
from ergon.instruments.model import Target
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Shape

_WEIGHT_FIELDS = ("shares", "at", "follows")


def proxy_record(endpoint: Shape) -> Record:
    """The fields of a PROXY; `endpoint` reads one module or some of its members."""
    module_fields = (
        Field(
            "of",
            ListOf(endpoint, 1, single=True),
            "the masses that it lies between, in order, such as string or [nut, string.all]",
            required=True,
        ),
        Field("shares", ListOf(value_kinds.NUMBER, 1, single=True), "how much of each it is"),
        Field(
            "at",
            ListOf(value_kinds.NUMBER, 1, 2, single=True),
            "where it is, in masses from the first: 12.4; on a mesh its row and its column",
        ),
        Field(
            "follows",
            ListOf(endpoint, 1, 2, single=True),
            "MATs whose positions move it: at 0 m it is at the first mass, at `span` at the last",
        ),
        Field(
            "offset",
            ListOf(value_kinds.POSITION, 1, 2, single=True),
            "added to what it follows",
            (0.0,),
        ),
        Field("span", ListOf(value_kinds.POSITION, 1, 2, single=True), "from end to end", (1.0,)),
        Field(
            "columns",
            value_kinds.integer(1, 100_000, "35"),
            "how many masses of a mesh are in a row",
            shown="all, or those of a rectangle",
        ),
        Field("rim", endpoint, "what holds the masses all around: the first and last place"),
    )
    return Record("module", "a massless point between masses", module_fields)


def check(proxy_values: Values) -> None:
    """Report fields that do not go together."""
    weight_fields = proxy_values.written(*_WEIGHT_FIELDS)
    if not weight_fields:
        message = f"{proxy_values.context.label('')}: a PROXY needs at, follows or shares"
        proxy_values.error("E103", message)
    elif len(weight_fields) > 1:
        message = (
            f"{proxy_values.context.label(weight_fields[1])}: `{weight_fields[0]}` is written too; "
            "keep one of the two"
        )
        proxy_values.error("E111", message, weight_fields[1])
    required_fields: dict[str, tuple[str, ...]] = dict.fromkeys(("offset", "span"), ("follows",))
    required_fields |= dict.fromkeys(("columns", "rim"), ("at", "follows"))
    for field_name in proxy_values.written(*required_fields):
        if not proxy_values.written(*required_fields[field_name]):
            message = (
                f"{proxy_values.context.label(field_name)}: only a PROXY with "
                f"{' or '.join(required_fields[field_name])} has "
            )
            proxy_values.error("E111", f"{message}this field", field_name)
    if 0.0 in (proxy_values["span"] or ()):
        message = (
            f"{proxy_values.context.label('span')}: a span of 0 m would not move it; write a length"
        )
        proxy_values.error("E105", message, "span")


def add(
    network: _core.Network,
    proxy_name: str,
    fields: Mapping[str, Any],
    members_of: Callable[[Target], Sequence[int]],
) -> int:
    """Add a PROXY; returns the index of its MAT. Raises EngineError."""
    mats = [mat for target in fields["of"] for mat in members_of(target)]
    if fields["shares"] is not None:
        return network.proxy(proxy_name, list(zip(mats, fields["shares"], strict=True)))
    columns = fields["columns"]
    rows = [mats[first : first + columns] for first in range(0, len(mats), columns)]
    if fields["rim"] is not None:
        rim_mat = members_of(fields["rim"])[0]
        rows = [[rim_mat, *row, rim_mat] for row in rows]
        if len(rows) > 1:
            rim_row = [rim_mat] * len(rows[0])
            rows = [rim_row, *rows, rim_row]
    if fields["follows"]:
        guides = [members_of(target)[0] for target in fields["follows"]]
        lengths = (_repeated_for_each(fields[name], len(guides)) for name in ("offset", "span"))
        positions = list(zip(guides, *lengths, strict=True))
    else:
        positions = [(None, at, 1.0) for at in fields["at"]]
    start = (None, 0.0, 1.0)
    position_pair = positions[0], positions[-1]
    if len(positions) == 1:
        position_pair = (start, positions[0]) if len(rows) == 1 else (positions[0], start)
    all_mats = [mat for row in rows for mat in row]
    return network.moving_proxy(proxy_name, all_mats, len(rows[0]), position_pair)


def _repeated_for_each(values: tuple[float, ...], n: int) -> tuple[float, ...]:
    return values if len(values) == n else values * n


def targets(fields: Mapping[str, Any]) -> list[Target]:
    """All targets in its fields."""
    rim = [fields["rim"]] if fields["rim"] else []
    return [*fields["of"], *fields["follows"], *rim]
