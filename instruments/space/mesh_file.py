"""The file of a MESH or of a wall: Wavefront OBJ, or glTF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import Protocol

from ergon.instruments.space import gltf_file, obj_file
from ergon.instruments.space.mesh import Mesh, MeshFileError
from ergon.notation.tables.fields import Values
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector
from ergon.notation.text.syntax import Decoder, decode
from ergon.notation.text.values import Place

_BINARY = ".glb"
_GLTF = ".gltf"


class Read(Protocol):
    """Reads a file that a score names; None if an error was reported."""

    def __call__(self, name: str, place: Place, decoder: Decoder = ..., /) -> Document | None:
        """Read a file by its name, which is written at a place; `decoder` turns its bytes into
        text.
        """


def from_file(mesh_values: Values, read_file: Read, collector: Collector) -> Values:
    """The fields of a MESH, or of a wall, with the mesh of the file that they name; reports
    errors.
    """
    file_name = mesh_values.by_name.get("file")
    if not isinstance(file_name, str):
        return mesh_values
    file_place, file_label = mesh_values.place_of("file"), mesh_values.context.label("file")
    file_ending = PurePath(file_name).suffix.lower()
    document = read_file(file_name, file_place, _DECODERS.get(file_ending, obj_file.decoded))
    mesh = None
    if document is not None and file_ending == _GLTF:
        mesh = _gltf(document, file_label, collector)
    elif document is not None:
        mesh = obj_file.Reader(document, file_label, collector).mesh(file_place)
    fields = {field: value for field, value in mesh_values.by_name.items() if field != "file"}
    return replace(mesh_values, by_name=fields if mesh is None else {**fields, "file": mesh})


def _gltf(document: Document, module_label: str, collector: Collector) -> Mesh | None:
    try:
        return gltf_file.read(document.text)
    except MeshFileError as error:
        collector.error(error.code, f"{module_label}: {error}", Place(document.file, 1, 1))
        return None


def _as_text(file_bytes: bytes, file_name: str, collector: Collector) -> str | None:
    """The mesh of a binary glTF as the text of a Wavefront OBJ, the form in which the file is
    kept.
    """
    if file_bytes.startswith(b"v "):  # the kept text, written to a file again
        return decode(file_bytes, file_name, collector)
    try:
        return obj_file.written(gltf_file.read_binary(file_bytes))
    except MeshFileError as error:
        collector.error(error.code, str(error), Place(file_name, 1, 1))
        return None


_DECODERS: dict[str, Decoder] = {_BINARY: _as_text, _GLTF: decode}
