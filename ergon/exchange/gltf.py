"""A motion file as a glTF 2.0 scene, for animators."""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .motion import read_manifest
from .motion_space import NotMotionError, links_in_space, points_in_space

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from ergon._core import Motion

_NODES_MAX = 20_000
_FLOAT_COMPONENT, _LINEAR_INTERPOLATION, _LINES_MODE = 5126, "LINEAR", 1
_POINT_VERTICES = 15  # kind of the chunks of largest displacements
_POINT_SIZE_METRES = 0.004  # [m], of the little octahedron that each point is


def gltf_text(
    motion: Motion, frame_instants: NDArray[np.float64], exaggeration: float | None
) -> str:
    """A glTF 2.0 scene: a node for each point under a node for each part.

    Displacements are drawn along y (up), multiplied by `exaggeration`; with None, the largest is
    drawn as 5 cm. A point in space is one node at its true position [m]; springs between such
    points are lines until they break. Everything is in one file. Raises NotMotionError if there
    are too many nodes.
    """
    import numpy as np

    manifest, point_names = read_manifest(motion), motion.names
    space_points = points_in_space(manifest.get("space"), point_names)
    space_links = links_in_space(motion, space_points)
    space_point_by_number = {point.point_numbers[0]: point for point in space_points}
    other_coordinates = {
        p for point in space_point_by_number.values() for p in point.point_numbers[1:]
    }
    if (n_nodes := len(point_names) - len(other_coordinates) + len(space_links)) > _NODES_MAX:
        raise NotMotionError(
            "glTF has a node for each point, and for each spring in space, "
            f"{_NODES_MAX:,} at most; this has {n_nodes:,}: write npz"
        )
    if exaggeration is None:
        exaggeration = _automatic_exaggeration(
            motion, manifest["parts"], other_coordinates.union(space_point_by_number)
        )
    point_places, point_displacements = (
        motion.places(),
        motion.displacements(frame_instants.tolist()),
    )
    scene = GltfScene(frame_instants)
    node_by_point: dict[int, tuple[int, NDArray[np.float64]]] = {}
    for manifest_part in manifest["parts"]:
        parent_node = scene.node({"name": manifest_part["name"]})
        child_nodes = []
        for point_index in range(
            manifest_part["first"], manifest_part["first"] + manifest_part["count"]
        ):
            if point_index in other_coordinates:
                continue
            if point_index in space_point_by_number:
                space_point = space_point_by_number[point_index]
                point_place, path = (
                    space_point.rest_position(point_places),
                    space_point.path(point_places, point_displacements),
                )
                child_nodes.append(scene.point(space_point.name, point_place, path))
                node_by_point[point_index] = child_nodes[-1], path
                continue
            point_place = point_places[point_index, :3] + [0.0, 0.0, point_places[point_index, 3]]
            path = np.tile(point_place, (len(frame_instants), 1))
            if np.isfinite(point_displacements[:, point_index]).all():
                path[:, 2] += exaggeration * point_displacements[:, point_index]
            child_nodes.append(scene.point(point_names[point_index], point_place, path))
        if child_nodes:
            scene.nodes[parent_node]["children"] = child_nodes
        scene.roots.append(parent_node)
    if space_links:
        parent_node = scene.node({"name": "springs"})
        end_points = (
            (node_by_point[space_points[end].point_numbers[0]] for end in link.ends)
            for link in space_links
        )
        scene.nodes[parent_node]["children"] = [
            scene.line(a, b, link.break_instant)
            for (a, b), link in zip(end_points, space_links, strict=True)
        ]
        scene.roots.append(parent_node)
    return scene.text(str(manifest.get("title") or "ergon"), str(manifest.get("made_by")))


