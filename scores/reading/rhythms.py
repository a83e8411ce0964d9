"""Strikes by a rhythm text: what its words strike, and what falls in each cycle."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf

from ergon.instruments.model import Target
from ergon.notation.clock.meter import SAME
from ergon.notation.clock.positions import Length
from ergon.notation.clock.tempo import TempoMap
from ergon.notation.tables import notes
from ergon.notation.tables.shapes import Text
from ergon.notation.tables.strengths import LEVEL, Level, Levels, Reach
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.scores.pattern.cycle_transforms import apply, parse_transforms
from ergon.scores.pattern.cycles import MAX_EVENTS, Cycles, chance_from
from ergon.scores.pattern.rhythm_text import WORD, Struck, parse

HERE = "x"  # the word for what `to` names
LONGEST_CYCLES = 8.0  # of a note: one that lasts longer is looked for no farther back
MAX_CYCLES = 200_000  # of one rhythm: a bar of a second for more than two days
_REMEMBERED = 32  # rhythms whose cycles are remembered: a thousand bars of each take 1.5 MB

# Where in its cycle an event begins, how many cycles it lasts, and its word.
_CycleEvent = tuple[float, float, Struck]

# What a word strikes, for each reach: a strength means another impulse on each instrument.
Voice = tuple[tuple[tuple[Target, ...], Reach | None], ...]


@dataclass(frozen=True, slots=True)
class Stroke:
    """A stroke of a rhythm: its beat, its number among all, its word, how strongly, how long."""

    beat: float
    number: int
    word: str
    level: Level
    lasting: float  # in beats


@dataclass(frozen=True, slots=True)
class Rhythm:
    """A text that is one `cycle`, its transformations, and what each of its words strikes."""

    text: str
    do: str
    cycle: Length
    voices: Mapping[str, Voice]
    first: int = 0  # the number of the cycle that is played first

    def begin(self, tempo: TempoMap, at: float, number: int) -> float:
        """The beat on which a cycle begins, of a rhythm that begins at a beat."""
        return tempo.after(at, self.cycle.times(number))

    def count(self, tempo: TempoMap, at: float, before: float) -> int:
        """The number of cycles that begin before a beat."""
        if before == inf:
            return MAX_CYCLES
        low, high = 0, 1
        while high < MAX_CYCLES and self.begin(tempo, at, high) < before - SAME:
            low, high = high, 2 * high
        high = min(high, MAX_CYCLES)
        if self.begin(tempo, at, low) >= before - SAME:
            return low
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (
                (middle, high) if self.begin(tempo, at, middle) < before - SAME else (low, middle)
            )
        return high

    def strokes(
        self,
        tempo: TempoMap,
        at: float,
        levels: Levels,
        draws: tuple[int, str],
        cycles: range,
    ) -> Iterator[Stroke]:
        """The strokes of some cycles, in order; `draws` are the seed and who plays."""
        source = _cycles_of(self.text, self.do, *draws)
        for turn in cycles:
            begin, end = (self.begin(tempo, at, n) for n in (turn, turn + 1))
            number = self.first + turn
            events = source(number)
            for index, (share, lasting, struck) in enumerate(events):
                loud = level_of(struck) or levels.step(index, len(events))
                loud = loud.scaled(struck.factor) if struck.factor != 1.0 else loud
                beat = begin + share * (end - begin)
                long = lasting * (end - begin)
                yield Stroke(beat, number * MAX_EVENTS + index, key_of(struck), loud, long)

    def strokes_per_cycle(self, draws: tuple[int, str]) -> int:
        """About how many MATs are struck in one cycle at most, from the first few cycles."""
        source = _cycles_of(self.text, self.do, *draws)
        return max(
            sum(sum(len(to) for to, _ in self.voices[key_of(struck)]) for *_, struck in events)
            for events in map(source, range(_TRIED))
        )


_TRIED = 8  # cycles from which the number of strokes is estimated


def name_of(struck: Struck) -> str:
    """The name or note of a word, without its level: `kick` of `kick:f`."""
    return struck.word.partition(":")[0]


def level_of(struck: Struck) -> Level | None:
    """The level that a word says itself, after a colon. Raises TextError."""
    _, colon, text = struck.word.partition(":")
    return LEVEL.parse(text) if colon else None  # it remembers what it has read


def key_of(struck: Struck) -> str:
    """What a stroke strikes, as a text: its word, and by how many semitones it is moved."""
    return f"{name_of(struck)}{struck.semitones:+d}" if struck.semitones else name_of(struck)


@lru_cache(_REMEMBERED)
def compiled(text: str, do: str) -> Cycles[Struck]:
    """The cycles of a text after its transformations. Raises TextError, with offsets into the
    text, or into the transformations once the text itself has been read.
    """
    cycles = parse(text, Struck)
    return apply(cycles, parse_transforms(do)) if do else cycles


@lru_cache(_REMEMBERED)
def _cycles_of(text: str, do: str, seed: int, who: str) -> Callable[[int], list[_CycleEvent]]:
    """The events of a cycle by its number; those that were asked for are remembered."""
    cycles, chance = compiled(text, do), chance_from(seed, who)
    known: dict[int, list[_CycleEvent]] = {}

    def events(number: int) -> list[_CycleEvent]:
        if number not in known:
            known[number] = [
                (
                    float(event.begin - number),
                    min(float(event.end - event.begin), LONGEST_CYCLES),
                    event.what,
                )
                for event in cycles.onsets(number, chance)
            ]
        return known[number]

    return events


def retargeted(rhythm: Rhythm, target: Callable[[Target], Target]) -> Rhythm:
    """A rhythm with each of its targets changed."""
    voices = {
        key: tuple((tuple(map(target, to)), reach) for to, reach in voice)
        for key, voice in rhythm.voices.items()
    }
    return replace(rhythm, voices=voices)


def words_of(text: str) -> list[str]:
    """The names in a text that may be a rhythm, without notes."""
    return [word for word in WORD.findall(text) if note_of(word) is None]


def renamed(rhythm: Rhythm, name: Callable[[str], str]) -> Rhythm:
    """A rhythm in whose text each name of a part is changed."""

    def changed(word: str) -> str:
        return word if note_of(word) else name(word)

    text = WORD.sub(lambda match: changed(match[0]), rhythm.text)
    voices = {changed(key): voice for key, voice in rhythm.voices.items()}
    return replace(rhythm, text=text, voices=voices)


def note_of(word: str) -> str | None:
    """The note that a word means, which may begin with a small letter: `c4`; None for a name."""
    note = word[:1].upper() + word[1:]
    return note if notes.number(note) is not None else None


def notes_of(word: str) -> tuple[str, ...]:
    """The notes that a word means: of `c4` one, of `c4.min7` those of a chord or a scale, all
    together; none of a name. Raises TextError for a chord that has no name.
    """
    root, dot, chord = word.partition(".")
    low = note_of(root)
    if low is None:
        return ()
    if not dot:
        return (low,)
    if chord not in notes.SCALES:
        message = f"{quote(chord)} is not the name of a chord or a scale"
        near = nearest(chord, notes.SCALES)
        raise TextError(message, offset=len(root) + 1, length=len(chord), suggestion=near)
    number = notes.number(low) or 0
    return tuple(notes.name(number + step) for step in notes.SCALES[chord])


def check_text(text: str) -> str:
    """The text itself, if it is a rhythm and its words say levels as they should.

    Raises TextError.
    """
    for struck in compiled(text, "").leaves:
        try:
            notes_of(name_of(struck))
        except TextError as error:
            error.offset += struck.offset
            raise
        try:
            level_of(struck)
        except TextError as error:
            error.offset += struck.offset + struck.word.index(":") + 1
            raise
    return text


RHYTHM = Text(check_text, "a rhythm, such as kick ~ snare ~", types=("string",))
