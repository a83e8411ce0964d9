"""Transformations of a phrase: its rows and its length after `do`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import floor

from ergon.notation.clock.positions import Length
from ergon.notation.text.errors import TextError
from ergon.scores.gesture.transforms import Transform
from ergon.scores.reading.melody import Row


def length_of(phrase_rows: Sequence[Row], written_length: Length | None) -> Length | None:
    """The length of a phrase; if none is written, up to the next whole beat; None if entries are
    not all in beats.
    """
    if written_length is not None:
        return written_length
    last_beat = 0.0
    for phrase_row in phrase_rows:
        assert isinstance(phrase_row.at, Length)
        if phrase_row.at.bars or phrase_row.at.seconds:
            return None
        last_beat = max(last_beat, phrase_row.at.beats)
    return Length(beats=floor(last_beat) + 1.0)


def transformed_rows(
    phrase_rows: Sequence[Row],
    phrase_length: Length,
    transforms: Iterable[Transform],
    mirror_row: Callable[[Row, Row], Row],
) -> tuple[tuple[Row, ...], Length]:
    """Rows of a phrase after transformations, left to right, and its length. Raises TextError."""
    changed_rows = tuple(phrase_rows)
    for transform in transforms:
        if transform.word == "mirror":
            changed_rows = tuple(mirror_row(row, changed_rows[0]) for row in changed_rows)
            continue
        change_rows = _CHANGE_BY_WORD.get(transform.word)
        if change_rows is None:
            transform_names = ", ".join([*_CHANGE_BY_WORD, "mirror"])
            message = (
                f"'{transform.word}' moves the points of a gesture; a phrase has {transform_names}"
            )
            raise TextError(message, offset=transform.offset, length=transform.length)
        changed_rows = tuple(change_rows(changed_rows, transform))
        if transform.word == "stretch":
            phrase_length = phrase_length.times(transform.amount)
        if transform.word == "from":
            phrase_length = _length_after(phrase_length, transform)
            if not changed_rows or not phrase_length.is_some:
                message = "'from' begins after the last entry of this phrase"
                raise TextError(message, offset=transform.offset, length=transform.length)
    return changed_rows, phrase_length


def _scale_levels(rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    for row in rows:
        yield replace(row, level=row.level and row.level.scaled(transform.amount))


def _stretch_times(rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    for row in rows:
        stretched_length = row.length and row.length.times(transform.amount)
        yield replace(row, at=_row_time(row).times(transform.amount), length=stretched_length)


def _shift_times(rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    for phrase_row in rows:
        time = _row_time(phrase_row)
        beats, seconds = (
            time.beats + transform.time.beats,
            time.seconds + transform.time.seconds,
        )
        yield replace(phrase_row, at=Length(time.bars, beats, seconds))


def _reverse_rows(phrase_rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    """The rows in reverse order, within the same time span."""
    row_times = [
        (time_part.bars, time_part.beats, time_part.seconds)
        for time_part in map(_row_time, phrase_rows)
    ]
    if sum(any(unit) for unit in zip(*row_times, strict=True)) > 1:
        message = "'reverse' needs entries in one unit: all in beats, in bars or in seconds"
        raise TextError(message, offset=transform.offset, length=transform.length)
    end_sums = [low + high for low, high in zip(min(row_times), max(row_times), strict=True)]
    for row, row_time in sorted(
        zip(phrase_rows, row_times, strict=True), key=lambda pair: pair[1], reverse=True
    ):
        yield replace(
            row,
            at=Length(*(time_part - b for time_part, b in zip(end_sums, row_time, strict=True))),
        )


def _quantise_times(rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    for phrase_row in rows:
        row_time = _row_time(phrase_row)
        if row_time.bars or row_time.seconds:
            message = "'quantise' moves beats; the entries of this phrase are in bars or seconds"
            raise TextError(message, offset=transform.offset, length=transform.length)
        yield replace(
            phrase_row,
            at=Length(beats=floor(row_time.beats / transform.amount + 0.5) * transform.amount),
        )


def _start_from(phrase_rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    """Rows from an instant on, which becomes the beginning; every row has its own impulse
    already.
    """
    for phrase_row in phrase_rows:
        time_after = _length_after(_row_time(phrase_row), transform)
        if min(time_after.beats, time_after.seconds) >= 0.0:
            yield replace(phrase_row, at=time_after)


def _length_after(length: Length, transform: Transform) -> Length:
    """A length minus the time of `from`, in the same unit."""
    other_unit = length.seconds if transform.time.beats else length.beats
    if length.bars or other_unit:
        message = "'from' needs entries and a length in its own unit: all in beats or in seconds"
        raise TextError(message, offset=transform.offset, length=transform.length)
    return Length(0.0, length.beats - transform.time.beats, length.seconds - transform.time.seconds)


def _jitter_times(phrase_rows: Sequence[Row], transform: Transform) -> Iterator[Row]:
    if transform.x:
        message = "a phrase has instants and no positions to move; write jitter 4ms 0mm"
        raise TextError(message, offset=transform.offset, length=transform.length)
    for row in phrase_rows:
        yield replace(row, jitter=Length(0.0, transform.time.beats, transform.time.seconds))


def _row_time(row: Row) -> Length:
    assert isinstance(row.at, Length)
    return row.at


_CHANGE_BY_WORD: Mapping[str, Callable[[Sequence[Row], Transform], Iterator[Row]]] = {
    "scale": _scale_levels,
    "stretch": _stretch_times,
    "reverse": _reverse_rows,
    "shift": _shift_times,
    "quantise": _quantise_times,
    "from": _start_from,
    "jitter": _jitter_times,
}