def _automatic_exaggeration(
    motion: Motion, manifest_parts: list[dict[str, Any]], numbers_in_space: set[int]
) -> float:
    """The exaggeration at which the largest displacement of all is drawn as 5 cm.

    Parts in space are drawn as they are.
    """
    kinds = [chunk.kind for chunk in motion.chunks()]
    peak_chunks = [i for i, kind in enumerate(kinds) if kind == _POINT_VERTICES]
    if not peak_chunks:
        return 1.0
    payload = motion.payload(peak_chunks[-1])
    peak_values = struct.unpack(f"<{len(payload) // 4}f", payload[: len(payload) // 4 * 4])
    part_peaks = (
        peak
        for peak, part in zip(peak_values, manifest_parts, strict=False)
        if part["first"] not in numbers_in_space
    )
    peak_max = max(part_peaks, default=0.0)
    return 0.05 / peak_max if peak_max > 0.0 else 1.0


def _to_gltf_axes(places: NDArray[np.float64]) -> NDArray[np.float32]:
    """Places of the room (…, 3) in the axes of glTF: right-handed with y up, (x, z, -y)."""
    import numpy as np

    x, y, z = np.moveaxis(places, -1, 0)
    return np.stack([x, z, -y], axis=-1).astype(np.float32)


@dataclass(slots=True)
class GltfScene:
    """Nodes, meshes and animations of a scene; all numbers lie in one buffer."""

    instants: NDArray[np.float64]
    nodes: list[dict[str, Any]] = field(default_factory=list)
    roots: list[int] = field(default_factory=list)
    _data: bytearray = field(default_factory=bytearray)
    _views: list[dict[str, Any]] = field(default_factory=list)
    _accessors: list[dict[str, Any]] = field(default_factory=list)
    _meshes: list[dict[str, Any]] = field(default_factory=list)
    _samplers: list[dict[str, Any]] = field(default_factory=list)
    _channels: list[dict[str, Any]] = field(default_factory=list)
    _times_accessor: int = 0
    # `_sampler_by_moved_node`: for each node that moves, the sampler of its translation.
    # `_accessor_by_times`: the accessor of each array of instants, by the bytes of the array.
    _sampler_by_moved_node: dict[int, int] = field(default_factory=dict)
    _accessor_by_times: dict[bytes, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Add the mesh of points and the array of instants."""
        import numpy as np

        self._meshes.append({"primitives": [{"attributes": {"POSITION": self._octahedron_mesh()}}]})
        self._times_accessor = self._instants(self.instants.astype(np.float32))

    def node(self, node: dict[str, Any]) -> int:
        """Add a node; returns its number."""
        self.nodes.append(node)
        return len(self.nodes) - 1

    def point(
        self, name: str, rest_positions: NDArray[np.float64], path: NDArray[np.float64]
    ) -> int:
        """Add a point that rests at (3,) and follows a path (n_instants, 3); returns its node
        number.
        """
        gltf_points = _to_gltf_axes(path)
        point_node = self.node(
            {"name": name, "mesh": 0, "translation": _to_gltf_axes(rest_positions).tolist()}
        )
        if (path != rest_positions).any():
            self._move(point_node, "translation", self._sampler(self._times_accessor, gltf_points))
        return point_node

    def line(self, a: tuple[int, NDArray[Any]], b: tuple[int, NDArray[Any]], until: float) -> int:
        """Add a line between two points, given by node and path [m], until an instant [s].

        Its mesh goes from 0 to (1, 1, 1). Its position is that of the first end, and its scale
        along each axis is the distance of the ends. A line of scale 0 is invisible.
        """
        import numpy as np

        end_distance = _to_gltf_axes(b[1] - a[1])
        if until <= self.instants[0]:
            end_distance[:] = 0.0
        line_node = self.node(
            {
                "name": f"{self.nodes[a[0]]['name']}, {self.nodes[b[0]]['name']}",
                "mesh": self._line_mesh(),
                "translation": self.nodes[a[0]]["translation"],
                "scale": end_distance[0].tolist(),
            }
        )
        if a[0] in self._sampler_by_moved_node:
            self._move(line_node, "translation", self._sampler_by_moved_node[a[0]])
        line_times = self.instants.astype(np.float32)
        end_instant = np.float32(until)
        if self.instants[0] < until <= self.instants[-1]:
            n_before_end = int(np.searchsorted(line_times, end_instant))
            last_distance = [np.interp(until, self.instants, axis) for axis in end_distance.T]
            end_distance = np.vstack(
                [end_distance[:n_before_end], [last_distance], np.zeros((1, 3))]
            ).astype(np.float32)
            line_times = np.append(
                line_times[:n_before_end],
                [end_instant, np.nextafter(end_instant, np.float32(np.inf))],
            )
            self._move(line_node, "scale", self._sampler(self._instants(line_times), end_distance))
        elif (end_distance != end_distance[0]).any():
            self._move(line_node, "scale", self._sampler(self._times_accessor, end_distance))
        return line_node

    def _sampler(self, times: int, values: NDArray[np.float32]) -> int:
        output = self._array(values, "VEC3")
        self._samplers.append(
            {"input": times, "output": output, "interpolation": _LINEAR_INTERPOLATION}
        )
        return len(self._samplers) - 1

    def _move(self, node: int, path: str, sampler: int) -> None:
        self._channels.append({"sampler": sampler, "target": {"node": node, "path": path}})
        if path == "translation":
            self._sampler_by_moved_node[node] = sampler

    def _instants(self, times: NDArray[np.float32]) -> int:
        """The accessor of some instants; lines with equal instants share one."""
        times_key = times.tobytes()
        if times_key not in self._accessor_by_times:
            self._accessor_by_times[times_key] = self._array(times, "SCALAR", bounds=True)
        return self._accessor_by_times[times_key]

    def _line_mesh(self) -> int:
        import numpy as np

        if len(self._meshes) == 1:
            end_positions = np.array([[0, 0, 0], [1, 1, 1]], dtype=np.float32)
            position = {"POSITION": self._array(end_positions, "VEC3", bounds=True)}
            self._meshes.append({"primitives": [{"attributes": position, "mode": _LINES_MODE}]})
        return 1

    def text(self, title: str, generator: str) -> str:
        """The whole file as JSON."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": generator},
            "scene": 0,
            "scenes": [{"name": title, "nodes": self.roots}],
            "nodes": self.nodes,
            "meshes": self._meshes,
            "accessors": self._accessors,
            "bufferViews": self._views,
        }
        if self._channels:
            animation = {"name": "motion", "samplers": self._samplers, "channels": self._channels}
            document["animations"] = [animation]
        uri = "data:application/octet-stream;base64," + base64.b64encode(bytes(self._data)).decode()
        document["buffers"] = [{"byteLength": len(self._data), "uri": uri}]
        return json.dumps(document)

    def _octahedron_mesh(self) -> int:
        import numpy as np

        axis_ends = _POINT_SIZE_METRES * np.eye(3, dtype=np.float32)
        corners = np.stack([axis_ends, -axis_ends], axis=1).reshape(6, 3)
        faces = [(0, 2, 4), (4, 2, 1), (1, 2, 5), (5, 2, 0)]
        faces += [(4, 3, 0), (1, 3, 4), (5, 3, 1), (0, 3, 5)]
        return self._array(corners[np.array(faces).ravel()], "VEC3", bounds=True)

    def _array(self, values: NDArray[np.float32], kind: str, *, bounds: bool = False) -> int:
        self._views.append(
            {"buffer": 0, "byteOffset": len(self._data), "byteLength": values.nbytes}
        )
        accessor: dict[str, Any] = {
            "bufferView": len(self._views) - 1,
            "componentType": _FLOAT_COMPONENT,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor["min"], accessor["max"] = rows.min(0).tolist(), rows.max(0).tolist()
        self._accessors.append(accessor)
        self._data.extend(values.astype("<f4").tobytes())
        return len(self._accessors) - 1
