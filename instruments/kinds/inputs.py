"""ENX and ENF: a position or a force that is imposed on a MAT."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from typing import Any

from ergon.instruments.kinds.kind import ENDPOINT, Kind, Quantities, module_kind
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field
from ergon.notation.tables.shapes import MISSING, Context, Reference, Shape, Text, wrong_shape
from ergon.notation.text.document import Node, Scalar


@dataclass(frozen=True)
class DriveSource(Shape):
    """What drives an ENX or ENF: a take's name, or a constant."""

    constant: Text

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, Scalar):
            return wrong_shape(self, node, name, context)
        if re.fullmatch(r"[a-z]+\d+\.\d+", node.text):
            message = (
                f"{context.label(name)}: an axis of a device is not "
                "built yet; write a take or a constant"
            )
            context.error("E108", message, node.place)
            return MISSING
        if re.match(r"[+-]?[.\d]", node.text):
            return self.constant.read(node, name, context)
        return Reference(self.words()).read(node, name, context)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["string", "number"]}

    def words(self) -> str:
        """In words."""
        return f"a take, or {self.constant.what}"


def _fields(value_shape: Text, quantity: str, quantities: Quantities) -> tuple[Field, ...]:
    return (
        Field("to", ENDPOINT, "the MAT that it drives", required=True),
        Field("from", DriveSource(value_shape), f"where its {quantity} comes from", required=True),
        Field("at", value_kinds.WHEN, "when a take begins", shown="the beginning"),
        Field("scale", value_kinds.NUMBER, "factor of a take", 1.0),
    )


def _drive_kind(name: str, value_shape: Text, quantity: str) -> Kind:
    fields = partial(_fields, value_shape, quantity)
    return module_kind(name, "input", f"an imposed {quantity}", fields, space=fields)


ENX = _drive_kind("ENX", value_kinds.POSITION, "position")
ENF = _drive_kind("ENF", value_kinds.PUSH, "force")
