"""Meshes of glTF files: places by hand, edges of every mode, what is refused."""

import json
from typing import Any

import pytest
from gltf_files import tetrahedron

from ergon.instruments.space import gltf_file
from ergon.instruments.space.mesh import MeshFileError
from ergon.scores.reading.load import load
from ergon.scores.staging.stage import stage


def test_gltf_coincident_vertices_merged():
    mesh = gltf_file.read(json.dumps(tetrahedron()))
    # What is up, y, is z; the x axis stays.
    assert mesh.points == ((10, 0, 0), (11, 0, 0), (10, 0, 1), (10, -1, 0))
    assert sorted(mesh.edges) == [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]


@pytest.mark.parametrize(("offset", "n_points"), [(2e-7, 4), (-5e-7, 4), (2e-5, 8)])
def test_gltf_vertices_merged_within_rounding(offset: float, n_points: int):
    """Two nodes with one mesh: a seam of rounding makes no second body."""
    root = tetrahedron()
    root["nodes"].append({"mesh": 0, "translation": [offset, offset, offset]})
    root["nodes"][0]["children"] = [1, 2]
    mesh = gltf_file.read(json.dumps(root))
    assert len(mesh.points) == n_points
    assert len(mesh.edges) == 5 * n_points // 4


def test_gltf_node_rotation_scale_and_translation():
    half = 0.5**0.5
    # A quarter of a turn around what is up takes x to -z, twice as long, ten away.
    turned = gltf_file.read(json.dumps(tetrahedron(scale=[2, 2, 2], rotation=[0, half, 0, half])))
    columns = [0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1]
    by_matrix = gltf_file.read(json.dumps(tetrahedron(matrix=columns)))
    wanted = ((10, 0, 0), (10, 2, 0), (10, 0, 2), (12, 0, 0))
    for mesh in (turned, by_matrix):
        for place, exact in zip(mesh.points, wanted, strict=True):
            assert place == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize(
    ("mode", "indices", "edges"),
    [
        (1, (0, 1, 2, 5), [(0, 1), (2, 3)]),
        (2, (0, 1, 2), [(0, 1), (0, 2), (1, 2)]),
        (3, (0, 1, 2), [(0, 1), (1, 2)]),
        (5, (0, 1, 2, 5), [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)]),
        (6, (0, 1, 2, 5), [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]),
    ],
)
def test_gltf_edges_of_primitive_modes(mode: int, indices: tuple[int, ...], edges: list):
    assert sorted(gltf_file.read(json.dumps(tetrahedron(mode, indices))).edges) == edges


def _without(*path: str | int) -> str:
    root = tetrahedron()
    holder: Any = root
    for word in path[:-1]:
        holder = holder[word]
    del holder[path[-1]]
    return json.dumps(root)


def _with(value: Any, *path: str | int) -> str:
    root = tetrahedron()
    holder: Any = root
    for word in path[:-1]:
        holder = holder[word]
    holder[path[-1]] = value
    return json.dumps(root)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not the JSON of a glTF file"),
        ("[" * 100_000, "not the JSON of a glTF file"),
        ("[]", "it is incomplete"),
        (_without("asset"), "it is incomplete"),
        (_without("meshes"), "it is incomplete"),
        (_without("accessors", 1), "it is incomplete"),
        (_with("1.0", "asset", "version"), "not version 1.0"),
        (_with(["KHR_draco_mesh_compression"], "extensionsRequired"), "KHR_draco_mesh_compression"),
        (
            _with("mesh.bin", "buffers", 0, "uri"),
            "write it as one file: glTF Binary (.glb) or Embedded (.gltf)",
        ),
        (_with("data:x;base64,!", "buffers", 0, "uri"), "its data is not base64"),
        (_with([0], "nodes", 1, "children"), "contains itself"),
        (_with(-1, "nodes", 1, "mesh"), "it is incomplete"),
        (_with(10**9, "accessors", 0, "count"), "more than"),
        (_with(7, "accessors", 0, "count"), "it is incomplete"),
        (_with([float("nan"), 0, 0], "nodes", 1, "translation"), "it is incomplete"),
        (_with([1e9, 0, 0], "nodes", 1, "translation"), "at most 1,000,000"),
        (_with([], "nodes", 0, "children"), "the scene has no edges"),
        (_with({}, "accessors", 0, "sparse"), "sparse"),
    ],
)
def test_damaged_gltf_files_are_refused(text: str, message: str):
    with pytest.raises(MeshFileError) as refused:
        gltf_file.read(text)
    assert message in str(refused.value)


SCORE = """\
ergon: 1
instruments:
  a:
    space: 3
    gravity: 9.81m/s2
    modules:
      rock: {MESH: {file: %s, at: [0, 0, 0], scale: 1cm, M: 8g, K: 1kN/m, held: top}}
    out: {SOX: rock.0.z}
render: {tail: 0.1s}
"""


def test_score_with_gltf_net(tmp_path):
    (tmp_path / "rock.gltf").write_text(json.dumps(tetrahedron()))
    (tmp_path / "s.yaml").write_text(SCORE % "rock.gltf")
    piece = load(str(tmp_path / "s.yaml")).piece
    network = stage(piece).built_network.network
    assert (network.n_mat, network.n_lia) == (12, 5)


@pytest.mark.parametrize(
    ("file", "code", "message"),
    [("rock.glb", "E106", "not a binary glTF file"), ("rock.gltf", "E106", "it is incomplete")],
)
def test_score_with_wrong_mesh_file(tmp_path, file: str, code: str, message: str):
    (tmp_path / file).write_text("{}")
    (tmp_path / "s.yaml").write_text(SCORE % file)
    reports = load(str(tmp_path / "s.yaml")).diagnostics
    assert [(one.code, message in one.message) for one in reports] == [(code, True)]
