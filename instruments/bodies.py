"""Decay and bending of strings and plates: fields that take more than one number."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, Context, Shape, wrong_shape
from ergon.notation.text import document
from ergon.notation.text.document import Node

MAX_DECAYS = 64
DEFAULT_POISSON = 0.3  # approximately that of steel and brass


@dataclass(frozen=True)
class Decays(Shape):
    """`{100Hz: 8s, 4kHz: 1s}`: decays at frequencies, as pairs in rising frequency."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, document.Mapping):
            return wrong_shape(self, node, name, context)
        node_pairs = []
        for key, child in node.entries.values():
            pair = (
                value_kinds.PITCH.read(key, name, context),
                value_kinds.DURATION.read(child, name, context),
            )
            if MISSING in pair:
                return MISSING
            node_pairs.append(pair)
        if not 2 <= len(node_pairs) <= MAX_DECAYS:
            message = (
                f"{context.label(name)}: decays at {len(node_pairs)} frequencies are written; "
                f"write from 2 to {MAX_DECAYS}, or one time for the lowest mode"
            )
            context.error("E106", message, node.place)
            return MISSING
        return tuple(sorted(node_pairs))

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return {"type": ["object"], "additionalProperties": value_kinds.DURATION.schema()}

    def words(self) -> str:
        """In words."""
        return "decays at frequencies, such as {100Hz: 8s, 4kHz: 1s}"


def _poisson(values: Values) -> Any:
    return values["poisson"]


@dataclass(frozen=True)
class _DecayShape(Either):
    """One decay, or decays at frequencies; the error for a list explains two-stage decay."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Sequence):
            return wrong_shape(self, node, name, context, help=_TWO_STAGE_ADVICE)
        return Either.read(self, node, name, context)


_TWO_STAGE_ADVICE = (
    "no mode falls in two stages; two strings of one pitch with a damper between them do "
    '(docs/language.md, "Two-stage decay")'
)
DECAY_SHAPE = _DecayShape(value_kinds.DURATION, Decays())
_BENDING = Record(
    "bending",
    "how a plate resists curvature",
    (Field("poisson", value_kinds.POISSON, "Poisson's ratio", DEFAULT_POISSON),),
    _poisson,
)


@dataclass(frozen=True)
class Bending(Shape):
    """`true`, `false` or `{poisson: 0.33}`: Poisson's ratio, or None for a plate without
    bending.
    """

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if isinstance(node, document.Mapping):
            return _BENDING.read(node, name, context)
        is_bending = value_kinds.BOOLEAN.read(node, name, context)
        if is_bending is MISSING:
            return MISSING
        return DEFAULT_POISSON if is_bending else None

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        return Either(value_kinds.BOOLEAN, _BENDING).schema()

    def words(self) -> str:
        """In words."""
        return "true, false or {poisson: 0.33}"
