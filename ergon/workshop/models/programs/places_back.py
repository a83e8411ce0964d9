"""Shares of masses as a place on the macro that has them, from 0 to 1 along each side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ergon.workshop.models.programs.elements import Body, Point

_SHARE_TOLERANCE = 1e-12  # tolerance of a share


def place_of(
    stepped_body: Body, mass_shares: Sequence[tuple[int, float]], point_of: Callable[[int], Point]
) -> list[float]:
    """The place on a body that gives these shares, linear along each side; empty if there is none.

    A fixed point at 0 among them is the end of a held string, beside its first or last mass.
    `point_of` returns the point of a number.
    """
    (column_count, row_count), is_string = stepped_body.sides, stepped_body.kind == "STRING"
    n_fixed = 2 * stepped_body.is_held
    share_by_place: dict[tuple[int, int], float] = {}
    place_by_mass = {mass: place for place, mass in enumerate(stepped_body.points)}
    end_places = {place_by_mass[mass] for mass, _ in mass_shares if mass in place_by_mass}
    for mass_index, mass_share in mass_shares:
        if not mass_share:
            continue
        if mass_index in place_by_mass:
            row, column_index = divmod(place_by_mass[mass_index], column_count)
            row_and_column = (
                row + stepped_body.is_held * (not is_string),
                column_index + stepped_body.is_held,
            )
        elif (
            is_string
            and stepped_body.is_held
            and _is_still(point_of(mass_index))
            and len(end_places) == 1
        ):
            (end,) = end_places
            row_and_column = (0, 0) if end == 0 else (0, column_count + 1)
            if end not in (0, column_count - 1) or column_count == 1:
                return []
        else:
            return []
        share_by_place[row_and_column] = share_by_place.get(row_and_column, 0.0) + mass_share
    side_counts = (
        [column_count + n_fixed] if is_string else [row_count + n_fixed, column_count + n_fixed]
    )
    means = [
        sum(share * row_and_column[axis] for row_and_column, share in share_by_place.items())
        for axis in (0, 1)
    ]
    if any(
        abs(_share(row_and_column, means) - share) > _SHARE_TOLERANCE
        for row_and_column, share in share_by_place.items()
    ):
        return []
    if abs(sum(share_by_place.values()) - 1.0) > _SHARE_TOLERANCE:
        return []
    return [
        mean / (side - 1) if side > 1 else 0.0
        for mean, side in zip(means[-len(side_counts) :], side_counts, strict=True)
    ]


def _share(row_and_column: tuple[int, int], means: Sequence[float]) -> float:
    """The share of one mass in a place between masses, linear along each side."""
    row_index, column_index = (
        max(0.0, 1.0 - abs(mean - coordinate))
        for mean, coordinate in zip(means, row_and_column, strict=True)
    )
    return row_index * column_index


def _is_still(point: Point) -> bool:
    return not point.mass and not point.shares and point.fed is None and point.x0 == 0.0
