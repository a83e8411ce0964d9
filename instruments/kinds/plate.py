"""PLATE: a mesh of masses."""

from __future__ import annotations

from typing import TypedDict

from ergon import _core
from ergon.instruments.bodies import Bending
from ergon.instruments.kinds import bodies
from ergon.instruments.kinds.kind import Quantities, module_kind, present_fields
from ergon.instruments.matter import MATTER_FIELDS
from ergon.notation.tables import value_kinds
from ergon.notation.tables.compound import Pair
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import choice

MAX_RADIUS = 400  # half a million masses, whose lowest mode takes ten seconds to find
_MAX_SIDE = 2 * MAX_RADIUS + 1

_RADIUS = value_kinds.count_or_size(
    1, MAX_RADIUS, f"a whole number from 1 to {MAX_RADIUS}, such as 12, or a length, such as 30cm"
)
_SIDE = value_kinds.count_or_size(
    1, _MAX_SIDE, f"a whole number from 1 to {_MAX_SIDE}, such as 40, or a length, such as 40cm"
)


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    masses = value_kinds.integer(1, bodies.MAX_MODULES, "400")
    return (
        Field("shape", choice("hex", "square", "rectangle", "disc"), "form of the mesh", "hex"),
        Field("radius", _RADIUS, "rings round its centre; with a material its size"),
        Field(
            "sides",
            Pair(_SIDE, _SIDE),
            "masses across and up a rectangle; with a material its size",
        ),
        bodies.MATERIAL_FIELD,
        Field("thickness", value_kinds.SIZE, "thickness of a sheet of that material"),
        Field("tension", value_kinds.SURFACE_TENSION, "pull on each metre of it: it is a membrane"),
        Field("masses", masses, "about how many, with a material"),
        *bodies.pitch_fields(quantities),
        Field("rim", choice("free", "fixed"), "whether the rim is held", "free"),
        Field("bending", Bending(), "whether it resists curvature, as metal does", shown="false"),
        bodies.HARDENING_FIELD,
        *bodies.START_FIELDS,
    )


def _check(plate_values: Values) -> None:
    bodies.check_pitched(plate_values, "PLATE")
    plate_shape = plate_values["shape"]
    required_field, other_field = (
        ("sides", "radius") if plate_shape == "rectangle" else ("radius", "sides")
    )
    if not plate_values.written(required_field):
        example = {"sides": "sides: [40, 25]", "radius": "radius: 12"}[required_field]
        message = (
            f"{plate_values.context.label('')}: a PLATE of shape {plate_shape} needs {example}"
        )
        plate_values.error("E103", message)
    if plate_values.written(other_field):
        message = (
            f"{plate_values.context.label(other_field)}: a PLATE of shape {plate_shape} has no "
            f"{other_field}; remove it"
        )
        plate_values.error("E111", message, other_field)


class PlateFields(TypedDict):
    """Its fields as it is built."""

    shape: str
    radius: int | None
    sides: tuple[int, int] | None
    rim: str


def _add(network: _core.Network, name: str, fields: PlateFields, seed: int) -> int:
    size_fields = ("sides",) if fields["shape"] == "rectangle" else ("shape", "radius")
    options = (*size_fields, "M", "f", "t60", "K", "Z", "rim", "bending", "hardening")
    return network.plate(name, **present_fields(fields, *options))


def _count(module_fields: PlateFields) -> int:
    plate_shape, rim, radius = (
        module_fields["shape"],
        module_fields["rim"],
        module_fields["radius"] or 1,
    )
    if plate_shape == "rectangle":
        across, up = module_fields["sides"] or (1, 1)
        return across * up
    if plate_shape == "square":
        return (2 * radius + 1) ** 2
    # The outermost ring of a disc is its rim; a hexagon with a fixed one has one ring more.
    rings = radius - 1 if plate_shape == "disc" and rim == "fixed" else radius
    return 3 * rings * (rings + 1) + 1


PLATE = module_kind(
    "PLATE",
    "generator",
    "a mesh of masses",
    _fields,
    glidable_parameters=("f", "t60"),
    check=_check,
    source_fields=(*MATTER_FIELDS, "masses"),
    complete=bodies.drop_unused_link_fields,
    add=_add,
    count=_count,
)
