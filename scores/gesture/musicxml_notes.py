"""What the measures of a part of a MusicXML score say: notes, dynamics, tempos, meters."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ergon.notation.tables import notes
from ergon.notation.tables.strengths import DYNAMICS
from ergon.scores.gesture.musicxml_passed import (
    ACCENT_ARTICULATIONS,
    SHORT_ARTICULATIONS,
    UnplayedCounter,
)

_GRACE_QUARTERS = Fraction(1, 12)  # length of a grace note before the beat, in quarters
_SEMITONES_BY_LETTER = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_LETTERS = "CDEFGAB"
_ACCIDENTALS = {-2: "bb", -1: "b", 0: "", 1: "#", 2: "##"}
_DYNAMIC_STEP = 1.0 / (len(DYNAMICS) - 1)  # strength between two dynamic words
_MEZZO_FORTE = DYNAMICS.index("mf") * _DYNAMIC_STEP
_FORTE_VELOCITY_SHARE = 90.0 / 127.0  # `dynamics="100"` as a share of the largest velocity
_STROKE_DYNAMICS = {"sf", "sfz", "sffz", "fz", "rf", "rfz"}  # marks that hold for one instant
# Marks of two levels: at their instant, and after it.
_FALLING_DYNAMICS = {"fp": ("f", "p"), "pf": ("p", "f")}
_FALLING_DYNAMICS |= {"sfp": ("f", "p"), "sfzp": ("f", "p"), "sfpp": ("f", "pp")}
_UNIT_NAMES = "maxima long breve whole half quarter eighth 16th 32nd 64th 128th 256th 512th 1024th"
_QUARTERS_BY_UNIT = {name: Fraction(32, 2**place) for place, name in enumerate(_UNIT_NAMES.split())}
_DIVISIONS_MAX = 10**15  # smallest common multiple of the divisions of a part
_NUMBER_PATTERN = re.compile(r"\s*([+-]?[0-9]{1,12}(\.[0-9]{1,12})?)\s*")
_FIRST_NUMBER_PATTERN = re.compile(r"[0-9]{1,6}(\.[0-9]{1,6})?")
_METER_PATTERN = re.compile(r"[0-9]{1,3}(\+[0-9]{1,3}){0,15}/[0-9]{1,3}")


class Pitch(NamedTuple):
    """The name of a note as it sounds, and the nearest key of MIDI."""

    word: str
    key: int


@dataclass(frozen=True, slots=True)
class Event:
    """A note, or a mark without a pitch, so many quarters after the beginning of its measure.

    `level` is a strength from here on, `level_after` the one after the notes of this instant;
    `hairpin` is 1 where a crescendo begins, -1 where a diminuendo does, 0 where it ends.
    """

    at: Fraction
    pitch: Pitch | None = None
    length: Fraction = Fraction(0)
    voice: str = ""
    is_tied_from: bool = False
    is_tied_to: bool = False
    is_accented: bool = False
    strength: float | None = None  # strength of this note alone
    level: float | None = None
    level_after: float | None = None
    hairpin: int | None = None
    tempo: float | None = None  # quarters a minute


@dataclass(slots=True)
class MeasureContent:
    """What a measure holds; its length in quarters, and where its last note ends; a meter that
    begins with it.
    """

    events: list[Event] = field(default_factory=list)
    length: Fraction = Fraction(0)
    sounding_length: Fraction = Fraction(0)
    meter: str | None = None


def parse_number(text: str | None) -> Fraction | None:
    """A number of a score; None if it is none."""
    match = _NUMBER_PATTERN.fullmatch(text or "")
    return None if match is None else Fraction(match[1])


class MeasureReader:
    """Reads the measures of one part in their order."""

    def __init__(self, unplayed_counts: Counter[str]) -> None:
        """Start; what nothing plays is counted in `unplayed_counts`."""
        self._unplayed_counter = UnplayedCounter(unplayed_counts)
        self._divisions = Fraction(1)
        self._divisions_lcm = 1
        self._diatonic_shift, self._chromatic_shift = 0, Fraction(0)
        self._is_respelled = False

    def read_measure(self, measure: Element) -> MeasureContent:
        """The content of the next measure."""
        measure_content = MeasureContent()
        cursor = onset = Fraction(0)
        grace_chords: list[list[Event]] = []  # notes of a chord are together
        for element in measure:
            if element.tag == "attributes":
                self._read_attributes(element, measure_content)
            elif element.tag in ("backup", "forward"):
                step = self._duration(element)
                cursor = max(
                    Fraction(0), cursor - step if element.tag == "backup" else cursor + step
                )
            elif element.tag == "direction" or element.tag == "sound":
                measure_content.events += self._events_of_direction(element, cursor)
            elif element.tag != "note":
                self._unplayed_counter.count_measure_element(element)
            else:
                is_chord = element.find("chord") is not None
                event_start = onset if is_chord else cursor
                is_grace, note_length = element.find("grace") is not None, self._duration(element)
                if not is_chord and not is_grace:
                    measure_content.events += _grace_notes_before(grace_chords, event_start)
                    grace_chords = []
                    onset, cursor = event_start, cursor + note_length
                note_event = self._read_note(
                    element, event_start, _GRACE_QUARTERS if is_grace else note_length
                )
                if element.find("rest") is None:
                    measure_content.sounding_length = max(measure_content.sounding_length, cursor)
                measure_content.events += self._events_of_dynamics(
                    element.iterfind("notations/dynamics"), event_start
                )
                if note_event is not None and not is_grace:
                    measure_content.events.append(note_event)
                elif note_event is not None:
                    grace_chords += [] if is_chord and grace_chords else [[]]
                    grace_chords[-1].append(note_event)
            measure_content.length = max(measure_content.length, cursor)
        measure_content.events += _grace_notes_before(grace_chords, cursor)
        return measure_content

    def _duration(self, element: Element) -> Fraction:
        return (
            max(Fraction(0), parse_number(element.findtext("duration")) or Fraction(0))
            / self._divisions
        )

    def _read_attributes(self, attributes: Element, measure_content: MeasureContent) -> None:
        divisions = parse_number(attributes.findtext("divisions"))
        self._unplayed_counter.count_attributes(attributes)
        if divisions is not None and divisions > 0:
            self._divisions = divisions
            self._divisions_lcm = math.lcm(self._divisions_lcm, divisions.numerator)
            if self._divisions_lcm > _DIVISIONS_MAX:
                raise ValueError("its divisions of a quarter fit no common grid")
        time_element = attributes.find("time")
        if time_element is not None and time_element.find("beats") is not None:
            pairs = zip(
                time_element.iterfind("beats"), time_element.iterfind("beat-type"), strict=False
            )
            measure_content.meter = _meter_text(
                ["/".join("".join((part.text or "").split()) for part in pair) for pair in pairs]
            )
            if measure_content.meter is None:
                self._unplayed_counter.counts["meter"] += 1
        transpose = attributes.find("transpose")
        if transpose is not None:
            octaves = int(parse_number(transpose.findtext("octave-change")) or 0)
            diatonic = parse_number(transpose.findtext("diatonic"))
            self._is_respelled = diatonic is None
            self._diatonic_shift = int(diatonic or 0) + 7 * octaves
            chromatic = parse_number(transpose.findtext("chromatic")) or Fraction(0)
            self._chromatic_shift = chromatic + 12 * octaves

    def _read_note(self, note: Element, cursor: Fraction, note_length: Fraction) -> Event | None:
        self._unplayed_counter.count_note(note)
        if note.find("rest") is not None:
            return None
        pitch_element = note.find("pitch")
        note_pitch = self._pitch(pitch_element)
        if note.find("cue") is not None or note_length <= 0 or note_pitch is None:
            noun = "unpitched note" if pitch_element is None else "unplayable note"
            if note_pitch is not None:
                noun = "cue note" if note.find("cue") is not None else "durationless note"
            self._unplayed_counter.counts[noun] += 1
            return None
        ties = {tie.get("type") for tie in note.iterfind("tie")}
        played_marks = {mark.tag for mark in note.iterfind("notations/articulations/*")}
        if played_marks & SHORT_ARTICULATIONS and not ties:
            note_length /= 2
        dynamics_percent = parse_number(note.get("dynamics"))
        return Event(
            cursor,
            note_pitch,
            note_length,
            note.findtext("voice") or "",
            is_tied_from="stop" in ties,
            is_tied_to="start" in ties,
            is_accented=bool(played_marks & ACCENT_ARTICULATIONS),
            strength=None if dynamics_percent is None else _strength_of_percent(dynamics_percent),
        )

    def _pitch(self, pitch_element: Element | None) -> Pitch | None:
        step_letter = (
            "" if pitch_element is None else (pitch_element.findtext("step") or "").strip()
        )
        octave = None if pitch_element is None else parse_number(pitch_element.findtext("octave"))
        if (
            pitch_element is None
            or step_letter not in _SEMITONES_BY_LETTER
            or octave is None
            or not -1 <= octave <= 10
        ):
            return None
        alteration = parse_number(pitch_element.findtext("alter")) or Fraction(0)
        staff_step = _LETTERS.index(step_letter) + 7 * int(octave)
        moved_step = staff_step + self._diatonic_shift
        alteration += self._chromatic_shift - (
            _semitones_above_c0(moved_step) - _semitones_above_c0(staff_step)
        )
        midi_key = 12 + _semitones_above_c0(moved_step) + alteration
        nearest_key = math.floor(midi_key + Fraction(1, 2))
        if not 0 <= nearest_key <= 127:
            return None
        semitones = int(alteration)  # towards the natural note
        if self._is_respelled or abs(semitones) > 2:
            note_name = notes.name(nearest_key)
            cents = 100 * (midi_key - nearest_key)
        else:
            note_name = f"{_LETTERS[moved_step % 7]}{_ACCIDENTALS[semitones]}{moved_step // 7}"
            cents = 100 * (alteration - semitones)
        return Pitch(f"{note_name}{float(cents):+g}cents" if cents else note_name, nearest_key)

    def _events_of_direction(self, direction: Element, cursor: Fraction) -> Iterator[Event]:
        event_start = cursor
        if (offset := parse_number(direction.findtext("offset"))) is not None:
            event_start = max(Fraction(0), cursor + offset / self._divisions)
        sound_element = direction if direction.tag == "sound" else direction.find("sound")
        self._unplayed_counter.count_direction(direction)
        if sound_element is not None:
            self._unplayed_counter.count_sound(sound_element)
        marks = self._events_of_dynamics(direction.iterfind("direction-type/dynamics"), event_start)
        yield from marks
        dynamics_percent = (
            None if sound_element is None else parse_number(sound_element.get("dynamics"))
        )
        if not marks and dynamics_percent is not None:
            yield Event(event_start, level=_strength_of_percent(dynamics_percent))
        for wedge in direction.iterfind("direction-type/wedge"):
            directions = {"crescendo": 1, "diminuendo": -1, "stop": 0}
            if (hairpin := directions.get(wedge.get("type", ""))) is not None:
                yield Event(event_start, hairpin=hairpin)
        yield from self._tempo_events(direction, sound_element, event_start)

    def _tempo_events(
        self, direction: Element, sound: Element | None, begin: Fraction
    ) -> Iterator[Event]:
        stated_tempo = None if sound is None else sound.get("tempo")
        marks = direction.findall("direction-type/metronome")
        tempo = parse_number(stated_tempo) or next(
            filter(None, map(_quarters_per_minute, marks)), None
        )
        if tempo is not None and tempo > 0:
            yield Event(begin, tempo=float(tempo))
        elif marks or stated_tempo is not None:
            self._unplayed_counter.counts["tempo"] += 1

    def _events_of_dynamics(self, groups: Iterable[Element], begin: Fraction) -> list[Event]:
        """The mark of dynamics of a direction or of a note, or none."""
        words = [mark.tag for group in groups for mark in group]
        mark = next(filter(None, map(_dynamic_of_word, words)), None)
        if words and mark is None:
            self._unplayed_counter.counts["dynamic mark"] += 1
        return [] if mark is None else [replace(mark, at=begin)]


def _grace_notes_before(
    grace_chords: Sequence[Sequence[Event]], main_quarter: Fraction
) -> Iterator[Event]:
    """Grace notes and chords of them, one after the other before an instant."""
    for index, chord in enumerate(grace_chords):
        for grace_note in chord:
            yield replace(
                grace_note, at=main_quarter - (len(grace_chords) - index) * _GRACE_QUARTERS
            )


def _semitones_above_c0(staff_step: int) -> int:
    """Semitones of a natural note above C0."""
    return 12 * (staff_step // 7) + _SEMITONES_BY_LETTER[_LETTERS[staff_step % 7]]


def _strength_of_percent(percent: Fraction) -> float:
    return min(1.0, max(0.0, float(percent) / 100.0 * _FORTE_VELOCITY_SHARE))


def _meter_text(meter_texts: Sequence[str]) -> str | None:
    """A meter as a score writes it; of several parts as one sum over their smallest note."""
    if not meter_texts or not all(_METER_PATTERN.fullmatch(text) for text in meter_texts):
        return None
    meter_units = [int(text.partition("/")[2]) for text in meter_texts]
    smallest_unit = max(meter_units)
    if min(meter_units) < 1 or any(smallest_unit % part_unit for part_unit in meter_units):
        return None
    beat_groups = [
        str(int(group) * smallest_unit // part_unit)
        for text, part_unit in zip(meter_texts, meter_units, strict=True)
        for group in text.partition("/")[0].split("+")
    ]
    return f"{'+'.join(beat_groups)}/{smallest_unit}" if sum(map(int, beat_groups)) else None


def _dynamic_of_word(word: str) -> Event | None:
    """What a mark of dynamics means; None for one that is not known."""
    if word in _STROKE_DYNAMICS:
        return Event(Fraction(0), is_accented=True)
    if word in _FALLING_DYNAMICS:
        level, level_after = (
            DYNAMICS.index(sign) * _DYNAMIC_STEP for sign in _FALLING_DYNAMICS[word]
        )
        return Event(Fraction(0), level=level, level_after=level_after)
    if set(word) <= {"p"} or set(word) <= {"f"}:
        word = word[:3]
    return (
        Event(Fraction(0), level=DYNAMICS.index(word) * _DYNAMIC_STEP) if word in DYNAMICS else None
    )


def _quarters_per_minute(metronome: Element) -> Fraction | None:
    """Quarters a minute of a metronome mark."""
    beat_unit = _QUARTERS_BY_UNIT.get((metronome.findtext("beat-unit") or "").strip())
    # The first number of "c. 80" and of "80-84".
    stated_number = _FIRST_NUMBER_PATTERN.search(metronome.findtext("per-minute") or "")
    if beat_unit is None or stated_number is None or len(metronome.findall("beat-unit")) != 1:
        return None
    dots = min(len(metronome.findall("beat-unit-dot")), 4)
    return Fraction(stated_number[0]) * beat_unit * (2 - Fraction(1, 2**dots))


class Loudness:
    """The strength that marks say at each instant of a part."""

    def __init__(self, marks: Sequence[tuple[Fraction, Event]]) -> None:
        """`marks` are instants with their events, in the order in which they are written."""
        marks = sorted(marks, key=lambda mark: mark[0])
        self._accent_quarters = {
            beat for beat, event in marks if event.pitch is None and event.is_accented
        }
        self._levels = [(beat, event) for beat, event in marks if event.level is not None]
        self._instants = [beat for beat, _ in self._levels]
        self._hairpins: list[tuple[Fraction, Fraction, float, float]] = []
        self._hairpin_ends: list[Fraction] = []  # of these, one after the other
        open_hairpin: tuple[Fraction, int] | None = None
        for mark_beat, mark_event in marks:
            if mark_event.hairpin:
                open_hairpin = mark_beat, mark_event.hairpin
            elif mark_event.hairpin == 0 and open_hairpin is not None:
                self._add_hairpin(*open_hairpin, mark_beat)
                open_hairpin = None
        self._hairpin_starts = [begin for begin, *_ in self._hairpins]

    def _add_hairpin(self, begin: Fraction, direction: int, end: Fraction) -> None:
        """A hairpin: up to the mark at its end or within a quarter of it, else by one word."""
        low_strength = self._level_from(begin)
        low_strength = _MEZZO_FORTE if low_strength is None else low_strength
        mark_index = bisect_right(self._instants, end - Fraction(1, 1024))
        high_strength = min(1.0, max(0.0, low_strength + direction * _DYNAMIC_STEP))
        if mark_index < len(self._levels) and self._instants[mark_index] <= end + 1:
            high_strength = self._levels[mark_index][1].level or 0.0
        if end > begin:
            self._hairpins.append((begin, end, low_strength, high_strength))
            self._hairpin_ends.append(end)

    def _level_from(self, quarter: Fraction) -> float | None:
        """The strength without hairpins that go on at an instant."""
        n_marks = bisect_right(self._instants, quarter)
        mark = self._levels[n_marks - 1] if n_marks else None
        n_over = bisect_right(self._hairpin_ends, quarter)
        last_hairpin = self._hairpins[n_over - 1] if n_over else None
        if mark is None or (last_hairpin is not None and last_hairpin[1] > mark[0]):
            return None if last_hairpin is None else last_hairpin[3]
        instant, event = mark
        return event.level if event.level_after is None or instant == quarter else event.level_after

    def strength(self, quarter: Fraction, event: Event) -> float | None:
        """The strength of a note; None if nothing is said."""
        n_begun = bisect_right(self._hairpin_starts, quarter)
        note_strength = event.strength
        if note_strength is None:
            note_strength = self._level_from(quarter)
            if n_begun and quarter < self._hairpins[n_begun - 1][1]:
                begin, end, low, high = self._hairpins[n_begun - 1]
                note_strength = low + (high - low) * float((quarter - begin) / (end - begin))
        if event.is_accented or quarter in self._accent_quarters:
            note_strength = min(
                1.0, (_MEZZO_FORTE if note_strength is None else note_strength) + _DYNAMIC_STEP
            )
        return note_strength
