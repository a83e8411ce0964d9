"""STRING: masses in a row."""

from __future__ import annotations

from typing import TypedDict

from ergon import _core
from ergon.instruments.kinds import bodies
from ergon.instruments.kinds.kind import Fields, Quantities, module_kind, present_fields
from ergon.instruments.matter import MATTER_FIELDS
from ergon.instruments.stiff import INHARMONICITY_SHAPE, STRETCHING_SHAPE, Stretched
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Values
from ergon.notation.tables.shapes import choice


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        Field(
            "masses",
            value_kinds.integer(1, bodies.MAX_MODULES, "60"),
            "how many MAS in a row",
            required=True,
        ),
        bodies.MATERIAL_FIELD,
        Field("length", value_kinds.SIZE, "length of a wire of that material"),
        Field("diameter", value_kinds.SIZE, "diameter of that wire"),
        Field("tension", value_kinds.FORCE, "tension of that wire"),
        *bodies.pitch_fields(quantities),
        Field("ends", choice("fixed", "free", "left"), "which ends are held", "fixed"),
        Field(
            "stiffness",
            value_kinds.RATIO,
            "springs to neighbours but one, which lower partials (see inharmonicity)",
            0.0,
        ),
        Field(
            "inharmonicity",
            INHARMONICITY_SHAPE,
            "B of partials f·n·√((1 + B·n²)/(1 + B)), or the wire that has it",
            shown="that of a row of springs",
        ),
        bodies.HARDENING_FIELD,
        Field(
            "stretching",
            STRETCHING_SHAPE,
            "q of q·S·d on every link, S the sum of the squares of all elongations; or the wire",
            0.0,
        ),
        *bodies.START_FIELDS,
    )


def _check(string_values: Values) -> None:
    bodies.check_pitched(string_values, "STRING")
    if string_values.written("inharmonicity") and string_values.written("stiffness"):
        message = (
            f"{string_values.context.label('stiffness')}: `inharmonicity` is written too; keep "
            "`inharmonicity`, which raises high partials as bending does"
        )
        string_values.error("E111", message, "stiffness")


def _complete(values: Values, fields: dict[str, object]) -> None:
    bodies.drop_unused_link_fields(values, fields)
    if isinstance(wire := values["stretching"], Stretched):
        fields["stretching"] = wire.stretching(values["masses"], values["ends"])


class StringFields(TypedDict):
    """Its fields as it is built."""

    masses: int


def _add(network: _core.Network, name: str, fields: Fields, seed: int) -> int:
    options = ("masses", "M", "f", "t60", "K", "Z", "ends", "stiffness", "inharmonicity")
    return network.string(name, **present_fields(fields, *options, "hardening", "stretching"))


def _count(fields: StringFields) -> int:
    return fields["masses"]


STRING = module_kind(
    "STRING",
    "generator",
    "masses in a row",
    _fields,
    synonyms={"held": "ends"},
    glidable_parameters=("f", "t60"),
    check=_check,
    source_fields=MATTER_FIELDS,
    complete=_complete,
    add=_add,
    count=_count,
)
