"""BRISTLE: friction with memory."""

from __future__ import annotations

from ergon import _core
from ergon.instruments.kinds.kind import BETWEEN, Fields, Quantities, module_kind, present_fields
from ergon.notation.tables.fields import Field, Values


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    damping, force_shape = quantities.damping, quantities.force
    return (
        BETWEEN,
        Field("sigma0", quantities.bristle_stiffness, "stiffness of the bristles", required=True),
        Field("sigma1", damping, "damping of the bristles", 0.0),
        Field("sigma2", damping, "viscosity between the two MATs", 0.0),
        Field("Fc", force_shape, "friction of a fast slide", required=True),
        Field("Fs", force_shape, "friction of the slowest slide", shown="Fc"),
        Field(
            "vs",
            quantities.speed,
            "speed at which friction has fallen most of the way to Fc",
            0.001,
        ),
    )


def _check(module_values: Values) -> None:
    sliding_friction, static_friction = module_values["Fc"], module_values["Fs"]
    if (
        isinstance(sliding_friction, float)
        and isinstance(static_friction, float)
        and static_friction < sliding_friction
    ):
        message = (
            f"{module_values.context.label('Fs')}: Fs is below Fc; friction falls from Fs to Fc"
        )
        module_values.error("E111", message, "Fs")


def _add(network: _core.Network, name: str, a: int, b: int, fields: Fields, reach: float) -> int:
    options = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "vs")
    return network.bristle(name, a, b, **present_fields(fields, *options))


BRISTLE = module_kind(
    "BRISTLE",
    "link",
    "friction with memory: bristles that bend, then slip",
    _fields,
    glidable_parameters=("sigma0", "Fc"),
    scaled_fields=("sigma0", "Fc"),
    role="friction",
    lever_powers={"sigma0": -2, "sigma1": -2, "sigma2": -2, "Fc": -1, "Fs": -1, "vs": 1},
    check=_check,
    add=_add,
)
