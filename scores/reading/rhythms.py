"""Strikes by a rhythm text: what its words strike, and what falls in each cycle."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, inf
from operator import itemgetter

from ergon.instruments.model import Target
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import tuning
from ergon.notation.tables.shapes import Text
from ergon.notation.tables.strengths import (
    LEVEL,
    MEANINGS,
    MEZZO_FORTE,
    ImpulseRange,
    Level,
    Levels,
)
from ergon.notation.tables.tuning import Tuning
from ergon.notation.text.errors import TextError
from ergon.scores.pattern.cycle_transforms import apply, parse_transforms
from ergon.scores.pattern.cycles import MAX_EVENTS, Cycles, chance_from
from ergon.scores.pattern.phrasing import swell
from ergon.scores.pattern.rhythm_text import WORD, line_offsets, parse
from ergon.scores.pattern.struck import Struck, key_of, name_of, note_of, notes_of

ANY_WORD = "x"  # the word for what `to` names
LONGEST_CYCLES = 8.0  # longest note [cycles] that earlier cycles are searched for
_SAME_STROKE_TOLERANCE = 1e-9  # tolerance, in strokes, for a rate times a length
MAX_CYCLES = 200_000  # cycles of one rhythm: more than two days at one a second
_RHYTHMS_CACHED = 32  # rhythms whose cycles are remembered: a thousand bars of each take 1.5 MB

# Where in its cycle an event begins, its span and how long it sounds in cycles, and its word.
_CycleEvent = tuple[float, float, float, Struck]

# What a word strikes, for each reach: a strength means another impulse on each instrument.
Voice = tuple[tuple[tuple[Target, ...], ImpulseRange | None], ...]


@dataclass(frozen=True, slots=True)
class Stroke:
    """A stroke of a rhythm: its beat, its number among all, its word, how strongly, how long."""

    beat: float
    number: int
    word: str
    level: Level
    duration: float  # in beats


@dataclass(frozen=True, slots=True)
class Rhythm:
    """A text that is one `cycle`, its transformations, and what each of its words strikes."""

    text: str
    do: str
    cycle: Length
    voices: Mapping[str, Voice]
    first_cycle: int = 0  # the number of the cycle that is played first
    tuning: Tuning | None = None  # by which the notes of chords are named and ordered

    def cycle_begin(self, tempo: TempoMap, begin_beat: float, cycle_index: int) -> float:
        """The beat on which a cycle begins, of a rhythm that begins at a beat."""
        return tempo.after(begin_beat, self.cycle.times(cycle_index))

    def cycle_count(self, tempo: TempoMap, begin: float, before_beat: float) -> int:
        """The number of cycles that begin before a beat."""
        if before_beat == inf:
            return MAX_CYCLES
        low, high = 0, 1
        while high < MAX_CYCLES and self.cycle_begin(tempo, begin, high) < before_beat - SAME:
            low, high = high, 2 * high
        high = min(high, MAX_CYCLES)
        if self.cycle_begin(tempo, begin, low) >= before_beat - SAME:
            return low
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (
                (middle, high)
                if self.cycle_begin(tempo, begin, middle) < before_beat - SAME
                else (low, middle)
            )
        return high

    def strokes(
        self, tempo: TempoMap, start: float, levels: Levels, draws: tuple[int, str], cycles: range
    ) -> Iterator[Stroke]:
        """The strokes of some cycles, in order; `draws` are the seed and who plays."""
        events_of_cycle = _cycle_events(self.text, self.do, self.tuning, *draws)
        for cycle_index in cycles:
            cycle_begin, cycle_end = (
                self.cycle_begin(tempo, start, index) for index in (cycle_index, cycle_index + 1)
            )
            cycle_number = self.first_cycle + cycle_index
            events = events_of_cycle(cycle_number)
            strokes: list[PlacedStroke] = []
            for event, level in zip(events, _levels_of_events(events, levels), strict=True):
                begin_share, span_share, length_share, struck_word = event
                stroke_beat, duration = (
                    cycle_begin + begin_share * (cycle_end - cycle_begin),
                    length_share * (cycle_end - cycle_begin),
                )
                strokes += _placed_strokes(
                    tempo,
                    stroke_beat,
                    span_share * (cycle_end - cycle_begin),
                    duration,
                    struck_word,
                    level,
                )
                if len(strokes) > MAX_EVENTS:
                    raise TextError(_TOO_MANY_MESSAGE)
            strokes.sort(key=_stroke_beat)
            for index, (stroke_beat, duration, struck_word, level) in enumerate(strokes):
                yield Stroke(
                    stroke_beat,
                    cycle_number * MAX_EVENTS + index,
                    key_of(struck_word),
                    level,
                    duration,
                )

    def strokes_per_cycle(self, tempo: TempoMap, begin_beat: float, draws: tuple[int, str]) -> int:
        """About how many MATs are struck in one cycle at most, from the first few cycles.

        Raises TextError.
        """
        counts = [0] * _CYCLES_SAMPLED
        for stroke in self.strokes(tempo, begin_beat, _PLAIN_LEVELS, draws, range(_CYCLES_SAMPLED)):
            cycle_index = stroke.number // MAX_EVENTS - self.first_cycle
            counts[cycle_index] += sum(len(targets) for targets, _ in self.voices[stroke.word])
        return max(counts)

    def latest_delay(self) -> tuple[int, float]:
        """How much later than in its cycle a stroke may begin: in cycles and in seconds."""
        return _latest_delay(self.text, self.do, self.tuning)


_CYCLES_SAMPLED = 8  # cycles from which the number of strokes is estimated
_PLAIN_LEVELS = Levels((MEZZO_FORTE,))
_TOO_MANY_MESSAGE = (
    f"a cycle of the rhythm would have more than {MAX_EVENTS:,} strokes; repeat them less often"
)
# A stroke's beat, how long it sounds in beats, what it strikes and how strongly.
PlacedStroke = tuple[float, float, Struck, Level]
_stroke_beat = itemgetter(0)


def _levels_of_events(cycle_events: Sequence[_CycleEvent], levels: Levels) -> Iterator[Level]:
    """The level of each event: what its word says, else one of the levels in turn.

    What is part of a stroke has the stroke's level: of the nearest with its word before or after.
    """
    main_events = [
        number for number, (*_, struck) in enumerate(cycle_events) if struck.part_of is None
    ]
    step_by_event = {event_index: step for step, event_index in enumerate(main_events)}
    events_by_word: dict[int, list[int]] = {}
    for event_index in main_events if len(main_events) < len(cycle_events) else ():
        events_by_word.setdefault(cycle_events[event_index][-1].offset, []).append(event_index)
    for event_index, (*_, struck_word) in enumerate(cycle_events):
        main_event = event_index
        if struck_word.part_of is not None:
            word_events = events_by_word.get(struck_word.offset) or main_events or [event_index]
            rank = bisect(word_events, event_index) - (struck_word.part_of == "before")
            main_event = word_events[min(max(0, rank), len(word_events) - 1)]
        level = level_of(struck_word) or levels.step(
            step_by_event.get(main_event, 0), len(main_events)
        )
        yield level.scaled(struck_word.factor) if struck_word.factor != 1.0 else level


def _placed_strokes(
    tempo: TempoMap,
    stroke_beat: float,
    stroke_span: float,
    stroke_length: float,
    struck_word: Struck,
    stroke_level: Level,
) -> Iterator[PlacedStroke]:
    """A stroke at its beat, later by its delay; or the strokes that repeat it over its span."""
    if struck_word.delay:
        stroke_beat = tempo.after(stroke_beat, Length(seconds=struck_word.delay))
    if struck_word.repeats is None:
        yield stroke_beat, stroke_length, struck_word, stroke_level
        return
    rate, first_factor, last_factor = struck_word.repeats
    start, end = tempo.seconds(stroke_beat), tempo.seconds(stroke_beat + stroke_span)
    n_repeats = max(1, ceil((end - start) * rate - _SAME_STROKE_TOLERANCE))
    if n_repeats > MAX_EVENTS:
        raise TextError(_TOO_MANY_MESSAGE)
    for repeat_index in range(n_repeats):
        repeat_beat = tempo.beats(start + repeat_index / rate) if repeat_index else stroke_beat
        repeat_end = (
            tempo.beats(start + (repeat_index + 1) / rate)
            if repeat_index + 1 < n_repeats
            else stroke_beat + stroke_span
        )
        level = stroke_level.scaled(
            swell(
                first_factor, last_factor, repeat_index / (n_repeats - 1) if n_repeats > 1 else 1.0
            )
        )
        sounding_length = float(struck_word.length) * (repeat_end - repeat_beat)
        yield (
            repeat_beat,
            sounding_length,
            struck_word,
            level if first_factor != 1.0 or last_factor != 1.0 else stroke_level,
        )


@lru_cache(256)
def _latest_delay(text: str, transforms_text: str, tuned: Tuning | None) -> tuple[int, float]:
    leaves = compiled_in_tuning(text, transforms_text, tuned).leaves
    cycles = int(LONGEST_CYCLES) if any(leaf.repeats for leaf in leaves) else 0
    return cycles, max((leaf.delay for leaf in leaves), default=0.0)


def level_of(struck: Struck) -> Level | None:
    """The level that a word says itself, after a colon. Raises TextError."""
    _, colon, text = struck.word.partition(":")
    return LEVEL.parse(text) if colon else None  # the parser keeps its results


def compiled_rhythm(rhythm_text: str, transforms_text: str) -> Cycles[Struck]:
    """The cycles of a text after its transformations, in the tuning of the file that is read.

    Raises TextError, with offsets into the text, or into the transformations once the text itself
    has been read.
    """
    return compiled_in_tuning(rhythm_text, transforms_text, tuning.written())


@lru_cache(_RHYTHMS_CACHED)
def compiled_in_tuning(
    rhythm_text: str, transforms_text: str, tuned: Tuning | None
) -> Cycles[Struck]:
    """The cycles of a text after its transformations, in a tuning. Raises TextError."""
    line_begins = line_offsets(rhythm_text)

    def read(word: str, offset: int) -> Struck:
        return Struck(word, offset, line=bisect(line_begins, offset) - 1)

    cycles = parse(rhythm_text, read)
    with tuning.used(tuned):
        return apply(cycles, parse_transforms(transforms_text)) if transforms_text else cycles


@lru_cache(_RHYTHMS_CACHED)
def _cycle_events(
    rhythm_text: str, transforms_text: str, tuned: Tuning | None, seed: int, owner: str
) -> Callable[[int], list[_CycleEvent]]:
    """The events of a cycle by its number; those that were asked for are remembered."""
    cycles, chance = (
        compiled_in_tuning(rhythm_text, transforms_text, tuned),
        chance_from(seed, owner),
    )
    events_by_cycle: dict[int, list[_CycleEvent]] = {}

    def events(cycle_number: int) -> list[_CycleEvent]:
        if cycle_number not in events_by_cycle:
            with tuning.used(tuned):
                onsets = cycles.onsets(cycle_number, chance)
            events_by_cycle[cycle_number] = [
                (
                    float(event.begin - cycle_number),
                    min(float(event.end - event.begin), LONGEST_CYCLES),
                    min(float((event.end - event.begin) * event.value.length), LONGEST_CYCLES),
                    event.value,
                )
                for event in onsets
            ]
        return events_by_cycle[cycle_number]

    return events


def retargeted(rhythm: Rhythm, move_target: Callable[[Target], Target]) -> Rhythm:
    """A rhythm with each of its targets changed."""
    voices = {
        key: tuple(
            (tuple(map(move_target, targets)), impulse_range) for targets, impulse_range in voice
        )
        for key, voice in rhythm.voices.items()
    }
    return replace(rhythm, voices=voices)


def words_of(text: str) -> list[str]:
    """The names in a text that may be a rhythm, without levels, and without notes."""
    names = (word.partition(":")[0] for word in WORD.findall(text))
    return [name for name in names if note_of(name) is None]


def renamed(rhythm: Rhythm, rename: Callable[[str], str]) -> Rhythm:
    """A rhythm in whose text each name of a part is changed."""

    def renamed_word(word: str) -> str:
        plain_word, colon, level = word.partition(":")
        return word if note_of(plain_word) else f"{rename(plain_word)}{colon}{level}"

    text = WORD.sub(lambda match: renamed_word(match[0]), rhythm.text)
    voices = {renamed_word(key): voice for key, voice in rhythm.voices.items()}
    return replace(rhythm, text=text, voices=voices)


def checked_text(rhythm_text: str) -> str:
    """The text itself, if it is a rhythm and its words say levels as they should.

    Raises TextError.
    """
    for struck_leaf in compiled_rhythm(rhythm_text, "").leaves:
        try:
            notes_of(name_of(struck_leaf))
        except TextError as error:
            error.offset += struck_leaf.offset
            raise
        try:
            level_of(struck_leaf)
        except TextError as error:
            error.offset += struck_leaf.offset + struck_leaf.word.index(":") + 1
            raise
    return rhythm_text


RHYTHM_SHAPE = Text(
    checked_text, "a rhythm, such as kick ~ snare ~", types=("string",), meanings=MEANINGS
)
