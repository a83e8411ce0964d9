"""Checks the fields of a module in space.

Each check reports mistakes, and leaves fields from which a module can be built.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ergon.instruments.space import count
from ergon.instruments.space.fields import (
    BLOCK_COUNTS,
    CENTRE,
    DIRECTION,
    MAX_POINTS,
    MAX_SPRINGS,
    PLACE,
    VELOCITY,
    WIDTHS,
)
from ergon.instruments.space.mesh import Mesh, Surface, placed
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Shape
from ergon.notation.tables.value_kinds import AXES

_Fields = dict[str, Any]


# Substitutes for the items of refused lists; 0 for other shapes.
_FILLED: dict[Shape, float] = {BLOCK_COUNTS: 1, WIDTHS: math.inf}


def check(kind: str, fields: _Fields, values: Values, axes: int) -> None:
    """Check that lists have an item for each axis, and that the fields of a kind go together;
    reports errors.
    """
    for field in values.record.fields:
        value = fields[field.name]
        wanted = axes - 1 if field.shape == CENTRE else axes
        is_vector = field.shape in (PLACE, VELOCITY, DIRECTION, CENTRE, BLOCK_COUNTS, WIDTHS)
        if is_vector and value is not None and len(value) != wanted:
            axis_names = " and ".join(
                filter(None, (", ".join(AXES[: wanted - 1]), AXES[wanted - 1]))
            )
            message = (
                f"{values.context.label(field.name)}: the number of items is {len(value)}, but "
            )
            values.error("E106", f"{message}must be {wanted}: {axis_names}", field.name)
            fields[field.name] = (_FILLED.get(field.shape, 0.0),) * wanted
    if kind in _CHECKS:
        _CHECKS[kind](fields, values)
    if kind == "BUT" and fields["mesh"] is not None:
        fields["mesh"] = _surface(fields, values, axes)
    if "sides" in fields or "span" in fields:
        _size(kind, fields, values)


def _size(kind: str, fields: _Fields, values: Values) -> None:
    """Report a net with too many points or springs."""
    n, axes = count(kind, fields), fields["axes"]
    springs_per_point = ((2 * fields.get("span", 1) + 1) ** axes - 1) // 2
    for number, limit, what in (
        (n, MAX_POINTS, "points"),
        (n * springs_per_point, MAX_SPRINGS, "springs"),
    ):
        if number > limit:
            message = f"{values.context.label('')}: a {kind} has at most {limit:,} {what}, not "
            values.error("E105", f"{message}{number:,}")
            fields.update(sides=(1,) * axes, points=2)
            return


def _wall(fields: _Fields, values: Values) -> None:
    """Check the fields of a wall: its direction, a gap that is negative only for a plane, and
    `cohesion` with `reach`.
    """
    if fields["normal"] is None:
        if (fields["gap"] or 0.0) < 0.0:
            values.error("E105", f"{values.context.label('gap')}: it must not be negative", "gap")
            fields["gap"] = 0.0
    elif _has_direction(fields, values) and fields["side"] == "inside":
        message = f"{values.context.label('side')}: a plane has no inside; turn its normal round"
        values.error("E111", message, "side")
    if fields["box"] is not None:
        _box(fields, values)
    missing = [name for name in ("cohesion", "reach") if fields[name] is None]
    if len(missing) == 1:
        written = "reach" if missing == ["cohesion"] else "cohesion"
        message = (
            f"{values.context.label(written)}: `{missing[0]}` is missing; a contact that sticks "
        )
        values.error("E103", f"{message}has both", written)
        fields.update(cohesion=None, reach=None)


def _box(fields: _Fields, values: Values) -> None:
    """Check that a box is the only wall of its contact, and wider than the points that touch it."""
    if extra := values.written("normal", "side"):
        message = f"{values.context.label(extra[0])}: `box` is written too; keep one of the two"
        values.error("E111", message, extra[0])
    if any(width <= 2 * (fields["gap"] or 0.0) for width in fields["box"]):
        message = f"{values.context.label('box')}: it must be wider than twice the gap"
        values.error("E105", message, "box")


def _surface(fields: _Fields, values: Values, axes: int) -> Surface | None:
    """The triangles of a file, which must be the only wall of their contact, in three axes; None if
    an error was reported.
    """
    wall: Values = fields["mesh"]
    who = values.context.label("mesh")
    if extra := values.written("normal", "side", "box"):
        message = f"{values.context.label(extra[0])}: `mesh` is written too; keep one of the two"
        values.error("E111", message, extra[0])
    elif axes != 3:
        message = f"{who}: a file has three axes; write space: 3 in the instrument"
        values.error("E111", message, "mesh")
    elif not isinstance(model := wall["file"], Mesh):
        return None  # reported
    elif not model.faces:
        values.error("E106", f"{who}: the file has no faces, which points could touch", "mesh")
    elif not fields["gap"]:
        message = f"{values.context.label('gap')}: it must be above 0: the radius of what touches"
        values.error("E105", message, "gap")
    else:
        corners = placed(model, wall["scale"], wall["up"], (0.0, 0.0, 0.0))
        return Surface(tuple(corners), model.faces)
    return None


def _grains(fields: _Fields, values: Values) -> None:
    """Report `scatter` beside `apart`: places are on a lattice, or random."""
    if fields["apart"] is not None and values.written("scatter"):
        message = (
            f"{values.context.label('scatter')}: `apart` is written too; random places have no "
        )
        values.error("E111", f"{message}lattice beside which they lie", "scatter")


def _disc(fields: _Fields, values: Values) -> None:
    """Report a normal of a disc that has length 0, or that has no use in two axes."""
    if fields["normal"] is None or not _has_direction(fields, values) or fields["axes"] > 2:
        return
    message = (
        f"{values.context.label('normal')}: with two axes a disc lies in their plane; remove it"
    )
    values.error("E111", message, "normal")
    fields["normal"] = None


def _has_direction(fields: _Fields, values: Values) -> bool:
    if any(fields["normal"]):
        return True
    message = f"{values.context.label('normal')}: a normal of length 0 has no direction"
    values.error("E105", message, "normal")
    fields["normal"] = None
    return False


def _mesh(fields: _Fields, values: Values) -> None:
    """Report a MESH in an instrument without three axes."""
    if fields["axes"] != 3:
        message = f"{values.context.label('')}: the points of a file have three coordinates; write "
        values.error("E111", f"{message}space: 3 in the instrument")


_CHECKS: dict[str, Callable[[_Fields, Values], None]] = {
    "BUT": _wall,
    "GRAINS": _grains,
    "DISC": _disc,
    "MESH": _mesh,
}
