"""Couples two keys from a beat on, and ends couplings."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.lists import dropped, place
from ergon.scores.edits.positions import written
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def couple(
    texts: Texts, piece: Piece, at: float, a: str, b: str, stiffness: str, viscosity: str = ""
) -> Texts:
    """Join two keys by a REF from a beat on; this replaces their earlier coupling. Raises
    EditError.
    """
    said: dict[str, edit.Tree] = {"K": stiffness, **({"Z": viscosity} if viscosity else {})}
    whole: dict[str, edit.Tree] = {"couple": [a, b], "REF": said, "at": written(piece, at)}
    # Add the new entry before others are removed: a list that never becomes empty keeps its style.
    texts, _ = _parted(texts.append(("duet",), edit.flow(whole)), piece, at, a, b)
    return texts


def uncouple(texts: Texts, piece: Piece, at: float, a: str, b: str) -> Texts:
    """End the coupling of two keys at a beat. Raises EditError if there is none."""
    texts, count = _parted(texts, piece, at, a, b)
    if not count:
        raise EditError(f"{a} and {b} are not coupled at {piece.tempo_map.written(at)}")
    return texts


def _parted(texts: Texts, piece: Piece, at: float, a: str, b: str) -> tuple[Texts, int]:
    tempo, count = piece.tempo_map, 0
    for number in reversed(range(len(piece.duet))):
        coupling = piece.duet[number]
        if {coupling.a.part, coupling.b.part} != {a, b}:
            continue
        if tempo.resolve(coupling.at) >= at - SAME:
            texts, count = dropped(texts, "duet", number), count + 1
        elif coupling.until is None or tempo.resolve(coupling.until) > at + SAME:
            path = (*place(texts, "duet", number), "until")
            texts, count = texts.put(path, written(piece, at)), count + 1
    return texts, count
