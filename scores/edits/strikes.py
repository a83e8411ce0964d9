"""Changing what strikes modules from a beat on."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ergon.notation.clock.meter import SAME
from ergon.notation.text import edit
from ergon.scores.edits.positions import end as distant
from ergon.scores.edits.positions import written
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece, Strikes


def strike(texts: Texts, piece: Piece, name: str, at: float, fields: Mapping[str, str]) -> Texts:
    """Let strikes of a name fall from a beat on, in place of those of that name.

    `fields` are those of a score as texts; the modules in `to` stand apart by spaces. What repeats
    and has no end goes on for ever. Raises EditError.
    """
    own, to = named(piece, name), fields["to"].split()
    for one in own:
        texts = end(texts, piece, one, at)
    ahead = {one.name for one in own if piece.tempo_map.resolve(one.at) >= at - SAME}
    used = {one.name for one in piece.strikes} - ahead
    new, count = name, 2
    while new in used:
        new, count = f"{name}-{count}", count + 1
    said: dict[str, edit.Tree] = {"to": to[0] if len(to) == 1 else [*to], "at": written(piece, at)}
    said |= {field: text for field, text in fields.items() if field != "to"}
    if said.keys() & {"rate", "every", "euclid"} and not said.keys() & {"times", "for", "until"}:
        said["until"] = distant(piece, at)
    return texts.put(("strikes", new), edit.flow(said))


def named(piece: Piece, name: str) -> list[Strikes]:
    """The strikes of a name, and those that a session has numbered after it: `rain`, `rain-2`."""
    numbered = re.compile(rf"{re.escape(name)}(-[0-9]+)?")
    if not any(one.name == name for one in piece.strikes):
        return []
    return [one for one in piece.strikes if numbered.fullmatch(one.name)]


def end(texts: Texts, piece: Piece, strikes: Strikes, at: float) -> Texts:
    """End strikes at a beat; those that have not begun are taken away. Raises EditError."""
    tempo = piece.tempo_map
    begin = tempo.resolve(strikes.at)
    path = ("strikes", strikes.name)
    if begin >= at - SAME:
        return texts.remove(path)
    stop = begin if strikes.until is None else tempo.resolve(strikes.until)
    if strikes.span is not None:
        stop = tempo.after(begin, strikes.span)
        texts = texts.remove((*path, "for")) if stop > at else texts
    elif strikes.pattern is not None and strikes.until is None:
        places = strikes.steps(piece)
        stop = places.beat(len(places))
    elif strikes.times is not None and strikes.every is not None and strikes.until is None:
        stop = tempo.after(begin, strikes.every.times(strikes.times))
    return texts.put((*path, "until"), written(piece, at)) if stop > at + SAME else texts
