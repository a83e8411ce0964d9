"""Shares of masses as a place on the macro that has them, from 0 to 1 along each side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ergon.workshop.models.programs.network import Body, Point

_CLOSE = 1e-12  # of a share


def place_of(
    body: Body, shares: Sequence[tuple[int, float]], point: Callable[[int], Point]
) -> list[float]:
    """The place on a body that gives these shares, linear along each side; empty if there is none.

    A fixed point at 0 among them is the end of a held string, beside its first or last mass.
    `point` returns the point of a number.
    """
    (across, up), is_string = body.sides, body.kind == "STRING"
    more = 2 * body.is_held
    share_by_place: dict[tuple[int, int], float] = {}
    place_by_mass = {mass: place for place, mass in enumerate(body.points)}
    ends = {place_by_mass[mass] for mass, _ in shares if mass in place_by_mass}
    for mass, share in shares:
        if not share:
            continue
        if mass in place_by_mass:
            row, column = divmod(place_by_mass[mass], across)
            where = (row + body.is_held * (not is_string), column + body.is_held)
        elif is_string and body.is_held and _is_still(point(mass)) and len(ends) == 1:
            (end,) = ends
            where = (0, 0) if end == 0 else (0, across + 1)
            if end not in (0, across - 1) or across == 1:
                return []
        else:
            return []
        share_by_place[where] = share_by_place.get(where, 0.0) + share
    sides = [across + more] if is_string else [up + more, across + more]
    means = [sum(share * where[axis] for where, share in share_by_place.items()) for axis in (0, 1)]
    if any(abs(_share(where, means) - share) > _CLOSE for where, share in share_by_place.items()):
        return []
    if abs(sum(share_by_place.values()) - 1.0) > _CLOSE:
        return []
    return [
        mean / (side - 1) if side > 1 else 0.0
        for mean, side in zip(means[-len(sides) :], sides, strict=True)
    ]


def _share(where: tuple[int, int], means: Sequence[float]) -> float:
    """The share of one mass in a place between masses, linear along each side."""
    row, column = (max(0.0, 1.0 - abs(mean - at)) for mean, at in zip(means, where, strict=True))
    return row * column


def _is_still(point: Point) -> bool:
    return not point.mass and not point.shares and point.fed is None and point.x0 == 0.0
