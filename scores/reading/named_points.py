"""Points of a piece by name, for code that observes it from outside."""

from __future__ import annotations

from ergon.instruments.model import Target
from ergon.instruments.names import PartContents, PartNames
from ergon.notation.tables.shapes import Name
from ergon.notation.text.errors import Collector, TextError
from ergon.notation.text.spelling import nearest
from ergon.scores.reading.piece import Piece


def named_point(piece: Piece, point_text: str) -> Target:
    """The masses that a name reaches: a key, `bell.m`, `string.s.12`. Raises TextError."""
    collector = Collector()
    parts_by_name = {
        name: PartContents(
            name, {module.name: module for module in key.modules}, struck_mat=key.struck
        )
        for name, key in piece.keys.items()
    }
    for name, instrument in piece.instruments.items():
        modules_by_name = {module.name: module for module in instrument.modules}
        parts_by_name[name] = PartContents(name, modules_by_name, axes=instrument.axes)
    target = PartNames(collector, parts_by_name).target(Name(point_text, piece.place), "mats", "")
    if target is None:
        mistake = collector.finish()[0]
        suggestion = mistake.suggestion
        if suggestion is None and mistake.code == "E301":
            suggestion = nearest(point_text.partition(".")[0], parts_by_name)
        raise TextError(mistake.message, suggestion=suggestion)
    return target
