"""OBJ and glTF files as other programs write them, beside numpy and scipy."""

from __future__ import annotations

import base64
import itertools
import json
import random
import struct
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ergon.instruments.space import gltf_file
from ergon.instruments.space.mesh import Mesh
from ergon.instruments.space.obj_file import Reader, decoded
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector
from ergon.notation.text.values import Place

_SAYS_NOTHING = [
    b"", b"# comment 1 2 3", b"o Cube.001", b"g a b", b"usemtl M\xe4t", b"s off", b"s 1",
    b"vn 0.0 1.0 0.0", b"vt 0.5 0.5", b"mtllib x y.mtl", b"vp 0.1", b"p 1", b"#\x85 v 1 2 3",
    b"shadow_obj a.obj", b"lod 3", b"cstype bezier", b"deg 3", b"end",
]  # fmt: skip


@pytest.mark.parametrize("seed", range(50))
def test_obj_files_of_other_programs(seed: int) -> None:
    chance = random.Random(seed)
    points: list[tuple[float, ...]] = []
    edges: set[tuple[int, int]] = set()
    n_faces, lines = 0, []
    for _ in range(chance.randrange(1, 6)):
        for _ in range(chance.randrange(5, 9)):
            point = tuple(round(chance.uniform(-9, 9), 4) for _ in range(3))
            points.append(point)
            form = chance.choice(["{:.6f}", "{:g}", "{:+.4f}", "{:.6e}"])
            more = chance.choice([[], ["1.0"], ["0.5", "0.5", "0.5"]])
            lines.append(" ".join(["v", *map(form.format, point), *more]).encode())
        for _ in range(chance.randrange(1, 6)):
            corners = chance.sample(range(len(points)), chance.choice([3, 3, 4, 5]))
            is_face = chance.random() < 0.8
            shift = len(points) if chance.random() < 0.3 else -1
            tail = chance.choice(["", "/1", "//1", "/1/1"]) if is_face else ""
            words = [f"{corner - shift}{tail}" for corner in corners]
            split = " \\\n " if chance.random() < 0.2 else " "
            lines.append((("f" if is_face else "l") + " " + split.join(words)).encode())
            ends = [*corners, corners[0]] if is_face else corners
            edges |= {(min(a, b), max(a, b)) for a, b in itertools.pairwise(ends)}
            n_faces += len(corners) - 2 if is_face else 0
    with_others = [row for line in lines for row in (chance.choice(_SAYS_NOTHING), line)]
    data = chance.choice([b"\n", b"\r\n"]).join(with_others) + chance.choice([b"", b"\n"])
    collector = Collector()
    text = decoded(data, "x.obj", collector)
    assert text is not None
    mesh = Reader(Document("x.obj", text), "m", collector).read_mesh(Place("x.obj", 1, 1))
    assert mesh is not None, collector.finish()
    np.testing.assert_allclose(mesh.points, points, rtol=1e-5)
    assert set(mesh.edges) == edges
    assert len(mesh.faces) == n_faces


def _node(chance: random.Random, numbers: np.random.Generator) -> tuple[dict[str, Any], np.ndarray]:
    """A node's place as a matrix or as its parts, and its matrix (4, 4)."""
    turn = Rotation.from_quat(numbers.normal(size=4))
    scale, to = numbers.uniform(0.5, 2.0, 3), numbers.uniform(-3, 3, 3)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix() * scale, to
    match chance.randrange(3):
        case 0:
            return {}, np.eye(4)
        case 1:
            return {"matrix": matrix.T.ravel().tolist()}, matrix
        case _:
            parts = {"rotation": turn.as_quat(), "scale": scale, "translation": to}
            return {name: value.tolist() for name, value in parts.items()}, matrix


