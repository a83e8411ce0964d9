"""Meshes of glTF files (Khronos, glTF 2.0): vertices become points, edges of triangles springs.

Only self-contained files are read: glTF Embedded, and binary ones (.glb). A binary file is kept
as a text of the same mesh, because a session and its journal keep only texts. Programs write a
vertex several times where its colour or normal changes; vertices at one place become one point.
"""

from __future__ import annotations

import base64
import binascii
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from ergon.common.structured import MalformedTextError, parse_json
from ergon.instruments.space.mesh import (
    COORDINATE_MAX,
    MAX_EDGES,
    MAX_FACES,
    MAX_POINTS,
    Mesh,
    MeshFileError,
    with_merged_corners,
)

_Position = tuple[float, float, float]
# Rows of a matrix: the coefficients of a point's coordinates, and an offset.
_Matrix = tuple[tuple[float, float, float, float], ...]

MAX_NODES = 10_000
_READ_ITEMS_MAX = 8 * MAX_EDGES  # positions and indices
_IDENTITY: _Matrix = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))
_DATA_URI_PREFIX = "data:"
_FLOAT_COMPONENT = 5126
MAGIC = b"glTF"
_FILE_HEADER = struct.Struct("<4sII")  # magic, version, length of the file
_CHUNK_HEADER = struct.Struct("<I4s")  # length, kind
_JSON, _BIN = b"JSON", b"BIN\0"
# What a file that lacks something, or has something of another kind, is refused by.
_MALFORMED_ERRORS = (
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    ValueError,
    OverflowError,
    struct.error,
)
_IGNORED_SECTIONS = ("materials", "textures", "images", "animations", "skins", "cameras")
_INDEX_FORMATS = {5121: ("B", 1), 5123: ("H", 2), 5125: ("I", 4)}


def read(gltf_text: str | bytes, binary: bytes | None = None) -> Mesh:
    """The mesh of a file's scene; its y axis, which points up, becomes z. Raises MeshFileError.

    `binary` is the data chunk of a binary file.
    """
    try:
        root = parse_json(gltf_text)
    except MalformedTextError as error:
        raise MeshFileError("it is not the JSON of a glTF file") from error
    try:
        return _Reader(root, binary).read_mesh()
    except _MALFORMED_ERRORS as error:
        raise MeshFileError("it is incomplete: something that it refers to is missing") from error


def read_binary(content: bytes) -> Mesh:
    """The mesh of a binary file, as from `read`. Raises MeshFileError."""
    if len(content) < _FILE_HEADER.size or not content.startswith(MAGIC):
        raise MeshFileError("it is not a binary glTF file")
    _, version, file_length = _FILE_HEADER.unpack_from(content)
    if version != 2:
        raise MeshFileError(f"glTF 2 is read, not version {version}")
    if file_length != len(content):
        length_problem = "incomplete" if file_length > len(content) else "longer than it says"
        raise MeshFileError(
            f"it is {length_problem}: {file_length:,} bytes are promised, {len(content):,} there"
        )
    chunks: list[tuple[bytes, bytes]] = []
    offset = _FILE_HEADER.size
    while offset < file_length and len(chunks) < 2:  # further chunks belong to extensions
        if file_length - offset < _CHUNK_HEADER.size:
            raise MeshFileError("it is incomplete: a chunk has no head")
        chunk_size, chunk_kind = _CHUNK_HEADER.unpack_from(content, offset)
        offset += _CHUNK_HEADER.size
        if chunk_size > file_length - offset:
            raise MeshFileError("it is incomplete: a chunk is longer than the file")
        chunks.append((chunk_kind, content[offset : offset + chunk_size]))
        offset += chunk_size
    if not chunks or chunks[0][0] != _JSON:
        raise MeshFileError("its first chunk is no JSON")
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BIN else None
    return read(chunks[0][1], binary)


def ignored_contents(root: Mapping[str, Any]) -> list[str]:
    """What the file of a mesh that was read holds beside it."""
    contents: list[str] = []

    def add_count(n: int, noun: str) -> None:
        noun_head, _, noun_rest = noun.partition(" ")
        if n:
            contents.append(f"{n:,} {noun_head}{'' if n == 1 else 's'} {noun_rest}".rstrip())

    for name in _IGNORED_SECTIONS:
        section = root.get(name)
        add_count(len(section) if isinstance(section, (list, dict)) else bool(section), name[:-1])
    parts = [*_primitives(root)]
    add_count(sum("POSITION" not in part["attributes"] for part in parts), "part without places")
    add_count(sum(bool(part.get("targets")) for part in parts), "part that bends by morph targets")
    scenes, extensions = root.get("scenes"), root.get("extensionsUsed")
    add_count(max(0, len(scenes) - 1) if isinstance(scenes, list) else 0, "scene beside the first")
    names = extensions if isinstance(extensions, list) else []
    return contents + [f"extension {str(name)[:60]}" for name in names]


