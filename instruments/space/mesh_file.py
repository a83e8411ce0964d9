"""The file of a MESH: Wavefront OBJ, or glTF."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import PurePath

from ergon.instruments.space import gltf_file
from ergon.instruments.space.mesh import Mesh, MeshFileError
from ergon.instruments.space.obj_file import Reader
from ergon.notation.tables.fields import Values
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector
from ergon.notation.text.values import Place

_BINARY = ".glb"
_GLTF = ".gltf"


def from_file(
    values: Values, read: Callable[[str, Place], Document | None], collector: Collector
) -> Values:
    """The fields of a MESH with the mesh of the file that it names; reports."""
    name = values.given.get("file")
    if not isinstance(name, str):
        return values
    place, who = values.place_of("file"), values.context.of("file")
    mesh = None
    if PurePath(name).suffix.lower() == _BINARY:
        message = f"{who}: a binary glTF is not read; write it as text: glTF Embedded (.gltf)"
        collector.error("E206", message, place)
    elif (document := read(name, place)) is not None:
        if PurePath(name).suffix.lower() == _GLTF:
            mesh = _gltf(document, who, collector)
        else:
            mesh = Reader(document, who, collector).mesh(place)
    given = {field: value for field, value in values.given.items() if field != "file"}
    return replace(values, given=given if mesh is None else {**given, "file": mesh})


def _gltf(document: Document, who: str, collector: Collector) -> Mesh | None:
    try:
        return gltf_file.read(document.text)
    except MeshFileError as error:
        collector.error(error.code, f"{who}: {error}", Place(document.file, 1, 1))
        return None
