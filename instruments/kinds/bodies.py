"""Fields that several generators have: what each body is made of, and how it begins."""

from __future__ import annotations

from ergon.instruments.bodies import DECAY_SHAPE
from ergon.instruments.kinds.kind import Quantities
from ergon.instruments.materials import MATERIAL_SHAPE
from ergon.instruments.starts import start_shape
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Values

MAX_MODULES = 2_000_000  # modules of one generator: some 200 MB

START_FIELDS = (
    Field("X0", start_shape("X0", value_kinds.POSITION, "x"), "positions at the beginning", 0.0),
    Field("V0", start_shape("V0", value_kinds.SPEED, "v"), "velocities at the beginning", 0.0),
)
HARDENING_FIELD = Field("hardening", value_kinds.HARDENING, "q of k·d + q·d³ on every link", 0.0)
MATERIAL_FIELD = Field(
    "material", MATERIAL_SHAPE, "what it is made of: sets M, f, t60 and stiffness from its size"
)


def pitch_fields(quantities: Quantities) -> tuple[Field, ...]:
    """M, f and t60 of a body; one of a discrete network is given by K and Z of its links too."""
    link_shapes = (
        Field("K", value_kinds.NUMBER, "K of each of its links, instead of f"),
        Field("Z", value_kinds.NUMBER, "Z of each of its links, instead of t60"),
    )
    return (
        Field(
            "M",
            value_kinds.MASS_OR_NUMBER if quantities.is_ca else value_kinds.MASS,
            "mass of the whole body",
            required=True,
        ),
        Field(
            "f", value_kinds.PITCH, "lowest mode that is not rigid", required=not quantities.is_ca
        ),
        Field(
            "t60",
            DECAY_SHAPE,
            "decay of that mode, or of modes at these frequencies",
            shown="no decay",
        ),
        *(link_shapes if quantities.is_ca else ()),
    )


def check_pitched(body_values: Values, body_name: str) -> None:
    """Report a body without a pitch, or with K and Z of its links beside it."""
    if "K" not in body_values.record.by_name:
        return
    pitch_names, link_names = (
        body_values.written("f", "t60", "inharmonicity", "bending"),
        body_values.written("K", "Z"),
    )
    if pitch_names and link_names:
        message = f"{body_values.context.label(pitch_names[0])}: {link_names[0]} is written too; "
        message += f"a {body_name} has K and Z of its links, or f and t60"
        body_values.error("E111", message, pitch_names[0])
    elif not body_values.written("f", "K"):
        body_values.error(
            "E103",
            f"{body_values.context.label('')}: a {body_name} needs f (and t60), or K (and Z)",
        )


def drop_unused_link_fields(values: Values, module_fields: dict[str, object]) -> None:
    """Drop K and Z of a body that has a pitch instead."""
    if module_fields.get("K") is None:
        for name in ("K", "Z"):
            module_fields.pop(name, None)