def _primitives(root: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """All parts of meshes; those that no node shows may be broken, and are not read."""
    for mesh in root["meshes"]:
        parts = mesh.get("primitives") if isinstance(mesh, dict) else None
        for part in parts if isinstance(parts, list) else []:
            if isinstance(part, dict) and isinstance(part.get("attributes"), dict):
                yield part


class _Reader:
    def __init__(self, gltf_root: Any, binary: bytes | None) -> None:
        self._root = gltf_root
        self._binary = binary
        version = str(gltf_root["asset"]["version"])
        if version.partition(".")[0] != "2":
            raise MeshFileError(f"glTF 2 is read, not version {version[:20]}")
        for needed in gltf_root.get("extensionsRequired", ()):
            raise MeshFileError(f"it needs the extension {str(needed)[:60]}, which is not read")
        self._buffers: dict[int, memoryview] = {}
        self._index_by_point: dict[_Position, int] = {}
        self._edges: dict[tuple[int, int], None] = {}
        self._faces: list[tuple[int, int, int]] = []
        self._n_items_read = 0

    def read_mesh(self) -> Mesh:
        """All meshes of the scene as a single one."""
        nodes = self._root.get("nodes", [])
        scenes = self._root.get("scenes")
        if scenes:
            tops = scenes[_index(self._root.get("scene", 0))].get("nodes", [])
        else:  # the nodes that are no child of another
            children = {_index(child) for node in nodes for child in node.get("children", ())}
            tops = [number for number in range(len(nodes)) if number not in children]
        pending = [(_index(top), _IDENTITY) for top in tops]
        n_visited = 0
        while pending:
            node_index, parent_matrix = pending.pop()
            n_visited += 1
            if n_visited > MAX_NODES:
                raise MeshFileError(
                    f"the scene has more than {MAX_NODES:,} nodes, or contains itself"
                )
            node = nodes[node_index]
            matrix = _matrix_product(parent_matrix, _node_matrix(node))
            if "mesh" in node:
                for part in self._root["meshes"][_index(node["mesh"])]["primitives"]:
                    self._count_read(4)
                    if "POSITION" in part["attributes"]:
                        self._add_primitive(part, matrix)
            pending += [(_index(child), matrix) for child in node.get("children", ())]
        if not self._edges:
            raise MeshFileError("the scene has no edges; a mesh has triangles or lines")
        return with_merged_corners(
            Mesh(tuple(self._index_by_point), tuple(self._edges), tuple(self._faces))
        )

    def _add_primitive(self, part: Mapping[str, Any], matrix: _Matrix) -> None:
        points = [_transformed(matrix, point) for point in self._positions(part)]
        point_indices = [self._point_index(point) for point in points]
        corner_numbers = (
            self._indices(part["indices"]) if "indices" in part else list(range(len(point_indices)))
        )
        for a, b in _edges(part.get("mode", 4), corner_numbers):
            first, other = point_indices[a], point_indices[b]
            if first != other:
                self._edges[min(first, other), max(first, other)] = None
        for triangle in _triangles(part.get("mode", 4), corner_numbers):
            a, b, c = (point_indices[index] for index in triangle)
            if len({a, b, c}) == 3:
                self._faces.append((a, b, c))
        if len(self._edges) > MAX_EDGES:
            raise MeshFileError(f"the file has more than {MAX_EDGES:,} edges", "E105")
        if len(self._faces) > MAX_FACES:
            raise MeshFileError(f"the file has more than {MAX_FACES:,} triangles", "E105")

    def _point_index(self, point: _Position) -> int:
        if not max(map(abs, point)) <= COORDINATE_MAX:
            raise MeshFileError(f"a coordinate is at most {COORDINATE_MAX:,.0f}", "E105")
        point_number = self._index_by_point.setdefault(point, len(self._index_by_point))
        if point_number >= MAX_POINTS:
            raise MeshFileError(f"the file has more than {MAX_POINTS:,} vertices", "E105")
        return point_number

    def _positions(self, part: Mapping[str, Any]) -> Iterator[_Position]:
        accessor = self._root["accessors"][_index(part["attributes"]["POSITION"])]
        if (accessor["type"], accessor["componentType"]) != ("VEC3", _FLOAT_COMPONENT):
            raise MeshFileError("positions are three floats each")
        yield from self._accessor_items(accessor, "<3f", 12)

    def _indices(self, number: Any) -> list[int]:
        accessor = self._root["accessors"][_index(number)]
        letter, size = _INDEX_FORMATS[accessor["componentType"]]
        return [index for (index,) in self._accessor_items(accessor, f"<{letter}", size)]

    def _accessor_items(self, accessor: Mapping[str, Any], form: str, size: int) -> Iterator[Any]:
        if "sparse" in accessor or "bufferView" not in accessor:
            raise MeshFileError("it has sparse values, which are not read")
        view = self._root["bufferViews"][_index(accessor["bufferView"])]
        byte_offset = _index(view.get("byteOffset", 0))
        buffer_bytes = self._buffer(_index(view["buffer"]))[
            byte_offset : byte_offset + _index(view["byteLength"])
        ]
        item_count, byte_step = _index(accessor["count"]), _index(view.get("byteStride", size))
        if byte_step < size:
            raise MeshFileError(f"its values of {size} bytes lie {byte_step} bytes apart")
        self._count_read(item_count)
        if item_count > 3 * MAX_EDGES:
            raise MeshFileError(f"the file has more than {MAX_EDGES:,} edges", "E105")
        byte_offset = _index(accessor.get("byteOffset", 0))
        return (
            struct.unpack_from(form, buffer_bytes, byte_offset + i * byte_step)
            for i in range(item_count)
        )

    def _count_read(self, n: int) -> None:
        """Count what was read: also again, because many nodes may show one mesh."""
        self._n_items_read += n
        if self._n_items_read > _READ_ITEMS_MAX:
            raise MeshFileError(f"its nodes show more than {_READ_ITEMS_MAX:,} vertices", "E105")

    def _buffer(self, number: int) -> memoryview:
        """The bytes of a buffer; a slice of them is no copy."""
        if number not in self._buffers:
            buffer = self._root["buffers"][number]
            if number == 0 and self._binary is not None and "uri" not in buffer:
                self._buffers[number] = memoryview(self._binary)
                return self._buffers[number]
            address = str(buffer.get("uri", ""))
            head, comma, buffer_bytes = address.partition(",")
            if not head.startswith(_DATA_URI_PREFIX) or not comma or not head.endswith(";base64"):
                raise MeshFileError(
                    "its data is in another file; write it as one file: glTF Binary (.glb) or "
                    "Embedded (.gltf)"
                )
            try:
                self._buffers[number] = memoryview(base64.b64decode(buffer_bytes, validate=True))
            except (binascii.Error, ValueError) as error:
                raise MeshFileError("its data is not base64") from error
        return self._buffers[number]


def _index(index_value: Any) -> int:
    """A non-negative integer; a negative index would count from the end of a list. Some programs
    write every number with a point: 6.0.
    """
    if isinstance(index_value, float) and index_value.is_integer():
        return _index(int(index_value))
    if not isinstance(index_value, int) or isinstance(index_value, bool) or index_value < 0:
        raise TypeError
    return index_value


def _edges(primitive_mode: Any, corners: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Edges by primitive mode: points, lines, a line loop, a line strip, triangles, a strip or a
    fan of them.
    """
    n = len(corners)
    if primitive_mode == 1:
        yield from zip(corners[::2], corners[1::2], strict=False)
    elif primitive_mode in (2, 3):
        yield from pairwise(corners)
        if primitive_mode == 2 and n:
            yield corners[-1], corners[0]
    elif primitive_mode == 4:
        for i in range(0, n - n % 3, 3):
            a, b, c = corners[i : i + 3]
            yield from ((a, b), (b, c), (c, a))
    elif primitive_mode == 5:
        yield from pairwise(corners)
        yield from zip(corners, corners[2:], strict=False)
    elif primitive_mode == 6:
        yield from pairwise(corners)
        yield from ((corners[0], corner) for corner in corners[2:])
    elif primitive_mode != 0:
        raise TypeError


def _triangles(primitive_mode: Any, corners: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Triangles by primitive mode: single ones, a strip or a fan; other modes have none."""
    n = len(corners)
    if primitive_mode == 4:
        for i in range(0, n - n % 3, 3):
            yield corners[i], corners[i + 1], corners[i + 2]
    elif primitive_mode == 5:
        yield from zip(corners, corners[1:], corners[2:], strict=False)
    elif primitive_mode == 6:
        yield from ((corners[0], a, b) for a, b in pairwise(corners[1:]))


def _node_matrix(scene_node: Mapping[str, Any]) -> _Matrix:
    """The matrix that places the points of a node."""
    if "matrix" in scene_node:  # by columns
        m = _floats(scene_node["matrix"], 16)
        return tuple((m[row], m[4 + row], m[8 + row], m[12 + row]) for row in range(3))
    x, y, z, w = _floats(scene_node.get("rotation", (0, 0, 0, 1)), 4)
    if not 0.99 < x * x + y * y + z * z + w * w < 1.01:
        raise MeshFileError("a rotation of it is no unit quaternion")
    scale = _floats(scene_node.get("scale", (1, 1, 1)), 3)
    translation = _floats(scene_node.get("translation", (0, 0, 0)), 3)
    rotation = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return tuple(
        (row[0] * scale[0], row[1] * scale[1], row[2] * scale[2], offset)
        for row, offset in zip(rotation, translation, strict=True)
    )


def _floats(values: Any, n: int) -> list[float]:
    if any(isinstance(value, (str, bool)) for value in values):
        raise TypeError
    number_list = [float(value) for value in values]
    if len(number_list) != n or not all(map(math.isfinite, number_list)):
        raise TypeError
    return number_list


def _matrix_product(a: _Matrix, b: _Matrix) -> _Matrix:
    matrix_rows = []
    for a_row in a:
        row = [sum(a_row[k] * b[k][column] for k in range(3)) for column in range(4)]
        matrix_rows.append((row[0], row[1], row[2], row[3] + a_row[3]))
    return tuple(matrix_rows)


def _transformed(matrix: _Matrix, point: Sequence[float]) -> _Position:
    x, y, z = (row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3] for row in matrix)
    return x, 0.0 - z, y
