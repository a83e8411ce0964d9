"""Where members of a generator begin: `X0: {at: centre, x: 1mm}`."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.notation.tables.compound import Either, ListOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import Name, Reference, Shape


@dataclass(frozen=True, slots=True)
class Start:
    """Members, and the value at which they start."""

    at: Name
    value: float


def start_shape(part_name: str, value_shape: Shape, value_name: str) -> Shape:
    """One value for all members, or values of some."""

    def build(values: Values) -> Start:
        return Start(values["at"], values[value_name])

    start_fields = (
        Field("at", Reference("members, such as centre, 12 or 3..8"), "which members", None, True),
        Field(value_name, value_shape, "the value", None, True),
    )
    start_record = Record("start", f"{part_name} of some members", start_fields, build)
    return Either(value_shape, start_record, ListOf(start_record))
