"""The strikes of a phrase: those of phrases that it names among its entries, too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ergon.notation.clock.positions import Length
from ergon.notation.tables.fields import Values
from ergon.notation.tables.shapes import Name
from ergon.notation.tables.strengths import MEZZO_FORTE, Level, Levels
from ergon.notation.text.errors import TextError
from ergon.scores.reading.melody import MAX_ROWS, Row
from ergon.scores.reading.note_targets import NoteTargets
from ergon.scores.reading.phrase_changes import length_of, transformed_rows

_PHRASE_DEPTH_MAX = 20  # phrases inside one another


def phrase_rows(
    phrase: Values,
    phrases: Mapping[str, Any],
    note_targets: NoteTargets,
    outer_levels: Levels | None = None,
    phrases_above: tuple[str, ...] = (),
) -> tuple[tuple[Row, ...], Length] | None:
    """The strikes of a phrase after its own transformations, and its length; None if an error was
    reported.

    `outer_levels` are those of entries that say none; `phrases_above` the names of phrases
    that it is in.
    """
    written_entries: Sequence[Row] | None = phrase["entries"]
    if written_entries is None:  # a mistake in them was reported
        return None
    rows: list[Row] = []
    inner_end_beat: float | None = 0.0
    for written_row, phrase_row in zip(
        written_entries,
        with_levels(written_entries, outer_levels or phrase["impulse"]),
        strict=True,
    ):
        phrase_name = phrase_row.struck_names[0]
        phrase_values = phrases.get(phrase_name) if len(phrase_row.struck_names) == 1 else None
        if not isinstance(phrase_values, Values) or phrase_values.record is not phrase.record:
            rows.append(phrase_row)
            continue
        phrase_path = (*phrases_above, phrase.context.name, str(phrase_name))
        if phrase_name in phrase_path[:-1]:
            name_circle = ", which plays ".join(phrase_path)
            message = (
                f"{phrase.context.label('')}: {name_circle}: a circle without an end; remove "
                "one of "
            )
            phrase.context.error("E302", f"{message}these entries", phrase_row.place)
            return None
        if len(phrase_path) > _PHRASE_DEPTH_MAX:
            message = (
                f"{phrase.context.label('')}: phrases are nested more than {_PHRASE_DEPTH_MAX} deep"
            )
            phrase.context.error("E105", message, phrase_row.place)
            return None
        entry_levels = None if written_row.level is None else Levels((written_row.level,))
        named_phrase = phrase_rows(
            phrase_values, phrases, note_targets, entry_levels, phrase_path[:-1]
        )
        if named_phrase is None:
            return None
        inner_rows, named_length = named_phrase
        assert isinstance(phrase_row.at, Length)
        rows += (
            _row_within_phrase(inner_row, phrase_row.at, phrase_values, note_targets)
            for inner_row in inner_rows
        )
        inner_end_beat = _later_end(inner_end_beat, phrase_row.at, named_length)
        if len(rows) > MAX_ROWS:
            message = f"{phrase.context.label('')} has more than {MAX_ROWS:,} strikes"
            phrase.context.error("E105", message, phrase_row.place)
            return None
    phrase_length = length_of(rows, phrase["length"])
    if phrase_length is not None and phrase["length"] is None:
        if inner_end_beat is None:
            phrase_length = None
        elif inner_end_beat > phrase_length.beats:
            phrase_length = Length(beats=inner_end_beat)
    if phrase_length is None:
        message = f"{phrase.context.label('')} has no 'length': not all its entries are in beats"
        phrase.error("E103", message, "entries")
        return None
    try:
        return transformed_rows(rows, phrase_length, phrase["do"] or (), note_targets.mirrored)
    except TextError as error:
        phrase.error("E306", f"{phrase.context.label('do')}: {error.message}", "do")
        return None


def _later_end(end_beat: float | None, begin_length: Length, length: Length) -> float | None:
    """The later end of two, in beats; None if one is not in beats."""
    lengths = (begin_length, length)
    if end_beat is None or any(row_length.bars or row_length.seconds for row_length in lengths):
        return None
    return max(end_beat, begin_length.beats + length.beats)


def _row_within_phrase(
    phrase_row: Row, begin_length: Length, phrase: Values, note_targets: NoteTargets
) -> Row:
    """A strike of a phrase that begins somewhere in another; its notes are those of its own `to`,
    where that is not the other's.
    """
    assert isinstance(phrase_row.at, Length)
    bars, beats = begin_length.bars + phrase_row.at.bars, begin_length.beats + phrase_row.at.beats
    moved_row = replace(
        phrase_row, at=Length(bars, beats, begin_length.seconds + phrase_row.at.seconds)
    )
    instrument_names = phrase["to"] or ()
    if not instrument_names or tuple(instrument_names) == tuple(note_targets.instruments):
        return moved_row
    renamed_notes = tuple(
        Name(f"{part}.{word}", word.place)
        for part in instrument_names
        for word in phrase_row.struck_names
    )
    return replace(moved_row, struck_names=renamed_notes, written_names=())


def with_levels(rows: Sequence[Row], strike_levels: Levels | None) -> tuple[Row, ...]:
    """Rows, each with a level: its own, or that of the row before; `strike_levels` are those of
    rows that say none.
    """
    leveled_rows, last_level = [], None
    for row_index, phrase_row in enumerate(rows):
        last_level = (
            phrase_row.level
            or last_level
            or (strike_levels or Levels((MEZZO_FORTE,))).step(row_index, len(rows))
        )
        is_pattern = strike_levels is not None and len(strike_levels.steps) > 1
        leveled_rows.append(
            replace(phrase_row, level=last_level) if phrase_row.level != last_level else phrase_row
        )
        if is_pattern and phrase_row.level is None:
            last_level = None  # the next row has the next level of the pattern
    return tuple(_with_swells(rows, leveled_rows))


def _with_swells(written_rows: Sequence[Row], rows: Sequence[Row]) -> Iterator[Row]:
    """Rows whose levels go evenly, strike by strike, from each that swells to the next level that
    is written.
    """
    swell_begin, swell_end = 0, 0
    for row_index, phrase_row in enumerate(rows):
        if written_rows[row_index].is_swelling:
            swell_begin = row_index
            later_levels = (
                later_index
                for later_index in range(row_index + 1, len(rows))
                if written_rows[later_index].level is not None
            )
            swell_end = next(later_levels, row_index)
        low_level, high_level = rows[swell_begin].level, rows[swell_end].level
        if swell_begin < row_index < swell_end and low_level is not None and high_level is not None:
            swell_share = (row_index - swell_begin) / (swell_end - swell_begin)
            amount = low_level.low + (high_level.low - low_level.low) * swell_share
            yield replace(phrase_row, level=Level(amount, amount, low_level.is_strength))
        else:
            yield phrase_row
