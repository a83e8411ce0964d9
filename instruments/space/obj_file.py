"""Meshes of Wavefront OBJ files: vertices become points, edges of faces and lines become springs.

Faces are also kept as triangles, which points can touch.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import pairwise

from ergon.instruments.space.mesh import (
    COORDINATE_MAX,
    MAX_EDGES,
    MAX_FACES,
    MAX_POINTS,
    Mesh,
    MeshFileError,
    with_merged_corners,
)
from ergon.instruments.space.polygons import CONCAVE_CORNERS_MAX, triangles_of_face
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector, quote
from ergon.notation.text.syntax import decode
from ergon.notation.text.values import Place

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_LINE_END = re.compile(r"\r\n|\r|\n")  # \x85 is a letter of older code pages
_CORNER = re.compile(r"([+-]?[0-9]+)(/[+-]?[0-9]*){0,2}")
# Keywords for curves, surfaces and other files, which would be missing from the mesh; what has any
# other keyword (looks, names, groups, single points) says nothing of vertices and edges.
_GEOMETRY_KEYWORDS = frozenset(
    ["curv", "curv2", "surf", "bzp", "bsp", "cdc", "cdp", "res", "call", "csh"]
)


def decoded(content: bytes, file_name: str, collector: Collector) -> str | None:
    """The text of a file, whose names and comments may be in Latin-1; None after saying what is
    wrong.
    """
    try:
        content.decode()
    except UnicodeDecodeError:
        if content[:2] not in (b"\xff\xfe", b"\xfe\xff"):
            content = content.decode("latin-1").encode()
    return decode(content, file_name, collector)


def as_obj_text(mesh: Mesh) -> str:
    """A mesh as text from which `Reader` makes the same mesh."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in mesh.points]
    lines += [f"l {a + 1} {b + 1}" for a, b in mesh.edges]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    return "\n".join([*lines, ""])


def logical_lines(obj_text: str) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, without comments; a backslash at the end continues a line."""
    continued_text, first_number = "", 0
    for number, line in enumerate(_LINE_END.split(obj_text), 1):
        line_text = line.partition("#")[0].rstrip()
        first_number = first_number or number
        if line_text.endswith("\\"):
            continued_text += line_text[:-1] + " "
            continue
        yield first_number, continued_text + line_text
        continued_text, first_number = "", 0
    if continued_text:
        yield first_number, continued_text


class Reader:
    """Reads a file line by line."""

    def __init__(self, document: Document, label: str, collector: Collector) -> None:
        """Take a document; `who` begins error messages."""
        self._document, self._label, self._collector = document, label, collector
        self._points: list[tuple[float, float, float]] = []
        self._edges: dict[tuple[int, int], None] = {}
        self._faces: list[tuple[int, int, int]] = []

    def read_mesh(self, file_place: Place) -> Mesh | None:
        """The mesh of the file; None if an error was reported."""
        for line_number, line in logical_lines(self._document.text):
            try:
                self._read_line(line.split())
            except MeshFileError as error:
                place = Place(self._document.file, line_number, 1)
                self._collector.error(error.code, f"{self._label}: {error}", place)
                return None
        if self._edges:
            return with_merged_corners(
                Mesh(tuple(self._points), tuple(self._edges), tuple(self._faces))
            )
        message = (
            f"{self._label}: the file has no edges; a mesh has lines such as v 0 0 1 and f 1 2 3"
        )
        self._collector.error("E106", message, file_place)
        return None

    def _read_line(self, words: list[str]) -> None:
        line_kind = words[0] if words else ""
        if line_kind == "v":
            self._add_vertex(words[1:])
        elif line_kind in ("f", "l"):
            self._add_edges(line_kind, words[1:])
        elif line_kind in _GEOMETRY_KEYWORDS:
            raise MeshFileError(
                f"{quote(line_kind)} is not read; a mesh has vertices (v), faces (f) and lines (l)"
            )

    def _add_vertex(self, words: list[str]) -> None:
        if len(words) < 3 or not all(map(_NUMBER.fullmatch, words[:3])):
            raise MeshFileError("a vertex has three numbers, such as v 0 0.5 1")
        x, y, z = map(float, words[:3])
        if max(abs(x), abs(y), abs(z)) > COORDINATE_MAX:
            raise MeshFileError(f"a coordinate is at most {COORDINATE_MAX:,.0f}", "E105")
        if len(self._points) == MAX_POINTS:
            raise MeshFileError(f"the file has more than {MAX_POINTS:,} vertices", "E105")
        self._points.append((x, y, z))

    def _add_edges(self, line_kind: str, words: list[str]) -> None:
        corners = [self._corner_index(word) for word in words]
        if len(corners) < (3 if line_kind == "f" else 2):
            raise MeshFileError("a face has three corners or more, a line two")
        ends = [*corners, corners[0]] if line_kind == "f" else corners
        for first_vertex, second_vertex in pairwise(ends):
            if first_vertex == second_vertex:
                raise MeshFileError(f"vertex {first_vertex + 1} is written twice in a row")
            self._edges[min(first_vertex, second_vertex), max(first_vertex, second_vertex)] = None
        if line_kind == "f":
            triangles = triangles_of_face([self._points[corner] for corner in corners])
            if triangles is None:
                raise MeshFileError(
                    f"a face of {len(corners):,} corners has a notch; at most "
                    f"{CONCAVE_CORNERS_MAX:,} are read: write triangles instead",
                    "E105",
                )
            self._faces += [(corners[a], corners[b], corners[c]) for a, b, c in triangles]
        if len(self._edges) > MAX_EDGES:
            raise MeshFileError(f"the file has more than {MAX_EDGES:,} edges", "E105")
        if len(self._faces) > MAX_FACES:
            raise MeshFileError(f"the file has more than {MAX_FACES:,} triangles", "E105")

    def _corner_index(self, word: str) -> int:
        """The index of a vertex, from 0; the word counts from 1, or backward from the last one if
        negative.
        """
        match = _CORNER.fullmatch(word)
        number = int(match[1][:20]) if match else 0
        index = number - 1 if number > 0 else len(self._points) + number
        if number == 0 or not 0 <= index < len(self._points):
            raise MeshFileError(
                f"{quote(word)} is not a vertex of a line above; there are {len(self._points):,}"
            )
        return index
