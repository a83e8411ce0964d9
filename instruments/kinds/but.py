"""BUT: a one-sided contact."""

from __future__ import annotations

from ergon import _core
from ergon.instruments.kinds.kind import (
    BETWEEN,
    Fields,
    Quantities,
    module_kind,
    present_fields,
    require_one_of,
)
from ergon.instruments.spread import GAP
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import choice


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        BETWEEN,
        Field("K", quantities.stiffness, "stiffness (magic chooses its own)"),
        Field("Z", quantities.damping, "viscosity while they touch", 0.0),
        Field("gap", GAP, "distance at which they touch; of a range also one for each", 0.0),
        Field("side", choice("below", "above"), "side from which the first MAT comes", "below"),
        Field(
            "contact",
            choice("plain", "exact", "magic"),
            "CA's own rule, the energy-exact one, or a rebound of exact restitution",
            "plain",
        ),
        Field(
            "restitution",
            value_kinds.UNIT_RATIO,
            "speed after a rebound over speed before (magic)",
            1.0,
        ),
        Field("exponent", value_kinds.EXPONENT, "power of the penetration (1.5: Hertz)", 1.0),
        Field("clamp", value_kinds.BOOLEAN, "never pull at the exit", False),
        Field("steps", value_kinds.integer(2, 1000, "4"), "samples that a magic contact lasts", 2),
    )


def _check(contact_values: Values) -> None:
    if "contact" not in contact_values.record.by_name:
        return  # contacts in space have one rule
    is_magic = contact_values["contact"] == "magic"
    if is_magic and (extra_fields := contact_values.written("K", "Z")):
        message = (
            f"{contact_values.context.label(extra_fields[0])}: a magic contact has no K and Z; "
            "remove it"
        )
        contact_values.error("E111", message, extra_fields[0])
    if not is_magic:
        require_one_of(contact_values, "BUT", "K")
        if extra_fields := contact_values.written("restitution", "steps"):
            message = (
                f"{contact_values.context.label(extra_fields[0])}: only a magic contact has this "
                "field"
            )
            contact_values.error("E111", message, extra_fields[0])
    if is_magic and contact_values["clamp"] and contact_values["restitution"] < 1:
        message = (
            f"{contact_values.context.label('clamp')}: a magic contact with "
            "restitution < 1 must pull, so clamp must be false"
        )
        contact_values.error("E111", message, "clamp")


def _add(network: _core.Network, name: str, a: int, b: int, fields: Fields, reach: float) -> int:
    options = ("K", "Z", "gap", "side", "contact", "restitution", "exponent", "clamp", "steps")
    return network.but(name, a, b, **present_fields(fields, *options))


BUT = module_kind(
    "BUT",
    "link",
    "a one-sided contact: the first of `between` strikes the second",
    _fields,
    glidable_parameters=("K", "Z"),
    role="contact",
    check=_check,
    add=_add,
)
