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
    proxy_fields: Mapping[str, Any],
    members_of: Callable[[Target], Sequence[int]],
) -> int:
    """Add a PROXY; returns the index of its MAT. Raises EngineError."""
    mats = [mat for target in proxy_fields["of"] for mat in members_of(target)]
    if proxy_fields["shares"] is not None:
        return network.proxy(proxy_name, list(zip(mats, proxy_fields["shares"], strict=True)))
    columns = proxy_fields["columns"]
    mat_rows = [mats[first : first + columns] for first in range(0, len(mats), columns)]
    if proxy_fields["rim"] is not None:
        rim_mat = members_of(proxy_fields["rim"])[0]
        mat_rows = [[rim_mat, *row, rim_mat] for row in mat_rows]
        if len(mat_rows) > 1:
            mesh_mats = [rim_mat] * len(mat_rows[0])
            mat_rows = [mesh_mats, *mat_rows, mesh_mats]
    if proxy_fields["follows"]:
        guides = [members_of(target)[0] for target in proxy_fields["follows"]]
        lengths = (
            _repeated_for_each(proxy_fields[name], len(guides)) for name in ("offset", "span")
        )
        side_positions = list(zip(guides, *lengths, strict=True))
    else:
        side_positions = [(None, at, 1.0) for at in proxy_fields["at"]]
    first_place = (None, 0.0, 1.0)
    mat_pair = side_positions[0], side_positions[-1]
    if len(side_positions) == 1:
        mat_pair = (
            (first_place, side_positions[0])
            if len(mat_rows) == 1
            else (side_positions[0], first_place)
        )
    all_mats = [mat for row in mat_rows for mat in row]
    return network.moving_proxy(proxy_name, all_mats, len(mat_rows[0]), mat_pair)


def _repeated_for_each(values: tuple[float, ...], count: int) -> tuple[float, ...]:
    return values if len(values) == count else values * count


def targets(fields: Mapping[str, Any]) -> list[Target]:
    """All targets in its fields."""
    rim = [fields["rim"]] if fields["rim"] else []
    return [*fields["of"], *fields["follows"], *rim]
