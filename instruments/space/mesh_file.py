"""The file of a MESH or of a wall: Wavefront OBJ, or glTF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import Protocol

from ergon.common.foreign_files import foreign_form
from ergon.instruments.space import gltf_file, obj_file
from ergon.instruments.space.mesh import Mesh, MeshFileError
from ergon.notation.tables.fields import Values
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector
from ergon.notation.text.syntax import Decoder, decode
from ergon.notation.text.values import Place

_BINARY = ".glb"
_GLTF = ".gltf"


class ReadFile(Protocol):
    """Reads a file that a score names; None if an error was reported."""

    def __call__(self, name: str, place: Place, decoder: Decoder = ..., /) -> Document | None:
        """Read a file by its name, which is written at a place; `decoder` turns its bytes into
        text.
        """


def with_mesh_of_file(values: Values, read: ReadFile, collector: Collector) -> Values:
    """The fields of a MESH, or of a wall, with the mesh of the file that they name; reports
    errors.
    """
    name = values.by_name.get("file")
    if not isinstance(name, str):
        return values
    place, file_label = values.place_of("file"), values.context.label("file")
    kind = PurePath(name).suffix.lower()
    if (foreign_kind := foreign_form(b"", PurePath(name))) is not None:
        collector.error("E106", f"{file_label}: {foreign_kind}", place)
        by_name = {field: value for field, value in values.by_name.items() if field != "file"}
        return replace(values, by_name=by_name)
    document = read(name, place, _DECODERS.get(kind, obj_file.decoded))
    mesh = None
    if document is not None and kind == _GLTF:
        mesh = _mesh_of_gltf(document, file_label, collector)
    elif document is not None:
        mesh = obj_file.Reader(document, file_label, collector).read_mesh(place)
    fields = {field: value for field, value in values.by_name.items() if field != "file"}
    return replace(values, by_name=fields if mesh is None else {**fields, "file": mesh})


def _mesh_of_gltf(document: Document, label: str, collector: Collector) -> Mesh | None:
    try:
        return gltf_file.read(document.text)
    except MeshFileError as error:
        collector.error(error.code, f"{label}: {error}", Place(document.file, 1, 1))
        return None


def _glb_as_obj_text(data: bytes, name: str, collector: Collector) -> str | None:
    """The mesh of a binary glTF as the text of a Wavefront OBJ, the form in which the file is
    kept.
    """
    if data.startswith(b"v "):  # the kept text, written to a file again
        return decode(data, name, collector)
    try:
        return obj_file.as_obj_text(gltf_file.read_binary(data))
    except MeshFileError as error:
        collector.error(error.code, str(error), Place(name, 1, 1))
        return None


_DECODERS: dict[str, Decoder] = {_BINARY: _glb_as_obj_text, _GLTF: decode}
