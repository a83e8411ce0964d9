"""DRY: friction that sticks up to a level, then slides."""

from __future__ import annotations

from dataclasses import replace
from typing import TypedDict

from ergon import _core
from ergon.instruments.kinds.kind import BETWEEN, ENDPOINT, Quantities, module_kind
from ergon.notation.tables.fields import Field, Values


def _fields(quantities: Quantities) -> tuple[Field, ...]:
    return (
        Field("to", ENDPOINT, "the MAT that rubs on the ground, instead of `between`"),
        replace(BETWEEN, doc="the two MATs that rub on each other: [a, b]", required=False),
        Field("F", quantities.force, "level of the friction while they slide", required=True),
        Field(
            "K",
            quantities.bristle_stiffness,
            "stiffness before they slide (presliding)",
            shown="rigid",
        ),
        Field("static", quantities.force, "level near rest", shown="F"),
        Field(
            "speed",
            quantities.speed,
            "speed at which the level has fallen most of the way to F",
            0.001,
        ),
    )


def _check(friction_values: Values) -> None:
    ends = friction_values.written("to", "between")
    if len(ends) == 2:
        message = (
            f"{friction_values.context.label('between')}: `to` is written too; keep one of the two"
        )
        friction_values.error("E111", message, "between")
    elif not ends and friction_values.record.by_name.keys() >= {"to"}:
        friction_values.error(
            "E103", f"{friction_values.context.label('')}: a DRY needs to or between"
        )
    sliding_level, static_level = friction_values["F"], friction_values["static"]
    is_static_below_sliding = (
        isinstance(sliding_level, float)
        and isinstance(static_level, float)
        and static_level < sliding_level
    )
    if is_static_below_sliding and friction_values["K"] is not None:
        message = (
            f"{friction_values.context.label('static')}: static is below F; with K the level falls "
            "from "
        )
        message += "static to F"
        friction_values.error("E111", message, "static")
    if friction_values.written("speed") and not friction_values.written("static"):
        message = f"{friction_values.context.label('speed')}: only a DRY with static has this field"
        friction_values.error("E111", message, "speed")


class DryFields(TypedDict):
    """Its fields as it is built."""

    F: float
    K: float | None
    static: float | None
    speed: float


def _add(
    network: _core.Network,
    friction_name: str,
    first_mat: int,
    second_mat: int,
    friction_fields: DryFields,
    reach: float,
) -> int:
    sliding_level, static_level, speed = (
        friction_fields["F"],
        friction_fields["static"] or friction_fields["F"],
        friction_fields["speed"],
    )
    if friction_fields["K"] is None:
        return network.dry(
            friction_name,
            first_mat,
            second_mat,
            F=sliding_level,
            static_level=static_level,
            speed=speed,
        )
    # Dry friction with a stiffness K is a bristle without damping.
    return network.bristle(
        friction_name,
        first_mat,
        second_mat,
        sigma0=friction_fields["K"],
        Fc=sliding_level,
        Fs=static_level,
        vs=speed,
    )


DRY = module_kind(
    "DRY",
    "link",
    "dry friction: it sticks up to a level, then slides",
    _fields,
    glidable_parameters=("F",),
    scaled_fields=("K", "F"),
    role="friction",
    lever_powers={"F": -1, "static": -1, "speed": 1},
    check=_check,
    add=_add,
)
