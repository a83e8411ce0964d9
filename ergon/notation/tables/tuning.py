"""Tunings: which frequency a note has, and how pitches are written as words.

A tuning is that of the file or the instrument that is being read (`used`). Equal temperament with
A4 = 440 Hz holds without one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fractions import Fraction

from ergon import _core
from ergon.notation.tables.octaves import octaves_of_ratio
from ergon.notation.tables.scala import KeyMap, Scale
from ergon.notation.text.errors import TextError, quote

MAX_EDO = 1_200
_MIDDLE_C = 60  # the MIDI note of C4

# Of each letter its distance from the A of its octave, in fifths and octaves: C is three fifths
# below and an octave above.
_FIFTHS_AND_OCTAVES = {
    "C": (-3, 1),
    "D": (-1, 0),
    "E": (1, -1),
    "F": (-4, 2),
    "G": (-2, 1),
    "A": (0, 0),
}
_FIFTHS_AND_OCTAVES |= {"B": (2, -1)}
_SHARP_FIFTHS_AND_OCTAVES = 7, -4  # seven fifths up, four octaves down
# Semitones of scales and chords as fifths, by which they are spelled: a minor third is C–Eb.
_FIFTHS_BY_SEMITONE = (0, -5, 2, -3, 4, -1, 6, 1, -4, 3, -2, 5)
_DIMINISHED = {6: -6}  # the fifth of a chord that also has a minor third
_AUGMENTED = {8: 8}
_LETTERS = "FCGDAEB"  # in the order of fifths

_NOTE = re.compile(r"([A-G])(##|bb|[#♯b♭]?)(-?\d)(?:([+-]\d{1,4}(?:[._]\d{1,6})?)cents?)?")
_RATIO = re.compile(r"(\d{1,15})to(\d{1,15})")
_DEGREE = re.compile(r"(-?\d{1,5})of(\d{1,4})")
_HERTZ = re.compile(r"\d{1,7}(?:_\d{1,20})?k?Hz")
_SIGNS = {"": 0, "#": 1, "♯": 1, "b": -1, "♭": -1, "##": 2, "bb": -2}
_DECIMAL = re.compile(r"(?<=\d)\.(?=\d+(?:cents?|k?Hz)(?![\w]))")
_WRITTEN_RATIO = re.compile(
    r"(?<![\w.])(\d{1,15})/(\d{1,15})(?![\w/])|(?<=\.)(\d{1,15})/(\d{1,15})(?!\w)"
)
_WRITTEN_DEGREE = re.compile(r"(?<!\w)(-?\d{1,5})\\(\d{1,4})(?!\w)")


def spelled(path: str) -> str:
    """A name as members are called: `v.A4+386_3cents` for `v.A4+386.3cents`, `3to2` for `3/2`,
    `18of31` for `18\\31`.
    """
    if not any(sign in path for sign in "./\\"):
        return path
    path = _DECIMAL.sub("_", path)
    path = _WRITTEN_RATIO.sub(lambda m: f"{m[1] or m[3]}to{m[2] or m[4]}", path)
    return _WRITTEN_DEGREE.sub(r"\1of\2", path)


def is_pitch(word: str) -> bool:
    """Whether a word is that of a pitch, as members are called by it."""
    return any(form.fullmatch(word) for form in (_NOTE, _RATIO, _DEGREE, _HERTZ))


@dataclass(frozen=True, slots=True)
class Tuning:
    """The pitches of notes: `edo` equal steps to the octave with A4 [Hz], or a scale of Scala.

    Note names are keys (C4 is 60) of a scale. With `edo` they are fifths: the fifth is the step
    nearest to 3/2, B is five fifths above C, and a sharp is seven fifths. Ratios and degrees
    count from `root`.
    """

    a4: float = 440.0
    edo: int = 12
    scale: Scale | None = None
    keys: KeyMap = field(default_factory=KeyMap)
    root: str = "C4"

    @property
    def has_keys(self) -> bool:
        """Whether neighbouring semitones are neighbouring keys, however far apart."""
        return self.scale is not None or self.edo == 12

    @property
    def is_plain(self) -> bool:
        """Whether notes are those of equal temperament with A4 = 440 Hz."""
        return self.scale is None and self.edo == 12 and self.a4 == 440.0

    def words(self) -> str:
        """The tuning in words."""
        if self.scale is None:
            tuning_text = f"{self.edo} equal steps to an octave, A4 has {self.a4:g} Hz"
        else:
            title = f" {quote(self.scale.title)}" if self.scale.title else ""
            n_degrees = len(self.scale.ratios)
            tuning_text = (
                f"a scale{title} of {n_degrees} degree{'s' if n_degrees > 1 else ''}, key "
            )
            tuning_text += f"{self.keys.reference} has {self.keys.frequency:g} Hz"
        return f"{tuning_text}, ratios count from {self.root.replace('_', '.')}"

    def hertz(self, word: str) -> float | None:
        """The frequency [Hz] of a pitch by its word; None if the word is none. Raises TextError
        for a key without a pitch.
        """
        if match := _NOTE.fullmatch(word):
            letter, signs, octave, cents = match.groups()
            return self._note_frequency(
                word, letter, _SIGNS[signs], int(octave), _number(cents or "0")
            )
        if match := _RATIO.fullmatch(word):
            numerator, denominator = int(match[1]), int(match[2])
            if not numerator or not denominator:
                raise TextError(f"{quote(word)} is not a ratio above 0", length=len(word))
            return self._root() * float(Fraction(numerator, denominator))
        if match := _DEGREE.fullmatch(word):
            degree, n_steps = int(match[1]), int(match[2])
            if not 1 <= n_steps <= MAX_EDO:
                message = f"{quote(word)}: an octave has from 1 to {MAX_EDO:,} equal steps"
                raise TextError(message, length=len(word), code="E202")
            return _frequency_of_step(self._root(), degree, n_steps)
        if _HERTZ.fullmatch(word):
            number = _number(word.removesuffix("Hz").removesuffix("k"))
            return number * 1000.0 if word.endswith("kHz") else number
        return None

    def _root(self) -> float:
        return (self.hertz(self.root) if not _RATIO.fullmatch(self.root) else None) or 0.0

    def _note_frequency(
        self, word: str, letter: str, signs: int, octave: int, cents: float
    ) -> float:
        fifths, octaves = _FIFTHS_AND_OCTAVES[letter]
        fifths, octaves = (
            fifths + signs * _SHARP_FIFTHS_AND_OCTAVES[0],
            octaves + signs * _SHARP_FIFTHS_AND_OCTAVES[1] + octave - 4,
        )
        if self.scale is not None:
            key = 69 + 7 * fifths + 12 * octaves
            hertz = self.keys.hertz(key, self.scale)
            if hertz is None:
                message = f"{quote(word)}: the key {key} has no pitch in the keyboard map"
                raise TextError(message, length=len(word), code="E201")
            return hertz * _core.pow(2.0, cents / 1200.0) if cents else hertz
        steps_per_fifth = round(self.edo * octaves_of_ratio(1.5))
        octaves, step = divmod(steps_per_fifth * fifths + self.edo * octaves, self.edo)
        if self.edo == 12:  # the cents are part of the exponent: every A is exact
            semitones = step + cents / 100
            return math.ldexp(
                self.a4 * (_core.pow(2.0, semitones / 12) if semitones else 1.0), octaves
            )
        octave_fraction = step / self.edo + cents / 1200.0
        return math.ldexp(
            self.a4 * (_core.pow(2.0, octave_fraction) if octave_fraction else 1.0), octaves
        )

    def pitch(self, word: str) -> float | None:
        """How high a pitch is in semitones, 69 at 440 Hz, to 0.001 cents; None if the word is no
        pitch. Pitches of members are the same if these are.
        """
        frequency = self.hertz(word)
        return None if frequency is None else semitones(frequency)

    def key_word(self, key: int) -> str:
        """The word of the pitch of a MIDI note: 60 is C4, others are as many steps from it."""
        if self.has_keys:
            octave, step = divmod(key, 12)
            return f"{_KEY_NAMES[step]}{octave - 1}"
        c4_hertz = self.hertz("C4") or 0.0
        return hertz_word(_frequency_of_step(c4_hertz, key - _MIDDLE_C, self.edo))

    def above(self, word: str, semitone_steps: tuple[int, ...]) -> list[str]:
        """The words of the semitones of a scale or chord above a note, spelled by fifths."""
        fifths_by_step: dict[int, int] = dict(enumerate(_FIFTHS_BY_SEMITONE))
        if 3 in semitone_steps and 7 not in semitone_steps:
            fifths_by_step |= _DIMINISHED
        if 4 in semitone_steps and 7 not in semitone_steps:
            fifths_by_step |= _AUGMENTED
        return [_moved_by_fifths(word, fifths_by_step[step % 12], step) for step in semitone_steps]

    def degrees(self, low: str, high: str) -> list[str]:
        """The words of all steps of an octave of `edo` from a note to another."""
        base_step, first_step, last_step = (
            self._step_number(word) for word in (self.root, low, high)
        )
        return [f"{step - base_step}of{self.edo}" for step in range(first_step, last_step + 1)]

    def _step_number(self, word: str) -> int:
        match = _NOTE.fullmatch(word)
        if match is None or match[4]:
            message = f"{quote(word)} is no step of {self.edo} equal ones; write a note such as C4"
            raise TextError(message, length=len(word), code="E201")
        fifths, octaves = _FIFTHS_AND_OCTAVES[match[1]]
        accidentals = _SIGNS[match[2]]
        steps_per_fifth = round(self.edo * octaves_of_ratio(1.5))
        octave = int(match[3]) - 4 + octaves + accidentals * _SHARP_FIFTHS_AND_OCTAVES[1]
        return (
            steps_per_fifth * (fifths + accidentals * _SHARP_FIFTHS_AND_OCTAVES[0])
            + self.edo * octave
        )


_KEY_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")


def _moved_by_fifths(note_word: str, fifths: int, semitone_shift: int) -> str:
    """A note moved by fifths, `semitone_shift` semitones in all."""
    match = _NOTE.fullmatch(note_word)
    assert match is not None
    letter, signs, octave = match[1], _SIGNS[match[2]], int(match[3])
    fifths_position = _LETTERS.index(letter) + 7 * signs + fifths
    signs, letter_index = divmod(fifths_position, 7)
    new_letter = _LETTERS[letter_index]
    semitone = _semitone(letter, _SIGNS[match[2]], octave) + semitone_shift
    octave = (semitone - _semitone(new_letter, signs, 0)) // 12
    if not -2 <= signs <= 2:
        message = (
            f"{quote(note_word)} has no scale that is spelled with two signs; begin it elsewhere"
        )
        raise TextError(message, length=len(note_word), code="E201")
    return f"{new_letter}{'#' * signs if signs > 0 else 'b' * -signs}{octave}"


def _semitone(letter: str, signs: int, octave: int) -> int:
    fifths, octaves = _FIFTHS_AND_OCTAVES[letter]
    return 7 * fifths + 12 * octaves + signs + 12 * octave


def _number(text: str) -> float:
    return float(text.replace("_", "."))


def _frequency_of_step(hertz: float, step: int, n_steps: int) -> float:
    octaves, step_in_octave = divmod(step, n_steps)
    return math.ldexp(
        hertz * (_core.pow(2.0, step_in_octave / n_steps) if step_in_octave else 1.0), octaves
    )


def semitones(hertz: float) -> float:
    """How high a frequency [Hz] is in semitones, 69 at 440 Hz, to 0.001 cents."""
    return round(69.0 + 12.0 * octaves_of_ratio(hertz / 440.0), 5)


def hertz_word(hertz: float) -> str:
    """The word of a frequency [Hz], to the last bit."""
    return f"{hertz:.17g}".replace(".", "_") + "Hz"


def part_at_height(parts: Mapping[float, str], height: float) -> str | None:
    """What has a pitch [semitones], within the 0.001 cents to which pitches are rounded."""
    candidates = (height, round(height + 1e-5, 5), round(height - 1e-5, 5))
    return next((parts[pitch] for pitch in candidates if pitch in parts), None)


def tuning_of_path(
    path: str, tunings: Mapping[str, Tuning], default_tuning: Tuning | None
) -> Tuning | None:
    """The tuning of the instrument to which a path leads, by `tunings` of instruments;
    `default_tuning` if it has none of its own.
    """
    words = spelled(path).split(".") if tunings else []
    prefixes = (".".join(words[:count]) for count in range(len(words), 0, -1))
    return next((tunings[prefix] for prefix in prefixes if prefix in tunings), default_tuning)


PLAIN = Tuning()
_current: ContextVar[Tuning | None] = ContextVar("tuning", default=None)


def written() -> Tuning | None:
    """The tuning of what is read, a file or an instrument; None if it names none."""
    return _current.get()


def current() -> Tuning:
    """The tuning of what is read, a file or an instrument."""
    return _current.get() or PLAIN


@contextmanager
def used(tuning: Tuning | None) -> Iterator[None]:
    """Read notes by a tuning."""
    token = _current.set(tuning)
    try:
        yield
    finally:
        _current.reset(token)
