"""In which order the measures of a score of MusicXML are played: repeats, endings, jumps.

Repeats are played before a jump (da capo, dal segno) and not after it; then the last ending is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from ergon.notation.text.errors import TextError

MAX_PLAYED_MEASURES = 20_000  # measures
_PASSES_MAX = 100  # passes of one repeat


class TooLongError(TextError):
    """A score that is longer than one that is read."""


@dataclass(slots=True)
class MeasureOrderMarks:
    """What a measure says of the order; `n_passes` is how often a repeat that ends here is played
    (0: none ends), `endings` the passes in which it is played (none: all).
    """

    is_repeat_start: bool = False
    n_passes: int = 0
    endings: frozenset[int] = frozenset()
    jump_target: str = ""  # the name of a segno, or "capo"
    segnos: set[str] = field(default_factory=set)
    codas: set[str] = field(default_factory=set)
    coda_target: str = ""
    is_fine: bool = False


def order_marks(measure_columns: Sequence[Sequence[Element]]) -> list[MeasureOrderMarks]:
    """What measures say, each of them as all parts have it."""
    marks_by_measure = [MeasureOrderMarks() for _ in measure_columns]
    endings: frozenset[int] = frozenset()
    for measure_index, (marks, measures) in enumerate(
        zip(marks_by_measure, measure_columns, strict=True)
    ):
        opened_endings, is_closed = _read_marks(measures, marks)
        endings = opened_endings or endings
        marks.endings = endings
        if is_closed:
            endings = frozenset()
        if marks.n_passes == 1:  # a repeat without a number of times
            last_ending = max(marks.endings, default=1)
            marks.n_passes = max(2, last_ending + _has_next_ending(measure_columns, measure_index))
    return marks_by_measure


def _has_next_ending(columns: Sequence[Sequence[Element]], measure_index: int) -> bool:
    """Whether another ending begins in the next measure."""
    next_column = columns[measure_index + 1] if measure_index + 1 < len(columns) else ()
    return any(
        mark.get("type") == "start" for m in next_column for mark in m.iterfind("barline/ending")
    )


def _read_marks(
    measures: Sequence[Element], marks: MeasureOrderMarks
) -> tuple[frozenset[int], bool]:
    """Read the marks of a measure; the endings that begin in it, and whether endings end."""
    opened_endings: frozenset[int] = frozenset()
    is_closed = False
    for measure in measures:
        for ending in measure.iterfind("barline/ending"):
            if ending.get("type") == "start":
                opened_endings = _pass_numbers(ending.get("number", ""))
            else:
                is_closed = True
        for repeat in measure.iterfind("barline/repeat"):
            if repeat.get("direction") == "forward":
                marks.is_repeat_start = True
                continue
            times_text = repeat.get("times", "")
            n_times = int(times_text) if times_text.isdigit() and len(times_text) < 4 else 1
            marks.n_passes = max(marks.n_passes, min(n_times, _PASSES_MAX))
        for sound in (*measure.iterfind("sound"), *measure.iterfind("direction/sound")):
            _read_sound(sound, marks)
    return opened_endings, is_closed


def _pass_numbers(text: str) -> frozenset[int]:
    """The passes of an ending: `1, 2`, and as some programs write them `1.` and `1-3`."""
    ranges = re.findall(r"(?<!\d)(\d{1,2})(?:\s*-\s*(\d{1,2}))?(?!\d)", text)
    return frozenset(n for a, b in ranges for n in range(int(a), int(b or a) + 1))


def _read_sound(sound_element: Element, marks: MeasureOrderMarks) -> None:
    if sound_element.get("dacapo") == "yes":
        marks.jump_target = "capo"
    marks.jump_target = sound_element.get("dalsegno") or marks.jump_target
    marks.coda_target = sound_element.get("tocoda") or marks.coda_target
    marks.is_fine |= bool(sound_element.get("fine"))
    marks.segnos |= {name for name in (sound_element.get("segno"),) if name}
    marks.codas |= {name for name in (sound_element.get("coda"),) if name}


def playing_order(measures: Sequence[MeasureOrderMarks]) -> list[int]:
    """The indices of measures in the order in which they are played. Raises TooLongError."""
    played_measures: list[int] = []
    for measure_index in _walk_measures(measures):
        if len(played_measures) >= MAX_PLAYED_MEASURES:
            raise TooLongError(
                f"it has more than {MAX_PLAYED_MEASURES:,} measures, with its repeats"
            )
        played_measures.append(measure_index)
    return played_measures


def _walk_measures(measures: Sequence[MeasureOrderMarks]) -> Iterator[int]:
    measure_index, section_start, pass_number = 0, 0, 1
    has_jumped = False
    while measure_index < len(measures):
        marks = measures[measure_index]
        if marks.is_repeat_start and measure_index != section_start:
            section_start, pass_number = measure_index, 1
        if marks.endings and not _is_in_pass(measures, measure_index, pass_number, has_jumped):
            measure_index += 1
            if measure_index < len(measures) and not measures[measure_index].endings:
                section_start, pass_number = measure_index, 1
            continue
        yield measure_index
        if marks.n_passes and not has_jumped and pass_number < marks.n_passes:
            pass_number += 1
            measure_index = section_start
            continue
        if has_jumped and marks.is_fine:
            return
        if has_jumped and marks.coda_target:
            target_index = next(
                (i for i, measure in enumerate(measures) if marks.coda_target in measure.codas),
                None,
            )
            if target_index is not None and target_index > measure_index:
                measure_index = section_start = target_index
                pass_number = 1
                continue
        if marks.jump_target and not has_jumped:
            segno_indices = (
                i for i, measure in enumerate(measures) if marks.jump_target in measure.segnos
            )
            measure_index = section_start = (
                0 if marks.jump_target == "capo" else next(segno_indices, 0)
            )
            has_jumped, pass_number = True, 1
            continue
        measure_index += 1
        ends_endings = (
            measure_index < len(measures) and marks.endings and not measures[measure_index].endings
        )
        if marks.n_passes or ends_endings:
            section_start, pass_number = measure_index, 1


def _is_in_pass(
    measures: Sequence[MeasureOrderMarks], measure_index: int, pass_number: int, has_jumped: bool
) -> bool:
    """Whether an ending is played in this pass; after a jump the last one is."""
    if not has_jumped:
        return pass_number in measures[measure_index].endings
    next_index = measure_index
    while (
        next_index < len(measures)
        and measures[next_index].endings == measures[measure_index].endings
    ):
        next_index += 1
    return next_index >= len(measures) or not measures[next_index].endings
