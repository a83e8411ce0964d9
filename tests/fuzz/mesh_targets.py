"""Meshes of other programs: glTF as text and as bytes, Wavefront OBJ."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from pathlib import Path

import gltf_files
from corrupted import corrupted

from ergon.instruments.space import gltf_file, obj_file
from ergon.instruments.space.mesh import MeshFileError
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector, full
from ergon.notation.text.values import Place
from tests.fuzz.harness import Target
from tests.fuzz.texts import NUMBERS, damaged

ROOT = gltf_files.tetrahedron()
WORDS = ("[", "]", "{", "}", "null", '"matrix":', '"children": [0]', "-1", "9" * 5000, "1e999")
OBJ = "v 0 0 0\nv 1 0 0.5\nv 0 1 0\nv 1 1 1e-3\nf 1 2 3\nf 2/1/1 3/1 4//1\nl 1 -1\n"
OBJ_WORDS = ("v", "f", "l", "/", "-1", "0", "nan", "1e999", "9" * 5000, "#", "usemtl", "p")


def _gltf(chance: random.Random) -> str | bytes:
    if chance.random() < 0.4:
        return next(corrupted(gltf_files.binary(ROOT), 1, chance.randrange(1 << 30)))
    return damaged(json.dumps(ROOT), chance, (*WORDS, *NUMBERS))


def _read_gltf(data: str | bytes, _: Path) -> None:
    mesh = gltf_file.read(data) if isinstance(data, str) else gltf_file.read_binary(data)
    assert obj_file.as_obj_text(mesh)


def _read_obj(text: str, _: Path) -> Iterator[str]:
    collector = Collector()
    document = Document("a.obj", text)
    obj_file.Reader(document, "MESH", collector).read_mesh(Place("b.yaml", 1, 1))
    for item in collector.finish():
        yield full(item, {"a.obj": document})


TARGETS = (
    Target("glTF", _gltf, _read_gltf, (MeshFileError,), 200, 30_000),
    Target("OBJ", lambda chance: damaged(OBJ, chance, OBJ_WORDS), _read_obj, (), 200, 30_000),
)
