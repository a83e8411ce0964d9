"""What a file of a mesh is read to, and what it may hold."""

from __future__ import annotations

from dataclasses import dataclass

from ergon.common.errors import ErgonError

MAX_POINTS = 100_000
MAX_EDGES = 300_000
MOST = 1e6  # of a coordinate, in units of the file


@dataclass(frozen=True, slots=True)
class Mesh:
    """Points (n, 3), in units of the file, and edges (n_edges, 2), each once, in their order."""

    points: tuple[tuple[float, float, float], ...]
    edges: tuple[tuple[int, int], ...]


class MeshFileError(ErgonError):
    """What is wrong with a file of a mesh, and the code of the mistake."""

    def __init__(self, message: str, code: str = "E106") -> None:
        """A sentence, and the code."""
        super().__init__(message)
        self.code = code
