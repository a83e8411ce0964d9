"""Points in space of a motion file: the table `space` says which of its points are the coordinates
of one point in space.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ergon.common.errors import ErgonError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Motion

_LINKS_CHUNK, _BROKEN_CHUNK = 12, 16  # kinds of chunks
_COUNT_BYTES = 4  # bytes of the number of links before them
# For spaces of 2 and 3 dimensions, the axis of the room that each of their axes runs along: the
# last is up.
_ROOM_AXES_BY_COUNT = {2: (0, 2), 3: (0, 1, 2)}


class NotMotionError(ErgonError, ValueError):
    """A motion file does not have what was asked for."""


@dataclass(frozen=True, slots=True)
class SpacePoint:
    """A point in space: its name, and the numbers of the file's points that are its coordinates."""

    name: str
    point_numbers: tuple[int, ...]

    def rest_position(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its position at rest [m], x, y and z of the room, z upwards   (3,).

        `places` (n_points, 4) are those of the file.
        """
        rest_place = places[self.point_numbers[0], :3].copy()
        for axis, point in self._coordinates():
            rest_place[axis] += places[point, 3]
        return rest_place

    def path(
        self, places: NDArray[np.float64], displacements: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Its positions [m]   (n_instants, 3); `displacements` (n_instants, n_points) are the
        file's displacements.

        A coordinate that is not known at all instants stays at rest.
        """
        import numpy as np

        path = np.tile(self.rest_position(places), (len(displacements), 1))
        for axis, point in self._coordinates():
            if np.isfinite(displacements[:, point]).all():
                path[:, axis] += displacements[:, point]
        return path

    def _coordinates(self) -> Iterator[tuple[int, int]]:
        """Pairs of an axis of the room and the point of the file that moves along it."""
        yield from zip(
            _ROOM_AXES_BY_COUNT[len(self.point_numbers)], self.point_numbers, strict=True
        )


def points_in_space(space_table: object, point_names: Sequence[str]) -> list[SpacePoint]:
    """The points of the manifest's table `space`. Raises NotMotionError where it is damaged."""
    if space_table is None:
        return []
    space_points: list[SpacePoint] = []
    if not isinstance(space_table, list):
        raise NotMotionError("its table of points in space is not a list")
    used_points: set[int] = set()
    for point_numbers in space_table:
        is_point = isinstance(point_numbers, list) and len(point_numbers) in _ROOM_AXES_BY_COUNT
        if not is_point or not all(_is_point(p, len(point_names)) for p in point_numbers):
            raise NotMotionError(
                f"its table of points in space names no such points: {point_numbers!r:.60}"
            )
        if len(used_points.union(point_numbers)) != len(used_points) + len(point_numbers):
            raise NotMotionError(
                f"its table of points in space names a point twice: {point_numbers!r:.60}"
            )
        used_points.update(point_numbers)
        space_points.append(
            SpacePoint(point_names[point_numbers[0]].removesuffix(".x"), tuple(point_numbers))
        )
    return space_points


def points_of_parts(manifest: dict[str, Any], point_names: Sequence[str]) -> list[int]:
    """How many points each part of a manifest has, (n_parts,).

    A point in space counts once: in the part that computes a coordinate of it, and on a surface in
    the part of the body. Raises NotMotionError where the table `space` is damaged.
    """
    part_tables = manifest["parts"]
    point_counts = [part["count"] for part in part_tables]
    part_ends = [part["first"] + part["count"] for part in part_tables]
    for point in points_in_space(manifest.get("space"), point_names):
        members = [bisect_right(part_ends, coordinate) for coordinate in point.point_numbers]
        is_of_body = part_tables[members[-1]]["name"] != part_tables[members[0]]["name"]
        moving_parts = [part for part in members if part_tables[part]["kind"] != "none"]
        for part in members:
            point_counts[part] -= 1
        point_counts[members[-1] if is_of_body else (moving_parts or members)[0]] += 1
    return point_counts


@dataclass(frozen=True, slots=True)
class SpaceLink:
    """A link between two points in space, by their numbers, and when it broke [s]: inf if it is
    whole.
    """

    ends: tuple[int, int]
    break_instant: float


def links_in_space(motion: Motion, space: Sequence[SpacePoint]) -> list[SpaceLink]:
    """The springs between points in space. Raises NotMotionError where one is damaged."""
    import numpy as np

    chunks = list(enumerate(motion.chunks()))
    link_chunk_indices = [
        chunk_index for chunk_index, chunk in chunks if chunk.kind == _LINKS_CHUNK
    ]
    if not (link_chunk_indices and space):
        return []
    link_table = motion.payload(link_chunk_indices[0])
    if len(link_table) < _COUNT_BYTES or len(link_table) != _COUNT_BYTES + 8 * int.from_bytes(
        link_table[:4], "little"
    ):
        raise NotMotionError("its table of links is damaged")
    link_pairs = np.frombuffer(link_table, "<u4", offset=_COUNT_BYTES).reshape(-1, 2)
    if link_pairs.size and int(link_pairs.max()) >= len(motion.names):
        raise NotMotionError("its table of links names no such points")
    break_instants = np.full(len(link_pairs), np.inf)
    for chunk_index, chunk in chunks:
        if chunk.kind == _BROKEN_CHUNK:
            break_rows = np.frombuffer(
                motion.payload(chunk_index), [("dt", "<f4"), ("link", "<u4")]
            )
            if break_rows.size and int(break_rows["link"].max()) >= len(link_pairs):
                raise NotMotionError("a link that broke is not in its table")
            np.minimum.at(
                break_instants, break_rows["link"], chunk.seconds + break_rows["dt"].astype(float)
            )
    space_number_by_point = np.full(len(motion.names), -1)
    space_number_by_point[[point.point_numbers[0] for point in space]] = np.arange(len(space))
    end_points = space_number_by_point[link_pairs]
    visible_links = np.flatnonzero((end_points >= 0).all(axis=1))
    return [
        SpaceLink((int(end_points[i, 0]), int(end_points[i, 1])), float(break_instants[i]))
        for i in visible_links
    ]


def _is_point(number: object, n_points: int) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and 0 <= number < n_points
