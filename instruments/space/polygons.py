"""Triangles of a face with any number of corners, also of one that is not convex."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

CONCAVE_CORNERS_MAX = 1_000  # corners of a face with a notch; the work grows with their square

_Point = Sequence[float]
_FlatPoint = tuple[float, float]


def triangles_of_face(corners: Sequence[_Point]) -> list[tuple[int, int, int]] | None:
    """The triangles of a face, as numbers of its corners from 0: a fan of a convex one, else ears
    that are clipped one after the other (Meisters 1975); None if it has a notch and too many
    corners.
    """
    n = len(corners)
    flat_corners = _flat_corners(corners)
    if all(_twice_signed_area(flat_corners, i - 2, i - 1, i) >= 0.0 for i in range(n)):
        return [(0, a, b) for a, b in pairwise(range(1, n))]
    if n > CONCAVE_CORNERS_MAX:
        return None
    triangles: list[tuple[int, int, int]] = []
    rest, position, n_tried = [*range(n)], 0, 0
    while len(rest) > 3 and n_tried < len(rest):
        position %= len(rest)
        ear = rest[position - 1], rest[position], rest[(position + 1) % len(rest)]
        if _is_ear(flat_corners, ear, rest):
            triangles.append(ear)
            del rest[position]
            n_tried = 0
        else:
            position, n_tried = position + 1, n_tried + 1
    # What crosses itself may have no ear left.
    return [*triangles, *((rest[0], a, b) for a, b in pairwise(rest[1:]))]


def _flat_corners(corners: Sequence[_Point]) -> list[_FlatPoint]:
    """The corners along the axis on which the face is seen largest, counter-clockwise."""
    normal = [0.0, 0.0, 0.0]  # by Newell's sums, which also hold of a face that is not plane
    x0, y0, z0 = corners[0]
    relative_corners = [(x - x0, y - y0, z - z0) for x, y, z in corners]
    for a, b in pairwise([*relative_corners, relative_corners[0]]):
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            normal[axis] += (a[i] - b[i]) * (a[j] + b[j])
    axis = max(range(3), key=lambda number: abs(normal[number]))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    i, j = (i, j) if normal[axis] >= 0.0 else (j, i)
    return [(point[i], point[j]) for point in relative_corners]


def _twice_signed_area(points: Sequence[_FlatPoint], a: int, b: int, c: int) -> float:
    """Twice the area of a triangle: above 0 where the way from `a` over `b` to `c` turns left."""
    (ax, ay), (bx, by), (cx, cy) = points[a], points[b], points[c]
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def _is_ear(points: Sequence[_FlatPoint], ear: tuple[int, int, int], rest: Sequence[int]) -> bool:
    """Whether a triangle of three neighbours lies in the face: it turns left, and no other corner
    lies in it or on its border.
    """
    a, b, c = ear
    if _twice_signed_area(points, a, b, c) <= 0.0:
        return False
    places = {points[corner] for corner in ear}
    return not any(
        points[other] not in places
        and _twice_signed_area(points, a, b, other) >= 0.0
        and _twice_signed_area(points, b, c, other) >= 0.0
        and _twice_signed_area(points, c, a, other) >= 0.0
        for other in rest
    )