@pytest.mark.parametrize("seed", range(50))
def test_gltf_files_of_other_programs(seed: int) -> None:
    chance, numbers = random.Random(seed), np.random.default_rng(seed)
    n = chance.randrange(4, 40)
    places = numbers.uniform(-1, 1, (n, 3)).astype("<f4")
    corners = [chance.sample(range(n), 3) for _ in range(chance.randrange(2, 30))]
    is_indexed = chance.random() < 0.8
    if not is_indexed:
        places, corners = places[np.ravel(corners)], []
        corners = np.arange(len(places)).reshape(-1, 3).tolist()
    stride, begin = chance.choice([12, 12, 24, 32]), chance.choice([0, 4, 12])
    rows = bytearray(bytes(begin) + bytes(stride) * len(places))
    for number, place in enumerate(places):
        struct.pack_into("<3f", rows, begin + number * stride, *place.tolist())
    kind, letter = chance.choice([(5121, "B"), (5123, "H"), (5125, "I")])
    indices = struct.pack(f"<{3 * len(corners)}{letter}", *np.ravel(corners).tolist())
    if not is_indexed:
        indices = b""
    data = bytes(rows) + bytes(-len(rows) % 4)
    views: list[dict[str, Any]] = [{"buffer": 0, "byteLength": len(rows), "target": 34962}]
    if stride != 12:
        views[0]["byteStride"] = stride
    views.append({"buffer": 0, "byteOffset": len(data), "byteLength": max(1, len(indices))})
    data += indices or b"\0"
    accessors = [
        {"bufferView": 0, "byteOffset": begin, "componentType": 5126, "count": len(places),
         "type": "VEC3", "min": [-1, -1, -1], "max": [1, 1, 1]},
        {"bufferView": 1, "componentType": kind, "count": 3 * len(corners), "type": "SCALAR"},
    ]  # fmt: skip
    part: dict[str, Any] = {"attributes": {"POSITION": 0, "NORMAL": 0}, "material": 0}
    part |= {"indices": 1} if is_indexed else {}
    part |= {"mode": 4} if chance.random() < 0.5 else {}
    outer, inner = _node(chance, numbers), _node(chance, numbers)
    root: dict[str, Any] = {
        "asset": {"version": chance.choice(["2.0", "2.1"]), "generator": "x"},
        "scene": 0, "scenes": [{"nodes": [1], "name": "S"}],
        "nodes": [{"mesh": 0, "name": "M", **inner[0]}, {"children": [0, 2], **outer[0]},
                  {"camera": 0}],
        "cameras": [{"type": "perspective"}], "materials": [{"name": "m"}],
        "extensionsUsed": ["KHR_materials_ior"],
        "meshes": [{"primitives": [part]}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }  # fmt: skip
    if chance.random() < 0.5:
        text = json.dumps(root).encode()
        text += b" " * (-len(text) % 4)
        padded = data + bytes(-len(data) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(padded), b"BIN\0") + padded
        mesh = gltf_file.read_binary(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    else:
        head = chance.choice(["application/octet-stream", "application/gltf-buffer"])
        uri = f"data:{head};base64,{base64.b64encode(data).decode()}"
        root["buffers"][0]["uri"] = uri
        mesh = gltf_file.read(json.dumps(root))
    moved = np.c_[places, np.ones(len(places))] @ (outer[1] @ inner[1]).T
    expected = moved[:, [0, 2, 1]] * (1, -1, 1)  # y is up in the file, z here
    near = np.linalg.norm(expected[:, None] - np.array(mesh.points)[None], axis=2)
    same = near.argmin(axis=1)
    used = sorted({corner for face in corners for corner in face})
    assert near.min(axis=1)[used].max() < 1e-5
    edges = {
        tuple(sorted((same[a], same[b])))
        for face in corners
        for a, b in ((face[0], face[1]), (face[1], face[2]), (face[2], face[0]))
    }
    assert {tuple(sorted(edge)) for edge in mesh.edges} == edges
    assert len(mesh.faces) == len(corners)


def _obj(text: bytes) -> Mesh:
    collector = Collector()
    document = Document("x.obj", str(decoded(text, "x.obj", collector)))
    mesh = Reader(document, "m", collector).read_mesh(Place("x.obj", 1, 1))
    assert mesh is not None
    return mesh


def test_obj_faces_with_separate_vertices_are_one_body() -> None:
    """As programs write it that keep a vertex for each corner: a seam would leave two bodies."""
    corners = [(0, 0), (1, 0), (0, 1), (1, 0), (1, 1 + 1e-7), (0, 1)]
    vertices = "".join(f"v {x} {y} 0\n" for x, y in corners)
    mesh = _obj(f"{vertices}f 1 2 3\nf 4 5 6\n".encode())
    assert (len(mesh.points), len(mesh.edges), len(mesh.faces)) == (4, 5, 2)


def test_obj_lines_with_points_at_one_place_stay_apart() -> None:
    mesh = _obj(b"v 0 0 0\nv 1 0 0\nv 1 0 0\nv 2 0 0\nl 1 2\nl 3 4\n")
    assert (len(mesh.points), len(mesh.edges)) == (4, 2)


def _area_and_cover(mesh: Mesh) -> tuple[float, np.ndarray]:
    """The sum of the areas of the triangles, and the normal of each."""
    points = np.array(mesh.points)[np.array(mesh.faces)]
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]) / 2.0
    return float(np.linalg.norm(normals, axis=1).sum()), normals


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("n", [4, 5, 9, 24])
def test_obj_concave_faces_are_covered_once(seed: int, n: int) -> None:
    """Stars with notches, turned in space, from any first corner, either way round."""
    numbers = np.random.default_rng(seed)
    phases = np.sort(numbers.uniform(0.0, 2.0 * np.pi / n, n) + np.arange(n) * 2.0 * np.pi / n)
    radii = numbers.uniform(0.2, 1.0, n)
    x, y = radii * np.cos(phases), radii * np.sin(phases)
    gaps = np.diff([*phases, phases[0] + 2.0 * np.pi])
    area = float((radii * np.roll(radii, -1) * np.sin(gaps)).sum() / 2.0)
    turn = Rotation.random(random_state=seed).as_matrix()
    points = np.stack([x, y, 0.0 * x], 1) @ turn.T + [3.0, 0.0, -2.0]
    vertices = "".join(f"v {a!r} {b!r} {c!r}\n" for a, b, c in points.tolist())
    order = np.roll(np.arange(1, n + 1), seed)[:: 1 if seed % 2 else -1]
    mesh = _obj(f"{vertices}f {' '.join(map(str, order))}\n".encode())
    covered, normals = _area_and_cover(mesh)
    assert len(mesh.faces) == n - 2
    assert covered == pytest.approx(area, rel=1e-9)
    assert (normals @ normals.sum(axis=0) > -1e-12).all(), "a triangle is turned"


