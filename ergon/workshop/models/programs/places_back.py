"""Shares of masses as a place on the macro that has them, from 0 to 1 along each side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ergon.workshop.models.programs.elements import Body, Point

_SHARE_TOLERANCE = 1e-12  # tolerance of a share


def position_on_body(
    body: Body, shares: Sequence[tuple[int, float]], point_of: Callable[[int], Point]
) -> list[float]:
    """The place on a body that gives these shares, linear along each side; empty if there is none.

    A fixed point at 0 among them is the end of a held string, beside its first or last mass.
    `point_of` returns the point of a number.
    """
    (n_columns, n_rows), is_string = body.mass_counts, body.kind == "STRING"
    n_fixed = 2 * body.is_held
    weights: dict[tuple[int, int], float] = {}
    index_by_mass = {mass: position for position, mass in enumerate(body.points)}
    body_indices = {index_by_mass[mass] for mass, _ in shares if mass in index_by_mass}
    for mass_index, share in shares:
        if not share:
            continue
        if mass_index in index_by_mass:
            row_index, column_index = divmod(index_by_mass[mass_index], n_columns)
            grid_point = (
                row_index + body.is_held * (not is_string),
                column_index + body.is_held,
            )
        elif (
            is_string
            and body.is_held
            and _is_ground_at_zero(point_of(mass_index))
            and len(body_indices) == 1
        ):
            (end_index,) = body_indices
            grid_point = (0, 0) if end_index == 0 else (0, n_columns + 1)
            if end_index not in (0, n_columns - 1) or n_columns == 1:
                return []
        else:
            return []
        weights[grid_point] = weights.get(grid_point, 0.0) + share
    points_per_side = (
        [n_columns + n_fixed] if is_string else [n_rows + n_fixed, n_columns + n_fixed]
    )
    means = [
        sum(weight * grid_point[axis] for grid_point, weight in weights.items()) for axis in (0, 1)
    ]
    if any(
        abs(_bilinear_weight(grid_point, means) - point_share) > _SHARE_TOLERANCE
        for grid_point, point_share in weights.items()
    ):
        return []
    if abs(sum(weights.values()) - 1.0) > _SHARE_TOLERANCE:
        return []
    return [
        mean / (n - 1) if n > 1 else 0.0
        for mean, n in zip(means[-len(points_per_side) :], points_per_side, strict=True)
    ]


def _bilinear_weight(grid_point: tuple[int, int], means: Sequence[float]) -> float:
    """The share of one mass in a place between masses, linear along each side."""
    row_weight, column_weight = (
        max(0.0, 1.0 - abs(mean - coordinate))
        for mean, coordinate in zip(means, grid_point, strict=True)
    )
    return row_weight * column_weight


def _is_ground_at_zero(point: Point) -> bool:
    return not point.mass and not point.shares and point.position_input is None and point.x0 == 0.0
