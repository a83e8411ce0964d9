"""The `tuning:` of a score: which frequency each of its notes has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
from ergon.notation.tables import value_kinds as k
from ergon.notation.tables.fields import Field, Record, Values
from ergon.notation.tables.scala import KeyMap, ScalaError, Scale, parse_key_map, parse_scale
from ergon.notation.tables.shapes import Context, Text
from ergon.notation.tables.tuning import MAX_EDO, Tuning
from ergon.notation.text import document
from ergon.notation.text.document import Document
from ergon.notation.text.errors import Collector, TextError, quote
from ergon.notation.text.files import Files
from ergon.notation.text.values import Place

_Read = TypeVar("_Read")
_MAX_FILE = 2**20  # bytes of a scale; the largest of the Scala archive has 30 kB


def _root(text: str) -> str:
    word = text.strip()
    if tuning.is_pitch(word) and not any(sign in word for sign in ("to", "of")):
        return word
    if tuning.spelled(word).endswith("Hz"):
        return tuning.hertz_word(q.quantity(word, q.FREQUENCY))
    message = f"{quote(word)} is neither a note such as C4 nor a frequency such as 264Hz"
    raise TextError(message, length=max(1, len(word)), code="E201")


TUNING = Record(
    "tuning",
    "which frequencies the notes of this file have",
    (
        Field("A4", k.HERTZ, "of equal steps, and of a scale without `keys`", shown="440Hz"),
        Field("edo", k.integer(1, MAX_EDO, "31"), "equal steps to an octave", shown="12"),
        Field("scale", k.PATH, "a scale of the program Scala, a .scl file"),
        Field("keys", k.PATH, "a keyboard map of Scala, a .kbm file; needs `scale`"),
        Field(
            "root",
            Text(_root, "a note or a frequency, such as C4 or 264Hz", is_value=True),
            "what ratios (3/2) and steps (18\\31) count from",
            shown="C4",
        ),
    ),
    lone={
        "edo": r"(\d{1,4})(?: *(?:edo|EDO|tet|TET))?",
        "A4": r"(\d+(?:\.\d+)? *Hz)",
        "scale": r"(.+\.scl)",
    },
    meant={
        "a4": "A4",
        "reference": "A4",
        "scl": "scale",
        "kbm": "keys",
        "map": "keys",
        "equal": "edo",
        "divisions": "edo",
    },
)


def tuning_of(score: Document, files: Files) -> Tuning | None:
    """The tuning that a file names, or None; reports what is wrong with its scale and its map.

    Mistakes in the fields themselves are reported where the whole score is read.
    """
    root = score.root
    if not isinstance(root, document.Mapping) or "tuning" not in root.entries:
        return None
    values = TUNING.read(root.entries["tuning"][1], "", Context(Collector(), "tuning"))
    if not isinstance(values, Values):
        return None
    v = replace(values, context=Context(files.collector, "tuning"))
    for name, other in (("edo", "scale"), ("A4", "keys")):
        if v.written(name) and v.written(other):
            message = f"tuning: `{other}` says the pitches already; keep `{name}` or `{other}`"
            v.error("E111", message, name)
            return None
    if v.written("keys") and not v.written("scale"):
        v.error("E111", "tuning: `keys` is the map of a scale; write `scale` beside it", "keys")
        return None
    tuned = Tuning(
        440.0 if v["A4"] is None else v["A4"],
        v["edo"] or 12,
        root=v["root"] or "C4",
    )
    if v["scale"] is not None:
        scale = _file(v, "scale", parse_scale, files)
        keys: KeyMap | None = KeyMap(frequency=tuned.a4)
        if v["keys"] is not None:
            keys = _file(v, "keys", parse_key_map, files)
        if scale is None or keys is None:
            return None
        assert isinstance(scale, Scale)
        tuned = replace(tuned, scale=scale, keys=keys)
    try:
        tuned.hertz(tuned.root)
    except TextError as error:
        v.error("E202", f"tuning: {error.message}; write another `root`", "scale")
        return None
    return tuned


def _file(values: Values, name: str, parse: Callable[[str], _Read], files: Files) -> _Read | None:
    """What a file of Scala says; None if an error was reported."""
    folder = values.nodes[name].document.folder
    text = files.plain(values[name], folder, values.place_of(name), _decoded)
    if text is None:
        return None
    try:
        return parse(text.text)
    except ScalaError as error:
        place = Place(text.file, error.line, 1, error.length)
        files.collector.error(error.code, error.message, place)
        return None


def _decoded(data: bytes, file: str, collector: Collector) -> str | None:
    """The text of a file of Scala: UTF-8, or Latin-1 as in its archive."""
    if len(data) > _MAX_FILE:
        message = f"the file has more than {_MAX_FILE // 2**20} MB; a scale has a few lines"
        collector.error("E105", message, Place(file, 1, 1))
        return None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")
