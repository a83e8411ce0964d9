"""Changing which parameters follow patterns or swing, from a beat on."""

from __future__ import annotations

from collections.abc import Mapping

from ergon.notation.clock.meter import SAME
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.lists import dropped, place
from ergon.scores.edits.positions import END, end, written
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def automate(
    texts: Texts, piece: Piece, target: str, at: float, kind: str, fields: Mapping[str, str]
) -> Texts:
    """Let a parameter follow a pattern (`set`) or swing (`lfo`) from a beat on.

    It takes the place of what the parameter followed, and goes on for ever where the fields give it
    no end. Raises EditError.
    """
    said: dict[str, edit.Tree] = {kind: target, **fields, "at": written(piece, at)}
    if not said.keys() & {"times", "until"}:
        said["until"] = end(piece, at)
    # The new entry first: a list that never becomes empty keeps its style.
    texts = texts.append(("automation",), edit.flow(said))
    texts, _ = _ended(texts, piece, at, target)
    return texts


def stop(texts: Texts, piece: Piece, target: str, at: float) -> Texts:
    """Give a parameter its own value from a beat on. Raises EditError where nothing leads it."""
    texts, count = _ended(texts, piece, at, target)
    if not count:
        where = piece.tempo_map.written(at)
        raise EditError(f"{target} follows no pattern and does not swing at {where}")
    return texts


def released(texts: Texts, piece: Piece, target: str, at: float) -> Texts:
    """End what leads a parameter, if anything does."""
    return _ended(texts, piece, at, target)[0]


def finish(texts: Texts, piece: Piece, at: float) -> Texts:
    """End at a beat what goes on without end, for a score that is saved."""
    for number, one in enumerate(piece.automation):
        if one.until is not None and END.fullmatch(one.until.text) is not None:
            until = written(piece, max(at, piece.tempo_map.resolve(one.at) + 1.0))
            texts = texts.put((*place(texts, "automation", number), "until"), until)
    return texts


def _ended(texts: Texts, piece: Piece, at: float, target: str) -> tuple[Texts, int]:
    tempo, count = piece.tempo_map, 0
    for number in reversed(range(len(piece.automation))):
        one = piece.automation[number]
        if one.name != target:
            continue
        if tempo.resolve(one.at) >= at - SAME:
            texts, count = dropped(texts, "automation", number), count + 1
        elif one.until is None or tempo.resolve(one.until) > at + SAME:
            path = (*place(texts, "automation", number), "until")
            texts, count = texts.put(path, written(piece, at)), count + 1
    return texts, count
