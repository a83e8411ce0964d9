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
    texts: Texts, piece: Piece, beat: float, a: str, b: str, stiffness: str, viscosity: str = ""
) -> Texts:
    """Join two keys by a REF from a beat on; this replaces their earlier coupling. Raises
    EditError.
    """
    ref_fields: dict[str, edit.Tree] = {"K": stiffness, **({"Z": viscosity} if viscosity else {})}
    coupling_entry: dict[str, edit.Tree] = {
        "couple": [a, b],
        "REF": ref_fields,
        "at": written(piece, beat),
    }
    # Add the new entry before others are removed: a list that never becomes empty keeps its style.
    texts, _ = _parted(texts.append(("duet",), edit.flow(coupling_entry)), piece, beat, a, b)
    return texts


def uncouple(texts: Texts, piece: Piece, beat: float, a: str, b: str) -> Texts:
    """End the coupling of two keys at a beat. Raises EditError if there is none."""
    texts, count = _parted(texts, piece, beat, a, b)
    if not count:
        raise EditError(f"{a} and {b} are not coupled at {piece.tempo_map.written(beat)}")
    return texts


def _parted(texts: Texts, piece: Piece, beat: float, a: str, b: str) -> tuple[Texts, int]:
    tempo, count = piece.tempo_map, 0
    for number in reversed(range(len(piece.duet))):
        coupling = piece.duet[number]
        if {coupling.a.part, coupling.b.part} != {a, b}:
            continue
        if tempo.resolve(coupling.at) >= beat - SAME:
            texts, count = dropped(texts, "duet", number), count + 1
        elif coupling.until is None or tempo.resolve(coupling.until) > beat + SAME:
            path = (*place(texts, "duet", number), "until")
            texts, count = texts.put(path, written(piece, beat)), count + 1
    return texts, count
