"""The mesh that is read from a file, and its size limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ergon.common.errors import ErgonError

MAX_POINTS = 100_000
MAX_EDGES = 300_000
MAX_FACES = 200_000  # triangles
# The source axes in new order, by the axis that points up: cyclic, so that orientation is kept.
TURNS = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
COORDINATE_MAX = 1e6  # of a coordinate, in units of the file


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


def placed(
    mesh: Mesh, scale: float, up: str, position: Sequence[float]
) -> Iterator[tuple[float, ...]]:
    """Positions of the points of a file [m]: its origin at `position`, its unit `scale` [m] long.

    The axis `up` of the file becomes the last one.
    """
    turn = TURNS[up]
    for point in mesh.points:
        yield tuple(a + scale * point[axis] for a, axis in zip(position, turn, strict=True))


class MeshFileError(ErgonError):
    """A mistake in a mesh file, with its code."""

    def __init__(self, message: str, code: str = "E106") -> None:
        """Take the sentence and the code."""
        super().__init__(message)
        self.code = code
