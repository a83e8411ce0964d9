"""Merges fields module by module: one's own values over those of `like:` and `from:`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ergon.instruments.transpose import (
    Interval,
    instrument_at_note,
    transposed_base,
    transposed_frequency,
)
from ergon.notation.tables import notes
from ergon.notation.tables.fields import Values

# Groups of fields that exclude each other: writing one group removes the others of the base (K for
# f, a table for a line).
_EXCLUSIVE_FIELDS: Mapping[str, tuple[tuple[tuple[str, ...], ...], ...]] = {
    "key": ((("K", "Z"), ("f", "t60"), ("modules", "struck")),),
    "gesture": ((("notation",), ("points",)),),
    "CEL": ((("K", "Z"), ("f", "t60")),),
    "STRING": (
        (("inharmonicity",), ("stiffness",)),
        (("tension",), ("f",)),
        (("K", "Z"), ("f", "t60")),
    ),
    "PLATE": ((("radius",), ("sides",)), (("K", "Z"), ("f", "t60"))),
    "MODES": ((("modes",), ("f", "t60", "places")),),
}
_LAW_FIELDS = ("law", "damping", "points")


def overlay_fields(base_values: Values, member_values: Values) -> Values:
    """The base's fields under one's own, also within modules; transformations are appended.

    An `f` of one's own is moved by one's own `transpose`; that of the base is moved already.
    """
    hidden_names = _hidden_fields(member_values, member_values.record.noun) | {"transpose"}
    if member_values.written("notes"):  # members of the base have no meaning for other notes
        hidden_names.add("members")
    body = member_values.by_name.get(member_values.kind)
    if isinstance(body, Values):  # fields inside a generator precede those beside it
        hidden_names.update(body.written("f", "t60", "M"))
        if body.written("K", "Z"):
            hidden_names.update(("f", "t60"))
    module_fields = {
        name: value for name, value in base_values.by_name.items() if name not in hidden_names
    }
    module_nodes = {
        name: node for name, node in base_values.nodes.items() if name not in hidden_names
    }
    for field_name, field_value in member_values.by_name.items():
        if field_name == "modules" and isinstance(module_fields.get(field_name), dict):
            field_value = _merged_modules(module_fields[field_name], field_value)
        elif field_name == "do" and field_name in module_fields:
            field_value = (*module_fields[field_name], *field_value)
        elif field_name == member_values.kind == base_values.kind and isinstance(
            field_value, Values
        ):
            field_value = _merged_fields(field_name, module_fields.get(field_name), field_value)
        elif field_name == "members" and isinstance(module_fields.get(field_name), dict):
            field_value = {**module_fields[field_name], **field_value}
        elif (
            field_name == "f"
            and isinstance(field_value, tuple)
            and "transpose" in member_values.by_name
        ):
            field_value = tuple(
                transposed_frequency(pitch_value, member_values.by_name["transpose"])
                for pitch_value in field_value
            )
        module_fields[field_name] = field_value
    module_fields.pop("transpose", None)
    module_nodes.update(member_values.nodes)
    body_kind = member_values.kind or base_values.kind
    return Values(
        member_values.record,
        member_values.node,
        member_values.context,
        module_fields,
        module_nodes,
        {**base_values.free, **member_values.free},
        body_kind,
    )


def fields_of_note(values: Values, note_pitch: float) -> Values | None:
    """The fields that are written for one note of an instrument, by its pitch."""
    for word, member_values in (values["members"] or {}).items():
        if notes.pitch(word) == note_pitch:
            assert isinstance(member_values, Values)
            return member_values
    return None


def shifted_note(
    instrument_values: Values, note_name: str, interval: Interval | None = None
) -> Values:
    """An instrument with notes at one of its notes, with the fields that are written for that note;
    moved by the `interval` of the whole instrument, and by that of the note.
    """
    base_values, member_values = (
        instrument_at_note(instrument_values, note_name),
        fields_of_note(instrument_values, notes.pitch(note_name) or 0.0),
    )
    if member_values is not None:
        interval = interval_sum(interval, member_values.by_name.get("transpose"))
        member_values = replace(
            member_values,
            by_name={
                name: value for name, value in member_values.by_name.items() if name != "transpose"
            },
        )
        overlaid_values = overlay_fields(base_values, member_values)
        base_values = replace(
            overlaid_values,
            record=base_values.record,
            node=base_values.node,
            context=base_values.context,
        )
    if interval is None:
        return base_values
    moved_values = replace(base_values, by_name={**base_values.by_name, "transpose": interval})
    return transposed_base(base_values, moved_values, is_root=True)


def interval_sum(
    first_interval: Interval | None, second_interval: Interval | None
) -> Interval | None:
    """Two intervals, one after the other."""
    if first_interval is None or second_interval is None:
        return first_interval or second_interval
    return first_interval.plus(second_interval)


def _hidden_fields(member: Values, field_name: str) -> set[str]:
    hidden_names: set[str] = set()
    for exclusive_groups in _EXCLUSIVE_FIELDS.get(field_name, ()):
        if any(member.written(*group) for group in exclusive_groups):
            for group in exclusive_groups:
                if not member.written(*group):
                    hidden_names.update(group)
    return hidden_names


def _merged_modules(
    base: Mapping[str, object], member_modules: Mapping[str, object]
) -> dict[str, object]:
    merged = dict(base)
    for module_name, module_body in member_modules.items():
        base_module = base.get(module_name)
        if (
            isinstance(module_body, Values)
            and isinstance(base_module, Values)
            and module_body.kind == base_module.kind
        ):
            merged_fields = _merged_fields(
                module_body.kind,
                base_module.by_name.get(module_body.kind),
                module_body.by_name[module_body.kind],
            )
            module_body = replace(module_body, by_name={module_body.kind: merged_fields})
        merged[module_name] = module_body
    return merged


def _merged_fields(module_kind: str, base_fields: Any, member_fields: Any) -> Any:
    """The fields of one module over those of a base module of the same kind."""
    if not isinstance(base_fields, Values) or not isinstance(member_fields, Values):
        return member_fields
    hidden_names, free_fields = (
        _hidden_fields(member_fields, module_kind),
        {**base_fields.free, **member_fields.free},
    )
    if module_kind == "PLATE":  # one of the fields that set its pitch is dropped
        pitch_field = "tension" if base_fields.written("tension") else "thickness"
        hidden_names |= (
            {pitch_field}
            if member_fields.written("f") and not member_fields.written(pitch_field)
            else set()
        )
        hidden_names |= (
            {"f"}
            if member_fields.written("tension", "thickness") and base_fields.written("material")
            else set()
        )
    if module_kind == "LNL" and member_fields.written(
        *_LAW_FIELDS
    ):  # another law has other constants
        hidden_names, free_fields = (
            {*_LAW_FIELDS, *base_fields.free, "interval"},
            dict(member_fields.free),
        )
    if module_kind == "BUT" and member_fields["contact"] == "magic":
        hidden_names = {"K", "Z", "clamp"}
    merged_fields = {
        name: value for name, value in base_fields.by_name.items() if name not in hidden_names
    }
    nodes = {name: node for name, node in base_fields.nodes.items() if name not in hidden_names}
    return replace(
        member_fields,
        by_name={**merged_fields, **member_fields.by_name},
        nodes={**nodes, **member_fields.nodes},
        free=free_fields,
    )
