"""Sets the tempo and the meter from a beat on, and marks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length, parse_length
from ergon.notation.text import edit
from ergon.notation.text.edit import EditError
from ergon.notation.text.errors import TextError
from ergon.scores.edits.lists import entry_path, section_entries, without_entry
from ergon.scores.edits.positions import position_text
from ergon.scores.edits.texts import Texts
from ergon.scores.reading.piece import Piece


def change_tempo(
    score_texts: Texts, piece: Piece, from_beat: float, bpm: str, ramp_length: str | None = None
) -> Texts:
    """Set the tempo from a beat on: `72`, or `60 -> 84` over a length.

    A ramp under way ends there; later tempos are removed, but their meters stay. Those of a file
    hold no longer (`FileTimes`), and one that would never hold is not named any more. Raises
    EditError.
    """
    ramp_length = None if ramp_length is None else _ramp_length(piece, from_beat, ramp_length)
    score_texts, next_index = _without_later_fields(score_texts, piece, from_beat, "bpm", "over")
    current_index: int | None = None  # the entry that sets the tempo at this beat
    for tempo_index, begin_beat in _entries_up_to(piece, from_beat):
        tempo_entry = piece.tempo[tempo_index]
        if begin_beat >= from_beat - SAME:
            current_index = tempo_index if tempo_entry.bpm is not None else current_index
        elif tempo_entry.bpm_end is not None:
            score_texts = _with_ramp_cut(score_texts, piece, tempo_index, begin_beat, from_beat)
    if current_index is not None:
        score_texts = score_texts.put(
            (*entry_path(score_texts, "tempo", current_index), "bpm"), bpm
        )
        if ramp_length is None:
            return _without_field(score_texts, current_index, "over")
        return score_texts.put(
            (*entry_path(score_texts, "tempo", current_index), "over"), ramp_length
        )
    ramp_fields = {} if ramp_length is None else {"over": ramp_length}
    tempo_line: dict[str, edit.Tree] = {
        "at": position_text(piece, from_beat),
        "bpm": bpm,
        **ramp_fields,
    }
    if from_beat <= SAME and piece.tempo and piece.tempo[0].tempos:
        return score_texts.put(entry_path(score_texts, "tempo", 0), edit.flow(tempo_line))
    return _with_inserted_entry(score_texts, next_index, tempo_line)


def change_meter(score_texts: Texts, piece: Piece, from_beat: float, meter: str) -> Texts:
    """Set the meter from a beat on, which begins a bar; later meters are removed, but their tempos
    stay. Those of a file hold no longer, and one that would never hold is not named any more.

    Raises EditError.
    """
    tempo = piece.tempo_map
    if abs(tempo.bar_beat(from_beat)[1] - 1.0) > SAME:
        raise EditError(
            f"a meter begins with a bar: write meter {meter} at {tempo.written(from_beat)}"
        )
    score_texts, next_index = _without_later_fields(score_texts, piece, from_beat, "meter")
    if from_beat <= SAME and piece.file_meters:
        score_texts = score_texts.remove(("meter",))
    for tempo_index, begin in _entries_up_to(piece, from_beat):
        if begin >= from_beat - SAME and not piece.tempo[tempo_index].tempos:
            return score_texts.put((*entry_path(score_texts, "tempo", tempo_index), "meter"), meter)
    return _with_inserted_entry(
        score_texts, next_index, {"at": position_text(piece, from_beat), "meter": meter}
    )


def _entries_up_to(piece: Piece, from_beat: float) -> Iterator[tuple[int, float]]:
    """The entries up to a beat, the last one first: their numbers, and the beats of their
    beginnings.
    """
    for tempo_index in reversed(range(len(piece.tempo))):
        begin = piece.tempo_map.resolve(piece.tempo[tempo_index].at)
        if begin <= from_beat + SAME:
            yield tempo_index, begin


def _without_later_fields(
    score_texts: Texts, piece: Piece, from_beat: float, *field_names: str
) -> tuple[Texts, int | None]:
    """Remove fields from the entries after a beat, and the entries that have nothing else; returns
    the number of the first later entry that stays too.
    """
    next_index: int | None = None
    for entry_index in reversed(range(len(piece.tempo))):
        tempo_entry = piece.tempo[entry_index]
        if piece.tempo_map.resolve(tempo_entry.at) <= from_beat + SAME:
            continue
        other_fields: dict[str, object] = {"bpm": tempo_entry.bpm, "meter": tempo_entry.meter}
        if other_fields.pop(field_names[0]) is not None and not any(other_fields.values()):
            score_texts = without_entry(score_texts, "tempo", entry_index)
            next_index = None if next_index is None else next_index - 1
            continue
        next_index = entry_index
        for name in field_names:
            score_texts = _without_field(score_texts, entry_index, name)
    return score_texts, next_index


def _with_inserted_entry(
    score_texts: Texts, next_index: int | None, entry_tree: Mapping[str, edit.Tree]
) -> Texts:
    """A new entry above the one of a number, or after all others."""
    entry_text = edit.flow(dict(entry_tree))
    if next_index is None:
        return score_texts.append(("tempo",), entry_text)
    path = entry_path(score_texts, "tempo", next_index)
    if path == ("tempo",):  # a lone entry becomes a list, then the new one goes above it
        score_texts = score_texts.put(
            path, f"[{edit.flow(edit.tree(section_entries(score_texts, 'tempo')[0]))}]"
        )
    return score_texts.edited(
        "tempo", lambda document: edit.insert(document, ("tempo", next_index), entry_text)
    )


def set_mark(texts: Texts, piece: Piece, name: str, beat: float) -> Texts:
    """Set a mark at a beat; it replaces a mark of the same name. Raises EditError."""
    return texts.put(("marks", name), position_text(piece, beat))


def _ramp_length(piece: Piece, from_beat: float, length_text: str) -> str:
    """The length of a ramp; in beats if it is in bars and the meter changes during the ramp."""
    try:
        ramp_length = parse_length(length_text)
    except TextError as error:
        raise EditError(error.message) from None
    end_beat = piece.tempo_map.after(from_beat, ramp_length)
    has_meter_change = any(
        from_beat + SAME < begin < end_beat - SAME for begin, *_ in piece.tempo_map.bars.changes()
    )
    return f"{end_beat - from_beat:.12g}" if ramp_length.bars and has_meter_change else length_text


def _without_field(score_texts: Texts, entry_index: int, field_name: str) -> Texts:
    entry = edit.tree(section_entries(score_texts, "tempo")[entry_index])
    if not isinstance(entry, dict) or field_name not in entry:
        return score_texts
    return score_texts.remove((*entry_path(score_texts, "tempo", entry_index), field_name))


def _with_ramp_cut(
    score_texts: Texts, piece: Piece, tempo_index: int, begin_beat: float, cut_beat: float
) -> Texts:
    """End a ramp that is under way at a beat, at the tempo reached there."""
    tempo_entry, path, tempo = (
        piece.tempo[tempo_index],
        entry_path(score_texts, "tempo", tempo_index),
        piece.tempo_map,
    )
    if tempo.after(begin_beat, tempo_entry.over or Length()) <= cut_beat + SAME:
        return score_texts
    score_texts = score_texts.put(
        (*path, "bpm"), f"{tempo_entry.bpm:.12g} -> {tempo.bpm(cut_beat):.12g}"
    )
    return score_texts.put((*path, "over"), f"{cut_beat - begin_beat:.12g}")
