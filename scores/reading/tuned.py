"""The `tuning:` of a score and those of its instruments: which frequency each note has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

from ergon.notation.tables.fields import Values
from ergon.notation.tables.scala import (
    KeyMap,
    ScalaError,
    Scale,
    decoded,
    parse_key_map,
    parse_scale,
)
from ergon.notation.tables.shapes import Context
from ergon.notation.tables.tuning import Tuning
from ergon.notation.tables.tuning_fields import TUNING
from ergon.notation.text import document
from ergon.notation.text.document import Document, Node, Scalar
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place

_Read = TypeVar("_Read")
_FILE_BYTES_MAX = 2**20  # bytes of a scale; the largest of the Scala archive has 30 kB


def tuning_of(score: Document, files: Files) -> Tuning | None:
    """The tuning that a file names, or None; reports what is wrong with its scale and its map.

    Mistakes in the fields themselves are reported where the whole score is read.
    """
    return _tuning_of_node(score.root, files, "tuning")


def tunings_of(score: Document, files: Files) -> Mapping[str, Tuning]:
    """The tunings of the instruments of a file that have their own, or are `like` such ones of
    this file; reports as `tuning_of`.
    """
    instruments_node = (
        score.root.get("instruments") if isinstance(score.root, document.Mapping) else None
    )
    if not isinstance(instruments_node, document.Mapping):
        return {}
    nodes_by_name = {name: node for name, (_, node) in instruments_node.entries.items()}
    tunings: dict[str, Tuning] = {}
    for instrument_name, node in nodes_by_name.items():
        tuning = _tuning_of_node(node, files, f"tuning of instrument {quote(instrument_name)}")
        if tuning is not None:
            tunings[instrument_name] = tuning
    for instrument_name in nodes_by_name if tunings else ():
        base_names = [instrument_name]
        while (
            base_names[-1] not in tunings
            and (base_name := _base_name(nodes_by_name, base_names[-1])) not in base_names
        ):
            base_names.append(base_name)
        if base_names[-1] in tunings:
            tunings |= dict.fromkeys(base_names, tunings[base_names[-1]])
    return tunings


def _base_name(nodes: Mapping[str, Node], instrument_name: str) -> str:
    """The name that `like` gives an instrument of this file; without `like`, the name itself."""
    node = nodes.get(instrument_name)
    base_node = node.get("like") if isinstance(node, document.Mapping) else None
    inherits_tuning = isinstance(node, document.Mapping) and "tuning" not in node.entries
    return (
        base_node.text.strip()
        if inherits_tuning and isinstance(base_node, Scalar)
        else instrument_name
    )


def _tuning_of_node(tuning_node: Node | None, score_files: Files, field_name: str) -> Tuning | None:
    """The tuning that a score or an instrument names; `field_name` begins messages."""
    if not isinstance(tuning_node, document.Mapping) or "tuning" not in tuning_node.entries:
        return None
    values = TUNING.read(tuning_node.entries["tuning"][1], "", Context(Collector(), field_name))
    if not isinstance(values, Values):
        return None
    tuning_values = replace(values, context=Context(score_files.collector, field_name))
    for name, contrary_name in (("edo", "scale"), ("A4", "keys")):
        if tuning_values.written(name) and tuning_values.written(contrary_name):
            message = (
                f"{field_name}: `{contrary_name}` says the pitches already; keep `{name}` "
                f"or `{contrary_name}`"
            )
            tuning_values.error("E111", message, name)
            return None
    if tuning_values.written("keys") and not tuning_values.written("scale"):
        tuning_values.error(
            "E111", f"{field_name}: `keys` is the map of a scale; write `scale` beside it", "keys"
        )
        return None
    tuning = Tuning(
        440.0 if tuning_values["A4"] is None else tuning_values["A4"],
        tuning_values["edo"] or 12,
        root=tuning_values["root"] or "C4",
    )
    if tuning_values["scale"] is not None:
        scale = _parsed_scala_file(tuning_values, "scale", parse_scale, score_files)
        key_map: KeyMap | None = KeyMap(frequency=tuning.a4)
        if tuning_values["keys"] is not None:
            key_map = _parsed_scala_file(tuning_values, "keys", parse_key_map, score_files)
        if scale is None or key_map is None:
            return None
        assert isinstance(scale, Scale)
        tuning = replace(tuning, scale=scale, keys=key_map)
    try:
        tuning.hertz(tuning.root)
    except TextError as error:
        tuning_values.error("E202", f"{field_name}: {error.message}; write another `root`", "scale")
        return None
    return tuning


def _parsed_scala_file(
    tuning_values: Values, field_name: str, parse: Callable[[str], _Read], score_files: Files
) -> _Read | None:
    """What a file of Scala says; None if an error was reported."""
    folder = tuning_values.nodes[field_name].document.folder
    scala_document = score_files.plain(
        tuning_values[field_name], folder, tuning_values.place_of(field_name), _decoded
    )
    if scala_document is None:
        return None
    try:
        return parse(scala_document.text)
    except ScalaError as error:
        place = Place(scala_document.file, error.line, 1, error.length)
        score_files.collector.error(error.code, error.message, place)
        return None


def _decoded(file_bytes: bytes, file_name: str, collector: Collector) -> str | None:
    """The text of a file of Scala; None for one that is too large, which is reported."""
    if len(file_bytes) > _FILE_BYTES_MAX:
        message = f"the file has more than {_FILE_BYTES_MAX // 2**20} MB; a scale has a few lines"
        collector.error("E105", message, Place(file_name, 1, 1))
        return None
    return decoded(file_bytes)
