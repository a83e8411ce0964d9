"""Shares of masses as a place on the macro that has them, from 0 to 1 along each side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ergon.workshop.models.programs.elements import Body, Point

_SHARE_TOLERANCE = 1e-12  # tolerance of a share


def place_of(
    body: Body, shares: Sequence[tuple[int, float]], point_of: Callable[[int], Point]
) -> list[float]:
    """The place on a body that gives these shares, linear along each side; empty if there is none.

    A fixed point at 0 among them is the end of a held string, beside its first or last mass.
    `point_of` returns the point of a number.
    """
    (column_count, row_count), is_string = body.sides, body.kind == "STRING"
    fixed_count = 2 * body.is_held
    share_by_grid_point: dict[tuple[int, int], float] = {}
    position_by_mass = {mass: position for position, mass in enumerate(body.points)}
    row_positions = {position_by_mass[mass] for mass, _ in shares if mass in position_by_mass}
    for mass_index, share in shares:
        if not share:
            continue
        if mass_index in position_by_mass:
            row_index, column_index = divmod(position_by_mass[mass_index], column_count)
            grid_point = (
                row_index + body.is_held * (not is_string),
                column_index + body.is_held,
            )
        elif (
            is_string
            and body.is_held
            and _is_still(point_of(mass_index))
            and len(row_positions) == 1
        ):
            (end_position,) = row_positions
            grid_point = (0, 0) if end_position == 0 else (0, column_count + 1)
            if end_position not in (0, column_count - 1) or column_count == 1:
                return []
        else:
            return []
        share_by_grid_point[grid_point] = share_by_grid_point.get(grid_point, 0.0) + share
    counts = (
        [column_count + fixed_count]
        if is_string
        else [row_count + fixed_count, column_count + fixed_count]
    )
    means = [
        sum(
            point_share * grid_point[axis]
            for grid_point, point_share in share_by_grid_point.items()
        )
        for axis in (0, 1)
    ]
    if any(
        abs(_share(grid_point, means) - point_share) > _SHARE_TOLERANCE
        for grid_point, point_share in share_by_grid_point.items()
    ):
        return []
    if abs(sum(share_by_grid_point.values()) - 1.0) > _SHARE_TOLERANCE:
        return []
    return [
        mean / (count - 1) if count > 1 else 0.0
        for mean, count in zip(means[-len(counts) :], counts, strict=True)
    ]


def _share(grid_point: tuple[int, int], means: Sequence[float]) -> float:
    """The share of one mass in a place between masses, linear along each side."""
    row_share, column_share = (
        max(0.0, 1.0 - abs(mean - coordinate))
        for mean, coordinate in zip(means, grid_point, strict=True)
    )
    return row_share * column_share


def _is_still(point: Point) -> bool:
    return not point.mass and not point.shares and point.fed is None and point.x0 == 0.0
