"""The mesh that is read from a file, and its size limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from ergon.common.errors import ErgonError

MAX_POINTS = 100_000
MAX_EDGES = 300_000
MAX_FACES = 200_000  # triangles
# The source axes in new order, by the axis that points up: cyclic, so that orientation is kept.
AXIS_ORDER_BY_UP = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
COORDINATE_MAX = 1e6  # largest coordinate, in units of the file
# Share of the size of a mesh: the places of single precision, moved by their nodes.
_MERGE_DISTANCE_RATIO = 1e-6
_MERGE_STEPS = 2.0  # of single precision at the largest coordinate: both sides of a seam round
_MERGE_DISTANCE_RATIO_MAX = 1e-3  # so that a small mesh far away keeps its corners


@dataclass(frozen=True, slots=True)
class Mesh:
    """Points (n, 3), in units of the file, edges (n_edges, 2), each once, and triangles (n, 3)."""

    points: tuple[tuple[float, float, float], ...]
    edges: tuple[tuple[int, int], ...]
    faces: tuple[tuple[int, int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Surface:
    """Corners (n, 3) [m], relative to the point that carries them, and triangles (n, 3)."""

    corners: tuple[tuple[float, ...], ...]
    faces: tuple[tuple[int, int, int], ...]


def placed_points(
    mesh: Mesh, scale: float, up: str, origin: Sequence[float]
) -> Iterator[tuple[float, ...]]:
    """Positions of the points of a file [m]: its origin at `origin`, its unit `scale` [m]
    long.

    The axis `up` of the file becomes the last one.
    """
    source_axes = AXIS_ORDER_BY_UP[up]
    for point in mesh.points:
        yield tuple(a + scale * point[axis] for a, axis in zip(origin, source_axes, strict=True))


def _merge_distance(size: float, coordinate_max: float) -> float:
    """The distance of corners that are one: a share of the size of a mesh, or what single precision
    resolves where the mesh lies.
    """
    step = math.ldexp(1.0, math.frexp(coordinate_max)[1] - 24) if coordinate_max else 0.0
    far_distance = min(_MERGE_STEPS * step, _MERGE_DISTANCE_RATIO_MAX * size)
    return max(_MERGE_DISTANCE_RATIO * size, far_distance)


def with_merged_corners(mesh: Mesh) -> Mesh:
    """The mesh with corners of faces made one that are nearer than a share of its size.

    Writers round the places of nodes, and a seam would leave two bodies. Points of lines alone
    stay: who joins points by lines means each of them.
    """
    corner_indices = {number for face in mesh.faces for number in face}
    if not corner_indices:
        return mesh
    axes = [*zip(*mesh.points, strict=True)]
    minima = [min(axis) for axis in axes]  # a small mesh may lie far away
    size = max(max(axis) - low for axis, low in zip(axes, minima, strict=True))
    merge_distance = _merge_distance(size, max(abs(x) for axis in axes for x in axis))
    if not merge_distance:
        return mesh
    points_by_cell: dict[tuple[int, ...], list[int]] = {}
    merged_points: list[tuple[float, float, float]] = []
    merged_indices: list[int] = []
    for index, point in enumerate(mesh.points):
        if index not in corner_indices:
            merged_indices.append(len(merged_points))
            merged_points.append(point)
            continue
        cell = tuple(
            math.floor((x - low) / merge_distance) for x, low in zip(point, minima, strict=True)
        )
        candidates = (
            number
            for step in product((-1, 0, 1), repeat=3)
            for number in points_by_cell.get(tuple(map(sum, zip(cell, step, strict=True))), ())
        )
        merged_index = next(
            (n for n in candidates if math.dist(merged_points[n], point) <= merge_distance),
            len(merged_points),
        )
        if merged_index == len(merged_points):
            merged_points.append(point)
            points_by_cell.setdefault(cell, []).append(merged_index)
        merged_indices.append(merged_index)
    if len(merged_points) == len(mesh.points):
        return mesh
    ends = ((merged_indices[a], merged_indices[b]) for a, b in mesh.edges)
    edges = dict.fromkeys((min(pair), max(pair)) for pair in ends if pair[0] != pair[1])
    corners = (tuple(merged_indices[i] for i in face) for face in mesh.faces)
    faces = tuple((a, b, c) for a, b, c in corners if len({a, b, c}) == 3)
    return Mesh(tuple(merged_points), tuple(edges), faces)


class MeshFileError(ErgonError):
    """A mistake in a mesh file, with its code."""

    def __init__(self, message: str, code: str = "E106") -> None:
        """Take the sentence and the code."""
        super().__init__(message)
        self.code = code
