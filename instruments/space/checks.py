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
from ergon.instruments.space.mesh import Mesh, Surface, placed_points
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Shape
from ergon.notation.tables.value_kinds import AXES

_Fields = dict[str, Any]


# Substitutes for the items of refused lists; 0 for other shapes.
_SUBSTITUTE_ITEMS: dict[Shape, float] = {BLOCK_COUNTS: 1, WIDTHS: math.inf}


def check(kind: str, fields: _Fields, values: Values, n_axes: int) -> None:
    """Check that lists have an item for each axis, and that the fields of a kind go together;
    reports errors.
    """
    for field in values.record.fields:
        value = fields[field.name]
        n_items = n_axes - 1 if field.shape == CENTRE else n_axes
        is_vector = field.shape in (PLACE, VELOCITY, DIRECTION, CENTRE, BLOCK_COUNTS, WIDTHS)
        if is_vector and value is not None and len(value) != n_items:
            axis_names = " and ".join(
                filter(None, (", ".join(AXES[: n_items - 1]), AXES[n_items - 1]))
            )
            message = (
                f"{values.context.label(field.name)}: the number of items is {len(value)}, but "
            )
            values.error("E106", f"{message}must be {n_items}: {axis_names}", field.name)
            fields[field.name] = (_SUBSTITUTE_ITEMS.get(field.shape, 0.0),) * n_items
    if kind in _CHECKS_BY_KIND:
        _CHECKS_BY_KIND[kind](fields, values)
    if kind == "BUT" and fields["mesh"] is not None:
        fields["mesh"] = _surface_of_file(fields, values, n_axes)
    if "sides" in fields or "span" in fields:
        _check_size(kind, fields, values)


def _check_size(kind_name: str, net_fields: _Fields, net_values: Values) -> None:
    """Report a net with too many points or springs."""
    n_points, n_axes = count(kind_name, net_fields), net_fields["axes"]
    springs_per_point = ((2 * net_fields.get("span", 1) + 1) ** n_axes - 1) // 2
    for net_size, n_max, noun in (
        (n_points, MAX_POINTS, "points"),
        (n_points * springs_per_point, MAX_SPRINGS, "springs"),
    ):
        if net_size > n_max:
            message = (
                f"{net_values.context.label('')}: a {kind_name} has at most {n_max:,} {noun}, not "
            )
            net_values.error("E105", f"{message}{net_size:,}")
            net_fields.update(sides=(1,) * n_axes, points=2)
            return


def _check_wall(wall_fields: _Fields, wall_values: Values) -> None:
    """Check the fields of a wall: its direction, a gap that is negative only for a plane, and
    `cohesion` with `reach`.
    """
    if wall_fields["normal"] is None:
        if (wall_fields["gap"] or 0.0) < 0.0:
            wall_values.error(
                "E105", f"{wall_values.context.label('gap')}: it must not be negative", "gap"
            )
            wall_fields["gap"] = 0.0
    elif _has_direction(wall_fields, wall_values) and wall_fields["side"] == "inside":
        message = (
            f"{wall_values.context.label('side')}: a plane has no inside; turn its normal round"
        )
        wall_values.error("E111", message, "side")
    if wall_fields["box"] is not None:
        _check_box(wall_fields, wall_values)
    missing_names = [name for name in ("cohesion", "reach") if wall_fields[name] is None]
    if len(missing_names) == 1:
        written_name = "reach" if missing_names == ["cohesion"] else "cohesion"
        message = (
            f"{wall_values.context.label(written_name)}: `{missing_names[0]}` is missing; a "
            "contact that sticks "
        )
        wall_values.error("E103", f"{message}has both", written_name)
        wall_fields.update(cohesion=None, reach=None)


def _check_box(box_fields: _Fields, box_values: Values) -> None:
    """Check that a box is the only wall of its contact, and wider than the points that touch it."""
    if surplus_fields := box_values.written("normal", "side"):
        message = (
            f"{box_values.context.label(surplus_fields[0])}: `box` is written too; keep one "
            "of the two"
        )
        box_values.error("E111", message, surplus_fields[0])
    if any(width <= 2 * (box_fields["gap"] or 0.0) for width in box_fields["box"]):
        message = f"{box_values.context.label('box')}: it must be wider than twice the gap"
        box_values.error("E105", message, "box")


def _surface_of_file(surface_fields: _Fields, surface_values: Values, axes: int) -> Surface | None:
    """The triangles of a file, which must be the only wall of their contact, in three axes; None if
    an error was reported.
    """
    file_fields: Values = surface_fields["mesh"]
    mesh_label = surface_values.context.label("mesh")
    if surplus_fields := surface_values.written("normal", "side", "box"):
        message = (
            f"{surface_values.context.label(surplus_fields[0])}: `mesh` is written too; keep "
            "one of the two"
        )
        surface_values.error("E111", message, surplus_fields[0])
    elif axes != 3:
        message = f"{mesh_label}: a file has three axes; write space: 3 in the instrument"
        surface_values.error("E111", message, "mesh")
    elif not isinstance(model := file_fields["file"], Mesh):
        return None  # reported
    elif not model.faces:
        surface_values.error(
            "E106", f"{mesh_label}: the file has no faces, which points could touch", "mesh"
        )
    elif not surface_fields["gap"]:
        message = (
            f"{surface_values.context.label('gap')}: it must be above 0: the radius of what touches"
        )
        surface_values.error("E105", message, "gap")
    else:
        corners = placed_points(model, file_fields["scale"], file_fields["up"], (0.0, 0.0, 0.0))
        return Surface(tuple(corners), model.faces)
    return None


def _check_grains(fields: _Fields, grain_values: Values) -> None:
    """Report `scatter` beside `apart`: places are on a lattice, or random."""
    if fields["apart"] is not None and grain_values.written("scatter"):
        message = (
            f"{grain_values.context.label('scatter')}: `apart` is written too; random places have "
            "no "
        )
        grain_values.error("E111", f"{message}lattice beside which they lie", "scatter")


def _check_disc(disc_fields: _Fields, disc_values: Values) -> None:
    """Report a normal of a disc that has length 0, or that has no use in two axes."""
    if (
        disc_fields["normal"] is None
        or not _has_direction(disc_fields, disc_values)
        or disc_fields["axes"] > 2
    ):
        return
    message = (
        f"{disc_values.context.label('normal')}: with two axes a disc lies in their plane; remove "
        "it"
    )
    disc_values.error("E111", message, "normal")
    disc_fields["normal"] = None


def _has_direction(wall_fields: _Fields, wall_values: Values) -> bool:
    if any(wall_fields["normal"]):
        return True
    message = f"{wall_values.context.label('normal')}: a normal of length 0 has no direction"
    wall_values.error("E105", message, "normal")
    wall_fields["normal"] = None
    return False


def _check_mesh(fields: _Fields, module_values: Values) -> None:
    """Report a MESH in an instrument without three axes."""
    if fields["axes"] != 3:
        message = (
            f"{module_values.context.label('')}: the points of a file have three coordinates; "
            "write "
        )
        module_values.error("E111", f"{message}space: 3 in the instrument")


_CHECKS_BY_KIND: dict[str, Callable[[_Fields, Values], None]] = {
    "BUT": _check_wall,
    "GRAINS": _check_grains,
    "DISC": _check_disc,
    "MESH": _check_mesh,
}
