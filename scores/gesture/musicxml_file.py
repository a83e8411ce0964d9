"""Notes, dynamics, tempos and meters of a score of MusicXML 4.0, in quarter notes."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ergon.notation.clock.meter import MAX_BEATS, Meter, parse_meter
from ergon.notation.clock.tempo import BPM_MAX, BPM_MIN
from ergon.notation.text.errors import TextError
from ergon.notation.text.spelling import nearest
from ergon.scores.gesture.file_meters import read_meters
from ergon.scores.gesture.midi_file import MAX_NOTES, FileState, state_of
from ergon.scores.gesture.musicxml_bytes import read_root
from ergon.scores.gesture.musicxml_notes import (
    Event,
    Loudness,
    MeasureContent,
    MeasureReader,
    Pitch,
)
from ergon.scores.gesture.musicxml_order import TooLongError, order_marks, playing_order
from ergon.scores.gesture.take_file import TakeError

_COMMON_DENOMINATOR_MAX = 10**40  # parts of a quarter at which bars may begin


class XmlNote(NamedTuple):
    """A note: its beginning and length in quarters, its name, its strength (None: none is said)."""

    at: float
    word: str
    key: int  # nearest MIDI key
    strength: float | None
    length: float


@dataclass(frozen=True, slots=True)
class XmlPart:
    """A part: its id, its name, its notes in the order of time."""

    id: str
    name: str
    notes: tuple[XmlNote, ...]

    @property
    def label(self) -> str:
        """Its id, with its name."""
        return f"{self.id} ({self.name})" if self.name else self.id


@dataclass(frozen=True, slots=True)
class XmlScore:
    """What a file holds. Times are in quarter notes from the beginning of its first bar, which is
    whole: before an upbeat there is a rest. `skipped_counts` counts what no part of ergon plays.
    """

    title: str
    length: float
    n_measures: int
    parts: tuple[XmlPart, ...]
    tempos: tuple[tuple[float, float], ...]  # quarter, quarters a minute
    meters: tuple[tuple[float, str], ...]  # quarter, text
    skipped_counts: Mapping[str, int]


@dataclass(slots=True)
class _MeasureColumn:
    """A measure in all parts, and its length in quarters."""

    measures: dict[str, Element] = field(default_factory=dict)
    length: Fraction = Fraction(0)
    is_upbeat: bool = False


def read_score(path: Path) -> XmlScore:
    """The content of a file. Raises TakeError."""
    try:
        return _read(path, state_of(path))
    except OSError as error:
        raise TakeError(f"cannot be read: {error.strerror or error}", path) from None


@lru_cache(8)
def _read(path: Path, _: FileState) -> XmlScore:
    root = read_root(path)
    try:
        return _score_of_root(root)
    except TooLongError as error:
        raise TakeError(error.message, path) from None
    except (ValueError, ZeroDivisionError) as error:
        raise TakeError(f"it cannot be understood: {error}", path) from None


def _score_of_root(score_root: Element) -> XmlScore:
    part_ids = [part.get("id", "") for part in score_root.iterfind("part")]
    if (
        repeated_id := next((part_id for part_id, n in Counter(part_ids).items() if n > 1), None)
    ) is not None:
        raise ValueError(f"two of its parts have the id {repeated_id[:80]!r}")
    part_names = {
        score_part.get("id", ""): " ".join((score_part.findtext("part-name") or "").split())[:80]
        for score_part in score_root.iterfind("part-list/score-part")
    }
    measure_columns = _measure_columns(score_root)
    skipped_counts: Counter[str] = Counter()
    meters: list[tuple[int, str]] = []  # index of the measure, text
    events_of_measures = _read_measures(
        measure_columns, {part_id: MeasureReader(skipped_counts) for part_id in part_ids}, meters
    )
    played_order = playing_order(
        order_marks([list(column.measures.values()) for column in measure_columns])
    )
    measure_starts, end_quarter, placed_meters = _played_bars(measure_columns, played_order, meters)
    events_by_part: dict[str, list[tuple[Fraction, Event]]] = {part_id: [] for part_id in part_ids}
    tempos: list[tuple[Fraction, float]] = []
    n_notes = 0
    for start_quarter, index in zip(measure_starts, played_order, strict=True):
        for part_id, part_events in events_of_measures[index].items():
            events_by_part[part_id] += ((start_quarter, event) for event in part_events)
            n_notes += sum(event.pitch is not None for event in part_events)
            tempos += (
                (start_quarter + part_event.at, part_event.tempo)
                for part_event in part_events
                if part_event.tempo is not None
            )
        if n_notes > MAX_NOTES:
            raise TooLongError(f"more than {MAX_NOTES:,} notes are played")
    work_title = (
        score_root.findtext("work/work-title") or score_root.findtext("movement-title") or ""
    )
    tempo_changes = dict(sorted(tempos, key=lambda pair: pair[0]))
    return XmlScore(
        " ".join(work_title.split())[:200],
        float(end_quarter),
        len(played_order),
        tuple(
            XmlPart(
                part_id, part_names.get(part_id, ""), tuple(_played_notes(events_by_part[part_id]))
            )
            for part_id in part_ids
        ),
        tuple((float(quarter), tempo) for quarter, tempo in tempo_changes.items()),
        tuple((float(quarter), meter) for quarter, meter in placed_meters),
        dict(skipped_counts),
    )


def _measure_columns(root: Element) -> list[_MeasureColumn]:
    """The measures of all parts, by their places."""
    measure_columns: list[_MeasureColumn] = []
    for part_element in root.iterfind("part"):
        for measure_index, measure in enumerate(part_element.iterfind("measure")):
            if measure_index == len(measure_columns):
                measure_columns.append(_MeasureColumn())
            measure_columns[measure_index].measures[part_element.get("id", "")] = measure
    return measure_columns


def _played_bars(
    measure_columns: Sequence[_MeasureColumn],
    played_order: Sequence[int],
    meters: Sequence[tuple[int, str]],
) -> tuple[list[Fraction], Fraction, list[tuple[Fraction, str]]]:
    """Where each measure that is played begins, where the last ends, and the meters from where
    they hold, in quarters. An upbeat fills the end of a bar that is whole.
    """
    measure_quarter = Fraction(0)
    start_quarters: list[Fraction] = []
    placed_meters: list[tuple[Fraction, str]] = []
    for play_index, index in enumerate(played_order):
        measure_column, meter = measure_columns[index], _meter_of_measure(meters, index)
        is_upbeat = play_index == 0 and measure_column.is_upbeat
        if is_upbeat:
            measure_quarter = _bar_quarters(meter) - measure_column.length
        is_edge_bar = is_upbeat or play_index + 1 == len(played_order)
        bar_meter = _meter_of_length(meter, Fraction(0) if is_edge_bar else measure_column.length)
        if not placed_meters or placed_meters[-1][1] != bar_meter:
            placed_meters.append((measure_quarter if play_index else Fraction(0), bar_meter))
        start_quarters.append(measure_quarter)
        measure_quarter += measure_column.length
        if measure_quarter.denominator > _COMMON_DENOMINATOR_MAX:
            raise ValueError("the lengths of its bars fit no common grid")
    return start_quarters, measure_quarter, placed_meters


def _read_measures(
    measure_columns: Sequence[_MeasureColumn],
    readers: Mapping[str, MeasureReader],
    meters: list[tuple[int, str]],
) -> list[dict[str, list[Event]]]:
    """Read each measure once."""
    measure_events: list[dict[str, list[Event]]] = []
    meter = "4/4"
    for measure_index, measure_column in enumerate(measure_columns):
        content_by_part: dict[str, MeasureContent] = {}
        for part_id, measure in measure_column.measures.items():
            part_content = content_by_part[part_id] = readers[part_id].read_measure(measure)
            if (part_content.meter is not None and part_content.meter != meter) or (
                part_content.meter and not meters
            ):
                meter = part_content.meter or meter
                meters.append((measure_index, meter))
        bar_length = _bar_quarters(meter)
        is_implicit = any(
            measure_element.get("implicit") == "yes" or measure_element.get("number") == "0"
            for measure_element in measure_column.measures.values()
        )
        measure_column.length = (
            _measure_length(content_by_part.values(), bar_length, is_implicit) or bar_length
        )
        measure_column.is_upbeat = (
            measure_index == 0 and is_implicit and measure_column.length < bar_length
        )
        measure_events.append(
            {part_id: content.events for part_id, content in content_by_part.items()}
        )
    return measure_events


def _measure_length(
    part_contents: Collection[MeasureContent], bar_length: Fraction, is_implicit: bool
) -> Fraction:
    """The length of a measure in all parts: rests of one part that are longer than the bar, or than
    another part of a bar that counts as incomplete, do not lengthen it.
    """
    lengths = [content.length for content in part_contents if content.length]
    sounding_length = max(
        (content.sounding_length for content in part_contents), default=Fraction(0)
    )
    if is_implicit and lengths:
        return max(sounding_length, min(lengths))
    return (
        max(sounding_length, bar_length)
        if bar_length in lengths
        else max(lengths, default=Fraction(0))
    )


def _meter_of_measure(meters: Sequence[tuple[int, str]], index: int) -> str:
    """The meter of a measure."""
    n_before = bisect_right(meters, index, key=itemgetter(0))
    return meters[n_before - 1][1] if n_before else "4/4"


def _meter_of_length(meter: str, measure_length: Fraction) -> str:
    """The meter of a measure of this length: its own, or that of an incomplete one. A length of 0
    is any.
    """
    if not measure_length or measure_length == _bar_quarters(meter):
        return meter
    meter_unit = next(
        (unit for unit in (4, 8, 16, 32, 64) if (measure_length * unit / 4).denominator == 1), None
    )
    return meter if meter_unit is None else f"{int(measure_length * meter_unit / 4)}/{meter_unit}"


def _bar_quarters(meter: str) -> Fraction:
    """The length of a bar in quarters."""
    beats, _, unit = meter.partition("/")
    return sum(map(int, beats.split("+"))) * Fraction(4, int(unit))


def _played_notes(placed_events: Sequence[tuple[Fraction, Event]]) -> Iterator[XmlNote]:
    """The notes of a part as they are played: ties join, and levels go by hairpins."""
    loudness = Loudness([(start + event.at, event) for start, event in placed_events])
    joined_notes: list[tuple[Fraction, Fraction, Pitch, float | None]] = []
    open_ties: dict[str, dict[str, int]] = {}  # by pitch, then by voice: the index of the note
    for start_quarter, part_event in placed_events:
        if part_event.pitch is None:
            continue
        onset, voice = start_quarter + part_event.at, part_event.voice
        ties_of_pitch = open_ties.setdefault(part_event.pitch.word, {})
        if part_event.is_tied_from and voice not in ties_of_pitch:  # a tie into another voice
            voice = next(iter(ties_of_pitch), voice)
        # Many files say where ties begin, and not where they end.
        joined_index = ties_of_pitch.pop(voice, None)
        if (
            joined_index is not None
            and joined_notes[joined_index][0] + joined_notes[joined_index][1] == onset
        ):
            first_onset, note_length, note_pitch, strength = joined_notes[joined_index]
            joined_notes[joined_index] = (
                first_onset,
                note_length + part_event.length,
                note_pitch,
                strength,
            )
        else:
            joined_index = len(joined_notes)
            joined_notes.append(
                (onset, part_event.length, part_event.pitch, loudness.strength(onset, part_event))
            )
        if part_event.is_tied_to:
            ties_of_pitch[part_event.voice] = joined_index
    for onset, note_length, note_pitch, strength in sorted(
        joined_notes, key=lambda note: (note[0], note[2].key)
    ):
        yield XmlNote(
            float(max(onset, Fraction(0))),
            note_pitch.word,
            note_pitch.key,
            strength,
            float(note_length),
        )


def part_notes(path: Path, part_name: str | None) -> tuple[tuple[XmlNote, ...], float]:
    """The notes of a part, by its id or name, or of all, and the length of the piece in quarters.

    Raises TakeError.
    """
    score = read_score(path)
    chosen_parts = [
        score_part
        for score_part in score.parts
        if part_name in (None, score_part.id, score_part.name)
    ]
    sorted_notes = sorted(
        (note for score_part in chosen_parts for note in score_part.notes),
        key=lambda note: (note.at, note.key),
    )
    if sorted_notes:
        return tuple(sorted_notes), score.length
    parts_with_notes = ", ".join(score_part.label for score_part in score.parts if score_part.notes)
    if not parts_with_notes:
        raise TakeError("it has no notes", path)
    problem = "has no notes" if chosen_parts else "is not there"
    message = f"part {part_name} {problem}; those with notes are {parts_with_notes}"
    part_names = [
        name
        for score_part in score.parts
        if score_part.notes
        for name in (score_part.id, score_part.name)
    ]
    raise TakeError(message, path, suggestion=nearest(part_name or "", part_names), field="channel")


def tempos_of(path: Path) -> tuple[tuple[float, float], ...]:
    """The tempos of a file: quarter notes from the beginning, and quarters a minute. Raises
    TakeError.
    """
    tempos = read_score(path).tempos
    for quarter, tempo in tempos:
        if not BPM_MIN <= tempo <= BPM_MAX:
            message = f"its tempo {quarter:g} quarters after the beginning is {tempo:g} quarters a "
            message += f"minute; a tempo lies between {BPM_MIN:g} and {BPM_MAX:,.0f} bpm"
            raise TakeError(message, path)
    # Without a tempo of its own a score goes as a MIDI file does.
    return tempos if tempos and tempos[0][0] == 0.0 else ((0.0, 120.0), *tempos)


def meters_of(path: Path) -> tuple[tuple[float, Meter], ...]:
    """The meters of a file: quarter notes from the beginning, and a meter. Raises TakeError for a
    meter that no score has, and for one that does not begin on a bar line.
    """
    return read_meters(path, read_score(path).meters, _meter)


def _meter(meter_text: str) -> Meter:
    meter = parse_meter(meter_text)
    if sum(meter.groups) > MAX_BEATS:
        raise TextError(f"no score has a meter {meter_text}")
    return meter