def test_obj_chevron_leaves_its_notch_free() -> None:
    mesh = _obj(b"v 1 2 0\nv 0 0 0\nv 1 1 0\nv 2 0 0\nf 2 3 4 1\n")
    assert _area_and_cover(mesh)[0] == pytest.approx(1.0)


def test_obj_face_with_notch_and_thousands_of_corners_is_refused() -> None:
    corners = [(i, 1.0 if i % 2 else 0.0) for i in range(1_200)] + [(1_199, 9.0), (0, 9.0)]
    text = "".join(f"v {x} {y} 0\n" for x, y in corners)
    collector = Collector()
    text += "f " + " ".join(str(i + 1) for i in range(len(corners))) + "\n"
    document = Document("x.obj", str(decoded(text.encode(), "x.obj", collector)))
    assert Reader(document, "m", collector).read_mesh(Place("x.obj", 1, 1)) is None
    assert "write triangles instead" in collector.finish()[0].message


def test_seam_far_from_the_origin_is_merged() -> None:
    """Two panels whose common edge is rounded to single precision, in one of them beforehand."""
    quad = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    first = (quad + np.array([123.456, 0.0, 0.0])).astype("f4").astype(float).tolist()
    second = (quad.astype("f4").astype(float) + np.array([123.556, 0.0, 0.0])).tolist()
    vertices = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in [*first, *second])
    mesh = _obj(f"{vertices}f 1 2 3 4\nf 5 6 7 8\n".encode())
    assert (len(mesh.points), len(mesh.edges)) == (6, 7)


def test_small_mesh_far_from_the_origin_keeps_its_corners() -> None:
    vertices = "v 1000 0 0\nv 1000.00001 0 0\nv 1000.00001 0.00001 0\n"
    assert len(_obj(f"{vertices}f 1 2 3\n".encode()).points) == 3
