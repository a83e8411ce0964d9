"""Odd glTF files: what writers break is read rightly, named, or refused in bounded time."""

from __future__ import annotations

import copy
import json
import random
import struct
from pathlib import Path
from typing import Any

import pytest
from commands import forked
from gltf_files import binary, tetrahedron

from ergon.instruments.space import gltf_file
from ergon.instruments.space.mesh import MeshFileError


def _set(root: dict, value: Any, *path: str | int) -> dict:
    holder: Any = root
    for word in path[:-1]:
        holder = holder[word]
    holder[path[-1]] = value
    return root


def _with(value: Any, *path: str | int) -> dict:
    return _set(tetrahedron(), value, *path)


REFUSED = {
    "a text as a number": (_with(["a", 0, 0], "nodes", 1, "translation"), "incomplete"),
    "a number in a text": (_with(["1", 0, 0], "nodes", 1, "translation"), "incomplete"),
    "a turn that is none": (_with([0, 0, 2, 2], "nodes", 1, "rotation"), "unit quaternion"),
    "a turn of zeros": (_with([0, 0, 0, 0], "nodes", 1, "rotation"), "unit quaternion"),
    "a matrix of 9": (_with([1] * 9, "nodes", 1, "matrix"), "incomplete"),
    "values that overlap": (_with(4, "bufferViews", 0, "byteStride"), "4 bytes apart"),
    "values in one place": (_with(0, "bufferViews", 0, "byteStride"), "0 bytes apart"),
    "a count with a half": (_with(2.5, "accessors", 0, "count"), "incomplete"),
    "a count of -1": (_with(-1, "accessors", 0, "count"), "incomplete"),
    "an offset of -12": (_with(-12, "accessors", 0, "byteOffset"), "incomplete"),
    "an offset behind the end": (_with(10**12, "accessors", 0, "byteOffset"), "incomplete"),
    "positions as integers": (_with(5123, "accessors", 0, "componentType"), "three floats"),
    "positions in a plane": (_with("VEC2", "accessors", 0, "type"), "three floats"),
    "an unknown mode": (_with(7, "meshes", 0, "primitives", 0, "mode"), "incomplete"),
    "a number for a table": (_with(5, "meshes", 0, "primitives", 0, "attributes"), "incomplete"),
    "a scene that is not there": (_with(3, "scene"), "incomplete"),
    "a text of extensions": (_with("abc", "extensionsRequired"), "extension a"),
    "a number of extensions": (_with(5, "extensionsRequired"), "incomplete"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_odd_gltf_files_are_refused(name: str) -> None:
    root, words = REFUSED[name]
    for read, data in ((gltf_file.read, json.dumps(root)), (gltf_file.read_binary, binary(root))):
        with pytest.raises(MeshFileError, match=words):
            read(data)  # type: ignore[operator]


def _points_out(root: dict[str, Any]) -> dict[str, Any]:
    """Every number with a point, as some programs write them."""
    return json.loads(json.dumps(root), parse_int=float)


SAME = {
    "numbers with points": _points_out(tetrahedron()),
    "a part without places": _with(
        [{"attributes": {}}, *tetrahedron()["meshes"][0]["primitives"]], "meshes", 0, "primitives"
    ),
    "a turn of 15 digits": _with([0, 0, 0, 0.999999999999999], "nodes", 1, "rotation"),
    "a scene beside it": _with([{"nodes": [0]}, {"nodes": [1]}], "scenes"),
    "a mesh that is broken and not shown": _with(
        [*tetrahedron()["meshes"], {"primitives": [{}, 5]}, 7], "meshes"
    ),
    "counted extensions": _with(5, "extensionsUsed"),
    "counted materials": _with(5, "materials"),
}


@pytest.mark.parametrize("name", SAME)
def test_odd_gltf_files_equal_plain_mesh(name: str, tmp_path: Path) -> None:
    plain = gltf_file.read(json.dumps(tetrahedron()))
    assert gltf_file.read(json.dumps(SAME[name])) == plain
    assert gltf_file.read_binary(binary(SAME[name])) == plain
    (tmp_path / "a.gltf").write_text(json.dumps(SAME[name]))
    done = forked(["info", "a.gltf"], tmp_path)
    assert done.returncode == 0, done.stderr


def test_other_content_of_gltf_is_named(tmp_path: Path) -> None:
    root = _with([{"nodes": [0]}, {"nodes": []}, {"nodes": [1]}], "scenes")
    root["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 0}]
    root["meshes"][0]["primitives"] += [{"attributes": {"NORMAL": 0}}]
    root |= {"materials": [{}, {}], "extensionsUsed": ["KHR_lights_punctual"], "cameras": {}}
    (tmp_path / "a.gltf").write_text(json.dumps(root))
    done = forked(["info", "a.gltf", "--json"], tmp_path)
    assert json.loads(done.stdout)["passed_over"] == [
        "2 materials",
        "1 part without places",
        "1 part that bends by morph targets",
        "2 scenes beside the first",
        "extension KHR_lights_punctual",
    ]


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [(4, 1, "version 1"), (4, 0, "version 0"), (8, 0, "longer than it says"),
     (8, 2**32 - 1, "incomplete"), (12, 2**32 - 1, "longer than the file"), 
     (12, 0, "longer than the file")],
)  # fmt: skip
def test_heads_of_binary_gltf(place: int, value: int, words: str) -> None:
    data = bytearray(binary(tetrahedron()))
    struct.pack_into("<I", data, place, value)
    with pytest.raises(MeshFileError, match=words):
        gltf_file.read_binary(bytes(data))


def test_small_mesh_far_away_is_read() -> None:
    """Cells of its size, counted from the origin, have numbers that no float holds."""
    root = tetrahedron(scale=[0.0, 1e-290, 1e-290], translation=[1e6 - 10, 0, 0])
    assert len(gltf_file.read(json.dumps(root)).points) >= 3


def test_many_parts_at_many_nodes_are_refused() -> None:
    """Empty parts count too: 2000 parts at 9999 nodes took 100 s."""
    root = tetrahedron()
    empty = {"bufferView": 0, "componentType": 5126, "count": 0, "type": "VEC3"}
    root["accessors"].append(empty)
    root["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 2}}] * 2000
    root["scenes"][0]["nodes"] = [1] * 9999
    with pytest.raises(MeshFileError, match="its nodes show more than"):
        gltf_file.read(json.dumps(root))


@pytest.mark.parametrize("seed", range(30))
def test_gltf_files_with_values_of_other_kinds(seed: int, tmp_path: Path) -> None:
    """Any value of the file replaced by another: it is read, or refused with a sentence."""
    chance = random.Random(seed)
    odd = [None, -1, 0, 1e999, 2**70, "x", [], {}, True, [[]], {"a": 1}]
    n_read = 0
    for _ in range(60):
        root = copy.deepcopy(tetrahedron(translation=[0, 0, 0], rotation=[0, 0, 0, 1]))
        root |= {"materials": [{}], "extensionsUsed": ["a"]}
        holder: Any = root
        while True:
            key = chance.choice([*(holder if isinstance(holder, dict) else range(len(holder)))])
            if (
                not isinstance(holder[key], (dict, list))
                or not holder[key]
                or chance.random() < 0.2
            ):
                break
            holder = holder[key]
        holder[key] = chance.choice(odd)
        try:
            gltf_file.read(json.dumps(root))
        except MeshFileError:
            continue
        n_read += 1
        gltf_file.ignored_contents(root)
    assert n_read > 5


def test_gltf_without_scenes_moves_children_by_their_parents() -> None:
    """Roots are the nodes that are no child; a node without a parent counts, too."""
    root = tetrahedron()
    mesh_number = next(node["mesh"] for node in root["nodes"] if "mesh" in node)
    root["nodes"] = [
        {"translation": [10, 0, 0], "scale": [2, 2, 2], "children": [1]},
        {"mesh": mesh_number, "translation": [1, 0, 0]},
        {"mesh": mesh_number},
    ]
    root["scenes"], root["scene"] = [{"nodes": [0, 2]}], 0
    expected = gltf_file.read(json.dumps(root))
    del root["scenes"], root["scene"]
    mesh = gltf_file.read(json.dumps(root))
    assert set(mesh.points) == set(expected.points)
    assert len(mesh.points) == 8
