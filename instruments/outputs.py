"""Outputs as written: `out: {SOX: m}`, or a mapping of names to such outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ergon.instruments.kinds.outputs import OUTPUTS, OutputKind
from ergon.instruments.module_kinds import tables
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Either, ListOf, NamesOf
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.shapes import MISSING, NAME, Context, Name, Reference, Shape, wrong_shape
from ergon.notation.text import document
from ergon.notation.text.document import Node
from ergon.notation.text.errors import quote
from ergon.notation.text.spelling import nearest as near_word
from ergon.notation.text.values import Place


@dataclass(frozen=True)
class WrittenOutput:
    """`SOX: m` or `SOF: b` as written, before names are looked up."""

    name: str
    kind: str
    names: tuple[Name, ...]
    nearest: str | None
    place: Place
    is_distance: bool


_LISTENED_MODULES = ListOf(
    Reference("a module, or several in brackets", ("modules",)), count_min=1, single=True
)
_SOF = Record(
    "SOF",
    "a link by its kind, or the forces of a bank's members at their nearest loudspeakers",
    (Field("nearest", value_kinds.PATH, "a layout of loudspeakers"),),
    kinds={kind: _LISTENED_MODULES for kind in tables("si")},
)
DISTANCE = Record(
    "distance",
    "the distance of two points in space, of which the position, speed or acceleration is heard",
    (Field("between", ListOf(_LISTENED_MODULES.item, 2, 2), "two points in space", required=True),),
)


def _targets_shape(kind: OutputKind) -> Shape:
    if kind.is_energy:
        return _LISTENED_MODULES
    return Either(_LISTENED_MODULES.item, DISTANCE if kind.is_movement else _SOF, _LISTENED_MODULES)


_OUTPUT_SHAPES = {name: _targets_shape(kind) for name, kind in OUTPUTS.items()}


def _written_output(output_values: Values) -> Any:
    target_value = output_values.by_name.get(output_values.kind, MISSING)
    if target_value is MISSING:
        return MISSING
    nearest = None
    is_distance = isinstance(target_value, Values) and target_value.record is DISTANCE
    if is_distance:
        target_value = target_value["between"] or ()
    elif isinstance(target_value, Values):  # SOF: {BUT: b} or {nearest: file}
        nearest = target_value["nearest"]
        if (nearest is None) == (not target_value.kind):
            output_values.error(
                "E111", "SOF names a link by its kind, or a layout: nearest", output_values.kind
            )
            return MISSING
        target_value = target_value.by_name.get(target_value.kind, ()) if target_value.kind else ()
    end_names = (target_value,) if isinstance(target_value, Name) else target_value
    place = output_values.place_of(output_values.kind)
    return WrittenOutput(
        output_values.context.name, output_values.kind, end_names, nearest, place, is_distance
    )


_SINGLE_OUTPUT = Record(
    "output", "one output", (), _written_output, kinds=_OUTPUT_SHAPES, kind_required=True
)


_NAMED_OUTPUTS = NamesOf(_SINGLE_OUTPUT, "output", has_loops=True)


@dataclass(frozen=True)
class OutputsShape(Shape):
    """`{SOX: m}`, or a mapping of names to such outputs."""

    def read(self, node: Node, name: str, context: Context) -> Any:
        """Read a node."""
        if not isinstance(node, document.Mapping):
            scalar_text = node.text.strip() if isinstance(node, document.Scalar) else ""
            suggestion = f"{{SOX: {scalar_text}}}" if NAME.fullmatch(scalar_text) else None
            return wrong_shape(self, node, name, context, suggestion=suggestion)
        if self.chosen(node) is _SINGLE_OUTPUT:
            scalar_context = Context(context.collector, f"out of {context.owner}", "", node.place)
            value = _SINGLE_OUTPUT.read(node, name, scalar_context)
            return MISSING if value is MISSING else (value,)
        for entry_word, (key_node, child) in node.entries.items():
            is_close = (
                entry_word.isupper() or near_word(entry_word.upper(), _OUTPUT_SHAPES) is not None
            )
            if not isinstance(child, document.Mapping) and is_close:
                message = f"unknown output {quote(entry_word)} of {context.owner}"
                context.error(
                    "E101", message, key_node.place, word=entry_word, names=tuple(_OUTPUT_SHAPES)
                )
                return MISSING
        outputs_by_name = _NAMED_OUTPUTS.read(node, name, context)
        if outputs_by_name is MISSING:
            return MISSING
        return tuple(value for value in outputs_by_name.values() if value is not MISSING)

    def schema(self) -> dict[str, Any]:
        """As JSON Schema."""
        listener_schema = _SINGLE_OUTPUT.schema()
        return {**listener_schema, "additionalProperties": listener_schema}

    def words(self) -> str:
        """In words."""
        example = {"mats": "m", "links": "b"}
        output_examples = (
            f"{{{name}: {example[kind.sources]}}}, " for name, kind in OUTPUTS.items()
        )
        return f"{''.join(output_examples)}or names, each with one of these"

    def chosen(self, node: Node) -> Shape:
        """The table of one output, or that of named outputs."""
        words = node.entries if isinstance(node, document.Mapping) else {}
        return _SINGLE_OUTPUT if any(word in _OUTPUT_SHAPES for word in words) else _NAMED_OUTPUTS
