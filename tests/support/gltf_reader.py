"""A reader of the glTF files that ergon writes, by the specification of glTF 2.0."""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Scene:
    """Nodes of a glTF file, and where each is at its instants."""

    def __init__(self, path: Path) -> None:
        self.file: dict[str, Any] = json.loads(path.read_text())
        assert self.file["asset"]["version"] == "2.0"
        (buffer,) = self.file["buffers"]
        self._data = base64.b64decode(buffer["uri"].partition(",")[2])
        assert len(self._data) == buffer["byteLength"]
        self.nodes: list[dict[str, Any]] = self.file["nodes"]
        self.roots: list[int] = self.file["scenes"][0]["nodes"]
        (animation,) = self.file["animations"]
        self.channels: dict[tuple[int, str], tuple[NDArray[Any], NDArray[Any]]] = {}
        for channel in animation["channels"]:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            times, values = self._values(sampler["input"])[:, 0], self._values(sampler["output"])
            assert len(times) == len(values)
            assert (np.diff(times) > 0.0).all()
            target = channel["target"]
            self.channels[target["node"], target["path"]] = times, values

    def children(self, root: int) -> list[int]:
        """The child nodes of a node."""
        return list(self.nodes[root].get("children", []))

    def named(self, name: str) -> int:
        """The only node with a name."""
        (result,) = (i for i, node in enumerate(self.nodes) if node["name"] == name)
        return result

    def line(self, node: int) -> NDArray[Any]:
        """The ends of the line in a node's mesh (2, 3), before any translation or scale."""
        (primitive,) = self.file["meshes"][self.nodes[node]["mesh"]]["primitives"]
        assert primitive["mode"] == 1
        return self._values(primitive["attributes"]["POSITION"])

    def value(self, node: int, path: str, t: float) -> NDArray[Any]:
        """`translation` or `scale` of a node at an instant [s] (3,)."""
        still = self.nodes[node].get(path, {"translation": [0, 0, 0], "scale": [1, 1, 1]}[path])
        if (node, path) not in self.channels:
            return np.array(still, dtype=float)
        times, values = self.channels[node, path]
        return np.array([np.interp(t, times, values[:, axis]) for axis in range(3)])

    def _values(self, accessor: int) -> NDArray[Any]:
        single = self.file["accessors"][accessor]
        view = self.file["bufferViews"][single["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[single["type"]]
        assert single["componentType"] == 5126
        assert view["byteLength"] == 4 * width * single["count"]
        assert view["byteOffset"] % 4 == 0
        result = np.frombuffer(self._data, "<f4", width * single["count"], view["byteOffset"])
        result = result.reshape(single["count"], width)
        if "min" in single:
            assert result.min(0).tolist() == single["min"]
            assert result.max(0).tolist() == single["max"]
        return result
