"""`ergon info` of files that a score names or a command converts: what is read, what is not."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from ergon.common.regular import read_bounded
from ergon.common.structured import parse_json
from ergon.common.terminal import printable

from .console import Console, plural
from .outcome import Refused

_BYTES_MAX = 64 << 20
# A table with `speakers`, or a list: no score is one.
_LAYOUT = re.compile(
    rb"""^["']?speakers["']?[ \t]*:"""
    rb"""|\A(?:[ \t]*(?:[#%].*|---.*)?\r?\n)*[ \t]*(?:-\s|\[|\{\s*["']?speakers)""",
    re.MULTILINE,
)
_MUSICXML = re.compile(rb"<(?:\w+:)?score-(?:partwise|timewise)\b")
_SPATGRIS = re.compile(rb"<(?:SPEAKER_SETUP|SpeakerSetup)\b")
_ERGON_LINE = re.compile(rb"^ergon[ \t]*:", re.MULTILINE)


class Content(NamedTuple):
    """The content of a file: its form, the figures that were read from it, and the parts that
    were passed over.
    """

    form: str
    read: Mapping[str, object]
    passed_over: list[str]


def print_content(console: Console, path: Path) -> bool:
    """Print the content of a file that has one of these forms; return False for other files."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        return False
    file_content = reader(path)
    if file_content is None:
        return False
    if console.json:
        fields = {
            "form": file_content.form,
            **file_content.read,
            "passed_over": file_content.passed_over,
        }
        console.record("file", file=str(path), **fields)
        return True
    text_lines = [f"{path}: {file_content.form}"]
    text_lines += [f"  {name}: {value}" for name, value in file_content.read.items()]
    text_lines += [f"  passed over: {item}" for item in file_content.passed_over or ["nothing"]]
    console.data("\n".join(map(printable, text_lines)) + "\n")
    return True


def is_score(path: Path) -> bool:
    """Whether a file has the name or the first line of a score."""
    is_named_so = path.suffix.lower() in (".yaml", ".yml")
    return is_named_so or _ERGON_LINE.search(_read_bytes(path)) is not None


def unknown_form_message(path: Path) -> str:
    """The error message for a file of an unknown form, with a list of the known forms."""
    from ergon.scores.gesture.midi_file import SUFFIXES as MIDI
    from ergon.scores.gesture.take_file import SUFFIXES as TAKES

    forms = {
        "scores": (".yaml",),
        "packs": (".ergonpack",),
        "sound": (".wav", ".flac", ".aiff"),
        "takes": [suffix for suffix in TAKES if suffix != ".wav"],
        "notes": (*MIDI, ".musicxml", ".mxl"),
        "motion": (".motion",),
        "meshes": (".obj", ".gltf", ".glb"),
        "scales": (".scl", ".kbm"),
        "heads": (".sofa",),
        "loudspeakers": (".yaml", ".xml", ".json"),
        "models": (".mdl", ".dsp", ".pd", ".txt", ".xml"),
        "gestures": (".gms",),
    }
    listed = "; ".join(f"{noun} ({', '.join(endings)})" for noun, endings in forms.items())
    if not path.stat().st_size:
        return f"{path} is empty"
    return f"{path} is nothing that ergon reads; `ergon info` reads {listed}"


def _read_bytes(path: Path) -> bytes:
    file_bytes = read_bounded(path, _BYTES_MAX)
    if len(file_bytes) > _BYTES_MAX:
        raise Refused(f"{path} is larger than {_BYTES_MAX >> 20} MB")
    return file_bytes


# --- meshes -------------------------------------------------------------------------------------


def _obj(path: Path) -> Content:
    from ergon.instruments.space.obj_file import Reader, decoded, logical_lines
    from ergon.notation.text.document import Document
    from ergon.notation.text.errors import Collector
    from ergon.notation.text.values import Place

    collector = Collector()
    obj_text = decoded(_read_bytes(path), str(path), collector)
    mesh = None
    if obj_text is not None:
        reader = Reader(Document(str(path), obj_text, None), "the mesh", collector)
        mesh = reader.read_mesh(Place(str(path), 1, 1))
    if mesh is None:
        raise Refused("; ".join(f"{path}: {mistake.message}" for mistake in collector.finish()))
    lines = [words for _, line in logical_lines(obj_text or "") if (words := line.split())]
    kinds = Counter(words[0] for words in lines)
    other_kinds = [kind for kind in kinds if kind not in ("v", "f", "l")]
    passed_over = [f"{plural(kinds[kind], 'line')} of {kind}" for kind in sorted(other_kinds)]
    if n_coloured_points := sum(words[0] == "v" and len(words) > 4 for words in lines):
        passed_over.append(f"colours or weights in {plural(n_coloured_points, 'line')} of v")
    return Content("mesh (Wavefront OBJ)", _mesh_figures(mesh), passed_over)


def _mesh_figures(mesh: object) -> dict[str, object]:
    mesh_points, mesh_edges, faces = (getattr(mesh, name) for name in ("points", "edges", "faces"))
    axes = zip(*mesh_points, strict=True)
    size_text = " × ".join(f"{max(axis) - min(axis):.4g}" for axis in axes)
    bodies = _n_bodies(len(mesh_points), mesh_edges)
    return {
        "points": len(mesh_points),
        "edges": len(mesh_edges),
        "triangles": len(faces),
        "bodies": bodies,
        "size in units of the file": size_text,
    }


def _n_bodies(n: int, edges: object) -> int:
    """The number of connected components."""
    parents = list(range(n))

    def root(point_index: int) -> int:
        while parents[point_index] != point_index:
            parents[point_index] = parents[parents[point_index]]
            point_index = parents[point_index]
        return point_index

    for a, b in edges:  # type: ignore[attr-defined]
        parents[root(a)] = root(b)
    return len({root(point) for point in range(n)})


def _gltf(path: Path) -> Content:
    from ergon.instruments.space import gltf_file
    from ergon.instruments.space.mesh import MeshFileError

    file_bytes, is_binary = _read_bytes(path), path.suffix.lower() == ".glb"
    try:
        mesh = gltf_file.read_binary(file_bytes) if is_binary else gltf_file.read(file_bytes)
    except (MeshFileError, UnicodeDecodeError) as error:
        raise Refused(f"{path}: {error}") from None
    size = int.from_bytes(file_bytes[12:16], "little")
    root = parse_json(file_bytes[20 : 20 + size] if is_binary else file_bytes)
    return Content("mesh (glTF 2)", _mesh_figures(mesh), gltf_file.ignored_contents(root))


# --- tunings ------------------------------------------------------------------------------------


def _scala(path: Path) -> Content:
    from ergon.notation.tables.scala import ScalaError, decoded, parse_key_map, parse_scale

    scala_text = decoded(_read_bytes(path))
    n_comments = sum(line.startswith("!") for line in scala_text.splitlines())
    passed_over = [plural(n_comments, "comment")] if n_comments else []
    try:
        if path.suffix.lower() == ".scl":
            scale = parse_scale(scala_text)
            figures_read = {
                "title": scale.title or "none",
                "degrees": len(scale.ratios),
                "repeats after": f"{scale.ratios[-1]:.9g}",
            }
            return Content("scale (Scala)", figures_read, passed_over)
        mapped_keys = parse_key_map(scala_text)
    except ScalaError as error:
        raise Refused(f"{path}:{error.line}: {error.message}") from None
    figures_read = {
        "keys": f"{mapped_keys.low} to {mapped_keys.high}",
        "size of the map": len(mapped_keys.degrees),
        "middle key": mapped_keys.middle,
        "reference": f"key {mapped_keys.reference} at {mapped_keys.frequency:g} Hz",
    }
    return Content("keyboard map (Scala)", figures_read, passed_over)


# --- heads and rooms ----------------------------------------------------------------------------


def _sofa(path: Path) -> Content:
    from ergon.exchange import sofa

    try:
        head_responses = sofa.read(path)
    except sofa.SofaError as error:
        raise Refused(str(error)) from None
    n, _, taps = head_responses.responses.shape
    delay_spread_ms = float(head_responses.delays.max() - head_responses.delays.min()) * 1e3
    figures_read = {
        "directions": n,
        "samples of each response": taps,
        "rate": f"{head_responses.rate:g} Hz",
        "delays": f"up to {delay_spread_ms:.3g} ms apart",
    }
    return Content("head (SOFA)", figures_read, list(head_responses.passed_over))


def _xml(path: Path) -> Content | None:
    """A score of MusicXML, loudspeakers, or a model of another program."""
    from ergon.common.xml_text import XmlError, narrow

    try:
        xml_bytes = narrow(_read_bytes(path))
    except XmlError as error:
        raise Refused(f"{path}: {error}") from None
    if _MUSICXML.search(xml_bytes):
        return _musicxml(path)
    return _layout(path) if _SPATGRIS.search(xml_bytes) else _model(path)


def _musicxml(path: Path) -> Content:
    from .musicxml_info import musicxml

    return Content("score (MusicXML)", *musicxml(path))


def _layout(path: Path) -> Content | None:
    from ergon.exchange.layout_files import FORMS, LayoutFileError

    file_bytes = _read_bytes(path)
    if path.suffix.lower() == ".json" and b"LoudspeakerLayout" not in file_bytes:
        return None
    form_by_ending = {form.ending: form for form in FORMS.values()}
    layout_form = form_by_ending[path.suffix.lower().replace(".yml", ".yaml")]
    try:
        layout = layout_form.read(file_bytes)
    except LayoutFileError as error:
        raise Refused(f"{path}: {error}") from None
    passed_over = [*layout.left_out, "names"]
    read = {"loudspeakers": len(layout.speakers), "outputs": _numbers(layout.outputs)}
    return Content(f"loudspeakers ({layout_form.name})", read, passed_over)


def _yaml(path: Path) -> Content | None:
    """Loudspeakers, of ergon or of the EBU ADM renderer; None for a score."""
    from ergon.common.yaml_text import decode_yaml

    file_bytes = decode_yaml(_read_bytes(path), "replace").encode()
    if not _LAYOUT.search(file_bytes):
        return None
    if not _ERGON_LINE.search(file_bytes):
        return _layout(path)
    from ergon.api.errors import ScoreError
    from ergon.api.layouts import read_layout

    try:
        layout = read_layout(path)
    except ScoreError as error:
        mistakes = (f"{each.place}: {each.message}" for each in error.diagnostics)
        raise Refused("; ".join(mistakes)) from None
    figures_read = {
        "title": layout.title or "none",
        "loudspeakers": len(layout.speakers),
        "outputs": _numbers([channel + 1 for channel in layout.channels]),
    }
    return Content("loudspeakers (a layout of ergon)", figures_read, [])


def _numbers(outputs: list[int]) -> str:
    if outputs == [*range(1, len(outputs) + 1)]:
        return f"1 to {len(outputs)}"
    return ", ".join(map(str, outputs))


# --- models -------------------------------------------------------------------------------------


def _model(path: Path) -> Content | None:
    from ergon.common.xml_text import narrow
    from ergon.workshop.api.model import import_model, is_model

    is_named_so = path.suffix.lower() in (".mdl", ".dsp", ".pd")
    if not is_named_so and not is_model(narrow(_read_bytes(path)).decode("utf-8", "replace")):
        return None
    model = import_model(path)
    figures_read = {"statements": model.n_statements, "to use it": f"ergon import {path}"}
    passed_over = [f"input {name}, which has no file" for name in model.unfed]
    return Content(
        f"model ({model.dialect})", figures_read, [*passed_over, "comments and what is only shown"]
    )


def _gms(path: Path) -> Content:
    """The chunks of a GMS file, which is an IFF file; what their bytes mean is not public."""
    from ergon.exchange.iff import NotIffError, chunks

    try:
        iff_chunks = chunks(_read_bytes(path))
    except NotIffError as error:
        raise Refused(f"{path}: {error}") from None
    figures_read = {
        f"{chunk.depth}.{number} {chunk.name} {chunk.group_type}".rstrip(): plural(
            chunk.size, "byte"
        )
        for number, chunk in enumerate(iff_chunks, 1)
    }
    unknown_reason = (
        "what the bytes in these chunks mean: ACROE's public description has no table of them"
    )
    return Content("gestures and motion (GMS, an IFF file)", figures_read, [unknown_reason])


READERS: Mapping[str, Callable[[Path], Content | None]] = {
    ".gms": _gms,
    ".obj": _obj,
    ".gltf": _gltf,
    ".glb": _gltf,
    ".scl": _scala,
    ".kbm": _scala,
    ".sofa": _sofa,
    ".musicxml": _musicxml,
    ".mxl": _musicxml,
    ".xml": _xml,
    ".json": _layout,
    ".yaml": _yaml,
    ".yml": _yaml,
    ".mdl": _model,
    ".dsp": _model,
    ".pd": _model,
    ".txt": _model,
}
