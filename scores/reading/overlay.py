"""Merges fields module by module: one's own values over those of `like:` and `from:`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ergon.instruments.transpose import Interval, base_at_pitch, instrument_at_note, pitch
from ergon.notation.tables import notes
from ergon.notation.tables.fields import Values

# Groups of fields that exclude each other: writing one group removes the others of the base (K for
# f, a table for a line).
_EXCLUSIVE: Mapping[str, tuple[tuple[tuple[str, ...], ...], ...]] = {
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
_LAW = ("law", "damping", "points")


def overlay_fields(base: Values, member: Values) -> Values:
    """The base's fields under one's own, also within modules; transformations are appended.

    An `f` of one's own is moved by one's own `transpose`; that of the base is moved already.
    """
    hidden = _hidden(member, member.record.noun) | {"transpose"}
    if member.written("notes"):  # members of the base have no meaning for other notes
        hidden.add("members")
    body = member.by_name.get(member.kind)
    if isinstance(body, Values):  # fields inside a generator precede those beside it
        hidden.update(body.written("f", "t60", "M"))
        if body.written("K", "Z"):
            hidden.update(("f", "t60"))
    fields = {name: value for name, value in base.by_name.items() if name not in hidden}
    nodes = {name: node for name, node in base.nodes.items() if name not in hidden}
    for name, value in member.by_name.items():
        if name == "modules" and isinstance(fields.get(name), dict):
            value = _modules(fields[name], value)
        elif name == "do" and name in fields:
            value = (*fields[name], *value)
        elif name == member.kind == base.kind and isinstance(value, Values):
            value = _fields(name, fields.get(name), value)
        elif name == "members" and isinstance(fields.get(name), dict):
            value = {**fields[name], **value}
        elif name == "f" and isinstance(value, tuple) and "transpose" in member.by_name:
            value = tuple(pitch(pitch_value, member.by_name["transpose"]) for pitch_value in value)
        fields[name] = value
    fields.pop("transpose", None)
    nodes.update(member.nodes)
    kind = member.kind or base.kind
    return Values(
        member.record,
        member.node,
        member.context,
        fields,
        nodes,
        {**base.free, **member.free},
        kind,
    )


def member(values: Values, height: float) -> Values | None:
    """The fields that are written for one note of an instrument, by its pitch."""
    for word, member_values in (values["members"] or {}).items():
        if notes.pitch(word) == height:
            assert isinstance(member_values, Values)
            return member_values
    return None


def shifted_note(values: Values, note: str, interval: Interval | None = None) -> Values:
    """An instrument with notes at one of its notes, with the fields that are written for that note;
    moved by the `interval` of the whole instrument, and by that of the note.
    """
    base, member_values = instrument_at_note(values, note), member(values, notes.pitch(note) or 0.0)
    if member_values is not None:
        interval = both(interval, member_values.by_name.get("transpose"))
        member_values = replace(
            member_values,
            by_name={n: value for n, value in member_values.by_name.items() if n != "transpose"},
        )
        overlaid = overlay_fields(base, member_values)
        base = replace(overlaid, record=base.record, node=base.node, context=base.context)
    if interval is None:
        return base
    asking = replace(base, by_name={**base.by_name, "transpose": interval})
    return base_at_pitch(base, asking, is_root=True)


def both(first_interval: Interval | None, second_interval: Interval | None) -> Interval | None:
    """Two intervals, one after the other."""
    if first_interval is None or second_interval is None:
        return first_interval or second_interval
    return first_interval.then(second_interval)


def _hidden(member: Values, field_name: str) -> set[str]:
    hidden: set[str] = set()
    for groups in _EXCLUSIVE.get(field_name, ()):
        if any(member.written(*group) for group in groups):
            for group in groups:
                if not member.written(*group):
                    hidden.update(group)
    return hidden


def _modules(base: Mapping[str, object], member_modules: Mapping[str, object]) -> dict[str, object]:
    merged = dict(base)
    for name, body in member_modules.items():
        base_module = base.get(name)
        if (
            isinstance(body, Values)
            and isinstance(base_module, Values)
            and body.kind == base_module.kind
        ):
            fields = _fields(body.kind, base_module.by_name.get(body.kind), body.by_name[body.kind])
            body = replace(body, by_name={body.kind: fields})
        merged[name] = body
    return merged


def _fields(kind: str, base: Any, member_fields: Any) -> Any:
    """The fields of one module over those of a base module of the same kind."""
    if not isinstance(base, Values) or not isinstance(member_fields, Values):
        return member_fields
    hidden, free = _hidden(member_fields, kind), {**base.free, **member_fields.free}
    if kind == "PLATE":  # one of the fields that set its pitch is dropped
        sets = "tension" if base.written("tension") else "thickness"
        hidden |= (
            {sets} if member_fields.written("f") and not member_fields.written(sets) else set()
        )
        hidden |= (
            {"f"}
            if member_fields.written("tension", "thickness") and base.written("material")
            else set()
        )
    if kind == "LNL" and member_fields.written(*_LAW):  # another law has other constants
        hidden, free = {*_LAW, *base.free, "interval"}, dict(member_fields.free)
    if kind == "BUT" and member_fields["contact"] == "magic":
        hidden = {"K", "Z", "clamp"}
    fields = {name: value for name, value in base.by_name.items() if name not in hidden}
    nodes = {name: node for name, node in base.nodes.items() if name not in hidden}
    return replace(
        member_fields,
        by_name={**fields, **member_fields.by_name},
        nodes={**nodes, **member_fields.nodes},
        free=free,
    )
