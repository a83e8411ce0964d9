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
from ergon.scores.reading.phrase_changes import length_of, transformed

_DEEPEST = 20  # phrases inside one another


def phrase_rows(
    phrase: Values,
    phrases: Mapping[str, Any],
    voices: NoteTargets,
    levels: Levels | None = None,
    phrases_above: tuple[str, ...] = (),
) -> tuple[tuple[Row, ...], Length] | None:
    """The strikes of a phrase after its own transformations, and its length; None if an error was
    reported.

    `levels` are those of entries that say none; `phrases_above` the names of phrases that it is in.
    """
    entries: Sequence[Row] | None = phrase["entries"]
    if entries is None:  # a mistake in them was reported
        return None
    rows: list[Row] = []
    inner_end: float | None = 0.0
    for row_written, row in zip(
        entries, with_levels(entries, levels or phrase["impulse"]), strict=True
    ):
        name = row.what[0]
        phrase_values = phrases.get(name) if len(row.what) == 1 else None
        if not isinstance(phrase_values, Values) or phrase_values.record is not phrase.record:
            rows.append(row)
            continue
        path = (*phrases_above, phrase.context.name, str(name))
        if name in path[:-1]:
            circle = ", which plays ".join(path)
            message = (
                f"{phrase.context.label('')}: {circle}: a circle without an end; remove one of "
            )
            phrase.context.error("E302", f"{message}these entries", row.place)
            return None
        if len(path) > _DEEPEST:
            message = f"{phrase.context.label('')}: phrases are nested more than {_DEEPEST} deep"
            phrase.context.error("E105", message, row.place)
            return None
        entry_levels = None if row_written.level is None else Levels((row_written.level,))
        named_rows = phrase_rows(phrase_values, phrases, voices, entry_levels, path[:-1])
        if named_rows is None:
            return None
        inner_rows, length = named_rows
        assert isinstance(row.at, Length)
        rows += (_moved(inner_row, row.at, phrase_values, voices) for inner_row in inner_rows)
        inner_end = _later(inner_end, row.at, length)
        if len(rows) > MAX_ROWS:
            message = f"{phrase.context.label('')} has more than {MAX_ROWS:,} strikes"
            phrase.context.error("E105", message, row.place)
            return None
    length_here = length_of(rows, phrase["length"])
    if length_here is not None and phrase["length"] is None:
        if inner_end is None:
            length_here = None
        elif inner_end > length_here.beats:
            length_here = Length(beats=inner_end)
    if length_here is None:
        message = f"{phrase.context.label('')} has no 'length': not all its entries are in beats"
        phrase.error("E103", message, "entries")
        return None
    try:
        return transformed(rows, length_here, phrase["do"] or (), voices.mirrored)
    except TextError as error:
        phrase.error("E306", f"{phrase.context.label('do')}: {error.message}", "do")
        return None


def _later(end: float | None, begin: Length, length: Length) -> float | None:
    """The later end of two, in beats; None if one is not in beats."""
    lengths = (begin, length)
    if end is None or any(row_length.bars or row_length.seconds for row_length in lengths):
        return None
    return max(end, begin.beats + length.beats)


def _moved(row: Row, begin: Length, phrase: Values, voices: NoteTargets) -> Row:
    """A strike of a phrase that begins somewhere in another; its notes are those of its own `to`,
    where that is not the other's.
    """
    assert isinstance(row.at, Length)
    bars, beats = begin.bars + row.at.bars, begin.beats + row.at.beats
    moved = replace(row, at=Length(bars, beats, begin.seconds + row.at.seconds))
    to = phrase["to"] or ()
    if not to or tuple(to) == tuple(voices.to):
        return moved
    moved_names = tuple(Name(f"{part}.{word}", word.place) for part in to for word in row.what)
    return replace(moved, what=moved_names, before=())


def with_levels(rows: Sequence[Row], levels: Levels | None) -> tuple[Row, ...]:
    """Rows, each with a level: its own, or that of the row before; `levels` are those of rows
    that say none.
    """
    result, level_before = [], None
    for number, row in enumerate(rows):
        level_before = (
            row.level or level_before or (levels or Levels((MEZZO_FORTE,))).step(number, len(rows))
        )
        is_pattern = levels is not None and len(levels.steps) > 1
        result.append(replace(row, level=level_before) if row.level != level_before else row)
        if is_pattern and row.level is None:
            level_before = None  # the next row has the next level of the pattern
    return tuple(_swollen(rows, result))


def _swollen(rows_written: Sequence[Row], rows: Sequence[Row]) -> Iterator[Row]:
    """Rows whose levels go evenly, strike by strike, from each that swells to the next level that
    is written.
    """
    begin, end = 0, 0
    for number, row in enumerate(rows):
        if rows_written[number].swells:
            begin = number
            later_levels = (
                n for n in range(number + 1, len(rows)) if rows_written[n].level is not None
            )
            end = next(later_levels, number)
        low, high = rows[begin].level, rows[end].level
        if begin < number < end and low is not None and high is not None:
            share = (number - begin) / (end - begin)
            value = low.low + (high.low - low.low) * share
            yield replace(row, level=Level(value, value, low.is_strength))
        else:
            yield row
