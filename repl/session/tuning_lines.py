"""The output of `show tuning`: which frequencies notes have."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ergon.notation.tables import tuning
from ergon.notation.text.errors import TextError

if TYPE_CHECKING:
    from ergon.scores.reading.piece import Piece

_NOTES_SHOWN_MAX = 24  # notes of an instrument


def tuning_lines(piece: Piece) -> Iterator[str]:
    """The tuning of a piece, and the frequencies of the notes of its instruments."""
    yield f"tuning: {(piece.tuning or tuning.PLAIN).words()}"
    for instrument_name in piece.tunings:
        if instrument_name not in piece.families:
            yield f"tuning of {instrument_name}: {piece.tunings[instrument_name].words()}"
    for family_name, members in piece.families.items():
        used_tuning = piece.tuning_of(family_name) or tuning.PLAIN
        if family_name in piece.tunings:
            yield f"tuning of {family_name}: {used_tuning.words()}"
        note_words = [member.rpartition(".")[2] for member in members]
        note_texts = [
            f"{word} {_hertz_text(used_tuning, word)}" for word in note_words[:_NOTES_SHOWN_MAX]
        ]
        others_texts = (
            [f"and {len(note_words) - _NOTES_SHOWN_MAX} more"]
            if len(note_words) > _NOTES_SHOWN_MAX
            else []
        )
        yield f"{family_name}: {', '.join([*note_texts, *others_texts])}"


def _hertz_text(used_tuning: tuning.Tuning, note_word: str) -> str:
    try:
        return f"{used_tuning.hertz(note_word) or 0.0:.2f} Hz"
    except TextError:  # a key that the tuning leaves out
        return "without a pitch"
