"""RES, FRO and REF: a spring, a damper, and both."""

from __future__ import annotations

from functools import partial

from ergon import _core
from ergon.instruments.kinds.kind import (
    BETWEEN,
    Fields,
    Kind,
    Quantities,
    module_kind,
    present_fields,
    require_one_of,
)
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Values


def _fields(parameter_names: tuple[str, ...], quantities: Quantities) -> tuple[Field, ...]:
    field_by_name = {
        "K": Field("K", quantities.stiffness, "stiffness"),
        "Z": Field("Z", quantities.damping, "viscosity"),
        "rest": Field(
            "rest", value_kinds.POSITION, "elongation at which the spring has no force", 0.0
        ),
    }
    return (BETWEEN, *(field_by_name[name] for name in parameter_names))


def _add(network: _core.Network, name: str, a: int, b: int, fields: Fields, reach: float) -> int:
    return network.ref(name, a, b, **present_fields(fields, "K", "Z", "rest"))


def _kind(kind_name: str, doc: str, field_names: str, *parameter_names: str) -> Kind:
    def check(values: Values) -> None:
        require_one_of(values, kind_name, *parameter_names)

    return module_kind(
        kind_name,
        "link",
        doc,
        partial(_fields, tuple(field_names.split())),
        glidable_parameters=parameter_names,
        check=check,
        add=_add,
    )


RES = _kind("RES", "a spring", "K rest", "K")
FRO = _kind("FRO", "a damper", "Z", "Z")
REF = _kind("REF", "a spring and damper", "K Z rest", "K", "Z")
