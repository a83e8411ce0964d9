"""Couples two keys from a beat on, and ends couplings."""

from __future__ import annotations

from ergon.notation.clock.meter import SAME
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.scores.edits.lists import entry_path, without_entry
from ergon.scores.edits.positions import position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def couple(
    score_texts: Texts,
    piece: Piece,
    from_beat: float,
    first_key: str,
    second_key: str,
    stiffness: str,
    viscosity: str = "",
) -> Texts:
    """Join two keys by a REF from a beat on; this replaces their earlier coupling. Raises
    EditError.
    """
    ref_fields: dict[str, edit.Tree] = {"K": stiffness, **({"Z": viscosity} if viscosity else {})}
    coupling_entry: dict[str, edit.Tree] = {
        "couple": [first_key, second_key],
        "REF": ref_fields,
        "at": position_text(piece, from_beat),
    }
    # Add the new entry before others are removed: a list that never becomes empty keeps its style.
    score_texts, _ = _with_coupling_ended(
        score_texts.append(("duet",), edit.flow(coupling_entry)),
        piece,
        from_beat,
        first_key,
        second_key,
    )
    return score_texts


def uncouple(
    score_texts: Texts, piece: Piece, from_beat: float, first_key: str, second_key: str
) -> Texts:
    """End the coupling of two keys at a beat. Raises EditError if there is none."""
    score_texts, ended_count = _with_coupling_ended(
        score_texts, piece, from_beat, first_key, second_key
    )
    if not ended_count:
        raise EditError(
            f"{first_key} and {second_key} are not coupled at {piece.tempo_map.written(from_beat)}"
        )
    return score_texts


def _with_coupling_ended(
    score_texts: Texts, piece: Piece, from_beat: float, first_key: str, second_key: str
) -> tuple[Texts, int]:
    tempo, ended_count = piece.tempo_map, 0
    for entry_index in reversed(range(len(piece.duet))):
        coupling = piece.duet[entry_index]
        if {coupling.a.part, coupling.b.part} != {first_key, second_key}:
            continue
        if tempo.resolve(coupling.at) >= from_beat - SAME:
            score_texts, ended_count = (
                without_entry(score_texts, "duet", entry_index),
                ended_count + 1,
            )
        elif coupling.until is None or tempo.resolve(coupling.until) > from_beat + SAME:
            path = (*entry_path(score_texts, "duet", entry_index), "until")
            score_texts, ended_count = (
                score_texts.put(path, position_text(piece, from_beat)),
                ended_count + 1,
            )
    return score_texts, ended_count
