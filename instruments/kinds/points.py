"""MAS, SOL and CEL: single MATs."""

from __future__ import annotations

from typing import TypedDict

from ergon import _core
from ergon.instruments import following
from ergon.instruments.kinds.kind import ENDPOINT, Fields, Quantities, module_kind, present_fields
from ergon.notation.tables import value_kinds
from ergon.notation.tables.fields import Field, Values

_X0 = Field("X0", value_kinds.POSITION, "position at the beginning", 0.0)
_V0 = Field("V0", value_kinds.SPEED, "velocity at the beginning", 0.0)


def _mass_field(quantities: Quantities) -> Field:
    return Field("M", quantities.mass, "mass", required=True)


def _mas_fields(quantities: Quantities) -> tuple[Field, ...]:
    doc = "that M depends on the position of another MAT"
    return (
        _mass_field(quantities),
        _X0,
        _V0,
        following.follows_field(quantities.mass, ENDPOINT, doc),
    )


def _cel_fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        _mass_field(quantities),
        Field("K", quantities.stiffness, "stiffness"),
        Field("Z", quantities.damping, "viscosity"),
        Field("f", value_kinds.PITCH, "damped frequency, instead of K"),
        Field("t60", value_kinds.DURATION, "time to fall by 60 dB, instead of Z", shown="no decay"),
        _X0,
        _V0,
        Field("rest", value_kinds.POSITION, "elongation at which the spring has no force", 0.0),
    )


def _check_cel(cel_values: Values) -> None:
    pitch_names, spring_names = cel_values.written("f", "t60"), cel_values.written("K", "Z")
    if pitch_names and spring_names:
        message = f"{cel_values.context.label(pitch_names[0])}: {spring_names[0]} is written too; "
        message += "a CEL has K and Z, or f and t60"
        cel_values.error("E111", message, pitch_names[0])
    elif not cel_values.written("f", "K") and cel_values.misspelt.isdisjoint({"f", "K"}):
        cel_values.error(
            "E103", f"{cel_values.context.label('')}: a CEL needs K (and Z), or f (and t60)"
        )


def _add_mas(network: _core.Network, name: str, fields: Fields, seed: int) -> int:
    return network.mas(name, **present_fields(fields, "M", "X0", "V0"))


def _add_sol(network: _core.Network, name: str, fields: Fields, seed: int) -> int:
    return network.sol(name, **present_fields(fields, "X0"))


class CelFields(TypedDict):
    """Its fields as it is built."""

    M: float
    K: float | None
    Z: float | None
    f: float | None
    t60: float | None
    X0: float
    V0: float
    rest: float


def _add_cel(network: _core.Network, name: str, fields: CelFields, seed: int) -> int:
    # K and Z have defaults; if f is written, f and t60 replace both.
    tie_fields = ("K", "Z") if fields["f"] is None else ("f", "t60")
    return network.cel(name, **present_fields(fields, "M", *tie_fields, "X0", "V0", "rest"))


MAS = module_kind(
    "MAS", "mat", "a point mass", _mas_fields, check=following.check_mass, add=_add_mas
)
SOL = module_kind("SOL", "mat", "a fixed point", lambda quantities: (_X0,), add=_add_sol)
CEL = module_kind(
    "CEL",
    "mat",
    "a mass on a spring to the ground, with viscosity",
    _cel_fields,
    glidable_parameters=("f", "t60", "K", "Z", "M"),
    check=_check_cel,
    add=_add_cel,
)
