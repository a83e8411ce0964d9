"""Text to SI numbers, pitches to hertz: `400g`, `60N/m`, `A3`, `20Hz..10kHz`, `-6dB`, `1/8`.

Every unit is a power of ten, so a number with its unit is one decimal literal, and the result is
the float nearest to what is written: `1mm` is 0.001, not 1 · 0.001.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from ergon import _core
from ergon.notation.tables import tuning
from ergon.notation.text.errors import TextError, quote, with_article
from ergon.notation.text.numbers import clock_time
from ergon.notation.text.spelling import nearest
from ergon.notation.text.typeset import plain, typeset_character

MAX_TEXT = 64  # characters of one quantity
_LN_10 = 2.302585092994046
MAX_SIZE = 1e18  # beyond every quantity of a key, a gong or a rate; far from overflow when squared

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eE]([+-]?\d{1,4}))?")
_FRACTION = re.compile(r"([+-]?\d{1,15})/(\d{1,15})")
_FOREIGN_NOTE = re.compile(r"([A-Ha-h])(is|es|s|[#♯b♭])?(-?\d)([#♯b♭])?")
_SYLLABLES = {"do": "C", "ut": "C", "re": "D", "ré": "D", "mi": "E", "fa": "F", "sol": "G"}
_SYLLABLES |= {"la": "A", "si": "B", "ti": "B"}
_RESTS = ("r", "rest", "pause", "~", "_")
_CHORD = re.compile(r"([A-Ga-g])([#b♯♭]?)(maj7?|min7?|m7b5|m7?|dim7?|aug|sus2|sus4|°)")
_LILYPOND = re.compile(r"([A-Ga-g])(is|es|s|#|b|)('+|,+)\d*\.*")
_SOLFEGE = re.compile(rf"({'|'.join(_SYLLABLES)})([#♯b♭]?)(-?\d)?", re.IGNORECASE)
_FOREIGN_SIGNS = {"is": "#", "es": "b", "s": "b"}
_SHARP_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_NOTE_NUMBER_MAX = 127

Sign = Literal["any", "positive", "not negative"]


@dataclass(frozen=True, slots=True)
class Dimension:
    """What a quantity measures: its units as powers of ten of the SI unit, and its bounds."""

    name: str
    units: Mapping[str, int]
    example: str
    sign: Sign = "any"
    takes_bare_number: bool = True  # whether a number without a unit is taken as SI
    low: float = -MAX_SIZE
    high: float = MAX_SIZE

    @property
    def si(self) -> str:
        """The unit in which values and bounds are kept; "" for plain numbers."""
        return next((unit for unit, power in self.units.items() if power == 0), "")


def _dimension(
    dimension_name: str,
    unit_names: str,
    example: str,
    value_sign: Sign = "any",
    *,
    takes_bare_number: bool = True,
    low_bound: float = -MAX_SIZE,
    high_bound: float = MAX_SIZE,
) -> Dimension:
    powers_by_unit = {}
    for word in unit_names.split():
        unit, _, power = word.partition(":")
        powers_by_unit[unit] = int(power or 0)
    return Dimension(
        dimension_name,
        powers_by_unit,
        example,
        value_sign,
        takes_bare_number,
        low_bound,
        high_bound,
    )


_LENGTH_UNITS = "mm:-3 cm:-2 m um:-6 µm:-6 μm:-6"
_HARDENING = "N/m3 N/mm3:9 kN/m3:3 MN/m3:6"
MASS = _dimension("mass", "kg g:-3 mg:-6", "400g", "positive", takes_bare_number=False)
MASS_OR_NUMBER = _dimension("mass", "kg g:-3 mg:-6", "400g", "positive")  # for `units: ca`
STIFFNESS = _dimension("stiffness", "N/m kN/m:3 N/mm:3 mN/m:-3", "60N/m", "not negative")
DAMPING = _dimension("viscosity", "Ns/m mNs/m:-3", "1.2Ns/m", "not negative")
POSITION = _dimension("length", _LENGTH_UNITS, "1mm", high_bound=1e3, low_bound=-1e3)
SIZE = _dimension("length", _LENGTH_UNITS, "0.5mm", "positive", high_bound=1e3)
SPAN = _dimension("length", _LENGTH_UNITS, "5mm", "not negative", high_bound=1e3)
DISTANCE = _dimension("distance", _LENGTH_UNITS, "2m", "positive", low_bound=0.01, high_bound=100.0)
ROOM_SIZE = _dimension(
    "size of a room", _LENGTH_UNITS, "10m", "positive", low_bound=0.5, high_bound=100.0
)
AZIMUTH = _dimension("azimuth", "deg", "30deg", low_bound=-360.0, high_bound=360.0)
ELEVATION = _dimension("elevation", "deg", "35deg", low_bound=-90.0, high_bound=90.0)
PAN = _dimension(
    "place from -1 (first channel) to 1 (second)", "", "-0.3", low_bound=-1.0, high_bound=1.0
)
DENSITY = _dimension("density", "kg/m3 g/cm3:3", "7850kg/m3", "positive", takes_bare_number=False)
SURFACE_TENSION = _dimension(
    "tension of a membrane", "N/m kN/m:3", "3kN/m", "positive", takes_bare_number=False
)
PRESSURE = _dimension(
    "pressure", "Pa kPa:3 MPa:6 GPa:9", "200GPa", "positive", takes_bare_number=False
)
INHARMONICITY = _dimension("inharmonicity", "", "0.0003", "not negative", high_bound=0.1)
POISSON = _dimension("Poisson's ratio", "", "0.33", "not negative", high_bound=0.5)
SPEED = _dimension("speed", "m/s mm/s:-3", "0.5m/s", high_bound=1e6, low_bound=-1e6)
GRAVITY = _dimension("acceleration", "m/s2 m/s²", "9.81m/s2", high_bound=1e5, low_bound=-1e5)
PUSH = _dimension("force", "N mN:-3 kN:3", "-5N")
FORCE = _dimension("force", "N mN:-3 kN:3", "5N", "positive")
# Of an input of a sound card: full scale is so much, and no more than so much acts.
INPUT_FORCE = _dimension(
    "force", "N kN:3 mN:-3 uN:-6 µN:-6 μN:-6", "2mN", low_bound=-1e3, high_bound=1e3
)
INPUT_LENGTH = _dimension("length", _LENGTH_UNITS, "0.1mm", low_bound=-1.0, high_bound=1.0)
IMPULSE = _dimension("impulse", "Ns mNs:-3 uNs:-6 µNs:-6 μNs:-6", "2uNs", takes_bare_number=False)
POLES = _dimension(
    "force times the square of a distance", "Nm2 Ncm2:-4 Nmm2:-6 mNmm2:-9", "200Nmm2"
)
HARDENING = _dimension("hardening", _HARDENING, "4e8N/m3", "not negative")
FREQUENCY = _dimension("frequency", "Hz kHz:3", "220Hz", "positive", high_bound=1e6)
RATE = _dimension("rate", "Hz kHz:3", "44100Hz", "positive", low_bound=1e3, high_bound=2e6)
TICK_RATE = _dimension(
    "rate of ticks", "Hz kHz:3", "1kHz", "positive", low_bound=1.0, high_bound=1e5
)
DURATION = _dimension(
    "time in seconds", "s ms:-3 us:-6 µs:-6 μs:-6", "2.5s", "positive", takes_bare_number=False
)
INSTANT = _dimension(
    "time in seconds", "s ms:-3 us:-6 µs:-6 μs:-6", "0.4s", "not negative", takes_bare_number=False
)
CONTACT_TIME = _dimension(
    "time in seconds",
    "s ms:-3 us:-6 µs:-6 μs:-6",
    "2ms",
    "not negative",
    takes_bare_number=False,
    high_bound=0.05,
)
# The highest level that a session takes, from a line or from the network: a slip of the finger must
# not hurt the ears [dB].
LOUDEST_DB = 24.0
LOUDNESS = _dimension(
    "loudness", "LUFS", "-31LUFS", takes_bare_number=False, low_bound=-150.0, high_bound=60.0
)
LEVEL = _dimension(
    "level", "dB", "-6dB", takes_bare_number=False, low_bound=-400.0, high_bound=200.0
)
ERROR = _dimension(
    "error", "dB", "-60dB", takes_bare_number=False, low_bound=-160.0, high_bound=-10.0
)
CENTS = _dimension(
    "error of pitch in cents", "", "3", "positive", low_bound=0.01, high_bound=1200.0
)
CHANCE = _dimension("chance", "%:-2", "0.6", "not negative", high_bound=1.0)
SHARE = _dimension(
    "share of the processor", "%:-2", "80%", "positive", takes_bare_number=False, high_bound=64.0
)
NUMBER = _dimension("plain number", "", "0.5")
RATIO = _dimension("plain number", "", "0.5", "not negative")
FACTOR = _dimension("number", "", "1.5", "positive")
FRICTION = _dimension("coefficient of friction", "", "0.4", "not negative", high_bound=10.0)
EXPONENT = _dimension("exponent", "", "1.5", low_bound=1.0, high_bound=16.0)
RADIUS = _dimension("radius", "", "0.3", "not negative", high_bound=10.0)
PATH_AZIMUTH = _dimension("angle", "deg", "1080deg", low_bound=-36000.0, high_bound=36000.0)
WIDTH = _dimension("width", "", "0.06", "positive", low_bound=0.001, high_bound=4.0)
HOLE = _dimension("radius of a hole", "", "0.3", "positive", low_bound=0.01, high_bound=1.0)
UNIT_RATIO = _dimension("number from 0 to 1", "", "0.5", "not negative", high_bound=1.0)

# A constant of a law may have any of these; what it must measure depends on the law's text.
_LAW_UNITS = (
    f"{_HARDENING} N/m2 N/m N/mm:3 kN/m:3 Ns/m mNs/m:-3 Ns2/m2 N mN:-3 kN:3 m/s mm/s:-3 "
    f"{_LENGTH_UNITS} "
    "s/m Ns/m2 Ns/m3 s ms:-3"
)
CONSTANT = _dimension("constant of a law", _LAW_UNITS, "900N/m")

_PREFIXES = "GMkcmuµμnp"
# Units spelled as words; a plural s is removed before the look-up.
_SPOKEN = {
    "sec": "s", "second": "s", "msec": "ms", "millisecond": "ms", "usec": "us", "microsecond": "us",
    "hertz": "Hz", "kilohertz": "kHz", "decibel": "dB", "db": "dB", "degree": "deg", "°": "deg",
    "gram": "g", "kilogram": "kg", "kilo": "kg", "milligram": "mg",
    "metre": "m", "meter": "m", "millimetre": "mm", "millimeter": "mm", "centimetre": "cm",
    "centimeter": "cm", "newton": "N", "pascal": "Pa", "percent": "%",
}  # fmt: skip

_ALL_UNITS = tuple(
    (unit, d.name)
    for d in (
        *(MASS, STIFFNESS, DAMPING, POSITION, SPEED, FORCE, IMPULSE, FREQUENCY, DURATION, LEVEL),
        PRESSURE,
        DENSITY,
    )
    for unit in d.units
)


def full_scale(scale_text: str) -> tuple[float, bool]:
    """Read the value of full scale of an input [N or m], and whether it is a force.

    Raises TextError if the unit is neither of force nor of length, or if the value is 0.
    """
    scale_word = scale_text.strip()
    is_force = scale_word.endswith("N")
    if not is_force and not scale_word.endswith("m"):
        raise TextError(
            f"{quote(scale_word)} must have a unit of force or length, such as 2mN or 0.1mm"
        )
    scale_value = quantity(scale_text, INPUT_FORCE if is_force else INPUT_LENGTH)
    if scale_value == 0.0:
        raise TextError("full scale must not be 0")
    return scale_value, is_force


def quantity(text: str, dimension: Dimension) -> float:
    """The SI value of a number with a unit. Raises TextError: E201, E202 or E203."""
    quantity_word = _trimmed(text)
    number_match = _FRACTION.match(quantity_word) or _NUMBER.match(quantity_word)
    if number_match is None:
        raise _not_a_number(quantity_word, dimension)
    unit = quantity_word[number_match.end() :].strip()
    power_of_ten = _power(unit, quantity_word, len(quantity_word) - len(unit), dimension)
    if number_match.re is _FRACTION:
        if int(number_match[2]) == 0:
            raise TextError("the number divides by zero", length=len(quantity_word), code="E202")
        number_value = float(
            Fraction(int(number_match[1]), int(number_match[2])) * Fraction(10) ** power_of_ten
        )
    else:
        number_value = float(f"{number_match[1]}e{int(number_match[2] or 0) + power_of_ten}")
    return bounded(number_value, quantity_word, dimension)


def bounded(si_value: float, quantity_word: str, dimension: Dimension) -> float:
    """The value when it lies within the dimension's bounds. Raises TextError E202."""
    refusal = ""
    if not math.isfinite(si_value) or abs(si_value) > MAX_SIZE:
        refusal = f"too large; the maximum is {min(dimension.high, MAX_SIZE):g}{dimension.si}"
    elif dimension.sign == "positive" and si_value <= 0:
        refusal = f"not positive; write a positive {dimension.name}, such as {dimension.example}"
    elif dimension.sign == "not negative" and si_value < 0:
        refusal = f"negative; write 0 or a positive {dimension.name}, such as {dimension.example}"
    elif si_value < dimension.low:
        refusal = f"below the minimum of {dimension.low:g}{dimension.si}"
    elif si_value > dimension.high:
        refusal = f"above the maximum of {dimension.high:g}{dimension.si}"
    if refusal:
        raise TextError(
            f"{quote(quantity_word)} is {refusal}", length=len(quantity_word), code="E202"
        )
    return si_value


def _power(unit_text: str, quantity_word: str, unit_offset: int, dimension: Dimension) -> int:
    power = dimension.units.get(unit_text)
    if power is not None:
        return power
    unit_list = ", ".join(unit for unit in dimension.units if unit.isascii())
    fault_length = len(quantity_word)
    if not unit_text:
        if dimension.takes_bare_number or not quantity_word.strip("+-0."):
            return 0
        example_unit = dimension.example.lstrip("+-.0123456789")
        foreign_unit = next(
            (name for name in (dimension.si, *dimension.units) if name != example_unit), ""
        )
        suggestion_words = (
            f"; it could be {quantity_word}{example_unit} or {quantity_word}{foreign_unit}"
            if foreign_unit
            else ""
        )
        message = f"{quote(quantity_word)} has no unit (use {unit_list}){suggestion_words}"
        raise TextError(
            message, length=fault_length, suggestion=quantity_word + example_unit, code="E203"
        )
    fault_length = len(unit_text)
    if unit_text[0] in ":_," or unit_text[0].isdigit():
        raise _not_a_number(quantity_word, dimension)
    if not unit_list:
        message = f"{with_article(dimension.name)} has no unit; remove {quote(unit_text)}"
        raise TextError(message, offset=unit_offset, length=fault_length, code="E203")
    measured_dimension = next((name for unit, name in _ALL_UNITS if unit == unit_text), None)
    if measured_dimension is None:
        likely_unit = _likely_unit(unit_text, dimension)
        message = (
            f"unknown unit {quote(unit_text)} ({with_article(dimension.name)} has {unit_list})"
        )
        raise TextError(
            message, offset=unit_offset, length=fault_length, suggestion=likely_unit, code="E203"
        )
    message = f"unit {quote(unit_text)} does not measure {dimension.name} (use {unit_list})"
    raise TextError(message, offset=unit_offset, length=fault_length, code="E203")


def _likely_unit(unit_text: str, dimension: Dimension) -> str | None:
    """The unit that was most likely meant; None if `unit_text` is a valid unit with a prefix that
    this dimension does not have.
    """
    spoken_unit = _SPOKEN.get(unit_text.lower()) or _SPOKEN.get(unit_text.lower().removesuffix("s"))
    if spoken_unit in dimension.units:
        return spoken_unit
    is_multiple = unit_text[0] in _PREFIXES and unit_text[1:] in dimension.units
    return None if is_multiple else nearest(unit_text, dimension.units)


def _trimmed(text: str) -> str:
    word = text.strip()
    if not word:
        raise TextError(
            "no value is written here; write a number, with its unit where it has one", code="E201"
        )
    if len(word) > MAX_TEXT:
        raise TextError(
            f"{quote(word)} has more than {MAX_TEXT} characters; a value is shorter",
            length=MAX_TEXT,
            code="E201",
        )
    if (character := typeset_character(word)) is not None:
        message = f"{quote(word)} has {character}"
        raise TextError(message, length=len(word), suggestion=plain(word), code="E201")
    if not word.replace("µ", "u").replace("μ", "u").replace("♯", "#").replace("♭", "b").isascii():
        message = f"{quote(word)} has a character that no number and no unit has"
        raise TextError(message, length=len(word), code="E201")
    return word


def _not_a_number(quantity_word: str, dimension: Dimension) -> TextError:
    noun = with_article(dimension.name)
    message = f"{quote(quantity_word)} is not a number; {noun} is written like {dimension.example}"
    suggestion = None
    if (seconds := clock_time(quantity_word)) is not None:
        message = f"{quote(quantity_word)} is a clock time; write it in seconds"
        suggestion = seconds
    elif re.fullmatch(r"[+-]?[\d_,]+\D*", quantity_word) and (
        "_" in quantity_word or "," in quantity_word
    ):
        message = (
            f"{quote(quantity_word)}: write digits without '_' and ',', and '.' as the decimal "
            "point"
        )
        suggestion = _plain_digits(quantity_word)
    elif re.fullmatch(r"[+-]?\.?(nan|inf|infinity)", quantity_word, re.IGNORECASE):
        message = f"{quote(quantity_word)} is not a finite number"
    return TextError(message, length=len(quantity_word), suggestion=suggestion, code="E201")


def _plain_digits(word: str) -> str:
    """`4,5s` is 4.5s; `1,000` and `1_000` are 1000."""
    decimal = re.fullmatch(r"([+-]?\d+),(\d{1,2}|\d{4,})(\D.*)?", word)
    return word.replace(",", ".") if decimal else re.sub("[_,]", "", word)


def frequency(pitch_text: str, dimension: Dimension = FREQUENCY) -> float:
    """A frequency [Hz], or a note of the tuning of the file that is read: `A3`, `C#4`,
    `A3+20cents`; with a tuning also a ratio above its root: `3/2`.
    """
    pitch_word = _trimmed(pitch_text)
    written_tuning = tuning.written()
    pitch_name = tuning.spelled(pitch_word)
    if written_tuning is None and _FRACTION.fullmatch(pitch_word):
        pitch_name = pitch_word  # hertz, as ever
    hertz = (written_tuning or tuning.PLAIN).hertz(pitch_name)
    if hertz is not None and not pitch_name.endswith("Hz"):
        return bounded(hertz, pitch_word, dimension)
    if hertz is None and pitch_word[:1].isalpha():
        message = (
            f"{quote(pitch_word)} is neither a frequency such as 220Hz nor a note such as A3 or Bb2"
        )
        raise note_slip(pitch_word) or TextError(message, length=len(pitch_word), code="E201")
    if hertz is None:
        _check_pitch(pitch_word)
    return quantity(pitch_word.replace("_", ".") if hertz is not None else pitch_text, dimension)


def note_slip(note_word: str) -> TextError | None:
    """What is wrong with a word that means a note, a chord or a rest: solfège, a letter without an
    octave, a spelling of another program; None if it means none.
    """
    if note_word.lower() in _RESTS:
        message = (
            f"{quote(note_word)} is a rest, which is not written among entries: each entry stands "
        )
        return TextError(
            f"{message}at its time; in a rhythm a rest is ~", length=len(note_word), code="E201"
        )
    if (chord_match := _CHORD.fullmatch(note_word)) is not None:
        root = f"{chord_match[1].upper()}{chord_match[2]}"
        message = (
            f"{quote(note_word)} is the name of a chord; write its notes, each with an octave, "
            "such "
        )
        return TextError(
            f"{message}as {root}4 and those above it", length=len(note_word), code="E201"
        )
    if (lilypond_match := _LILYPOND.fullmatch(note_word)) is not None:
        octave = 3 + lilypond_match[3].count("'") - lilypond_match[3].count(",")
        accidental = _FOREIGN_SIGNS.get(lilypond_match[2], lilypond_match[2])
        name = f"{lilypond_match[1].upper()}{accidental}{octave}"
        message = (
            f"{quote(note_word)} counts octaves by ticks, and a score by numbers: C4 is middle C"
        )
        return TextError(message, length=len(note_word), suggestion=name, code="E201")
    suggestion = _respelled(note_word)
    solfege_match = _SOLFEGE.fullmatch(note_word)
    note_letter = None if solfege_match is None else _SYLLABLES[solfege_match[1].lower()]
    if solfege_match is not None and solfege_match[3]:
        accidental, octave = (
            _FOREIGN_SIGNS.get(solfege_match[2].lower(), solfege_match[2]),
            int(solfege_match[3]),
        )
        suggestion = f"{note_letter}{accidental}{octave}"
        message = (
            f"{quote(note_word)} is solfège, and notes are written by letters: {suggestion}, or "
            f"{note_letter}{accidental}{octave + 1} where octaves are counted as in France "
            "(la3 is A4, "
            "440 Hz)"
        )
    elif solfege_match is not None or re.fullmatch(r"[A-Ga-g](##|bb|[#b♯♭])?", note_word):
        name = (
            f"{note_word[0].upper()}{note_word[1:]}"
            if note_letter is None or solfege_match is None
            else note_letter + solfege_match[2]
        )
        suggestion = f"{name}4"
        message = (
            f"{quote(note_word)} has no octave: write {name}3, {name}4 or another one; "
            "C4 is middle C, "
            "A4 has 440 Hz"
        )
    elif suggestion is not None:
        message = (
            f"{quote(note_word)} is neither a frequency such as 220Hz nor a note such as A3 or Bb2"
        )
    else:
        return None
    return TextError(message, length=len(note_word), suggestion=suggestion, code="E201")


def _check_pitch(pitch_word: str) -> None:
    """Refuse a number that could be that of a note of MIDI. Raises TextError E203."""
    if pitch_word.isdigit() and 0 < int(pitch_word[:4]) <= _NOTE_NUMBER_MAX:
        octave, step = divmod(int(pitch_word), 12)
        name = f"{_SHARP_NAMES[step]}{octave - 1}"
        message = (
            f"{quote(pitch_word)} has no unit; it could be {pitch_word}Hz, or the note {name}, "
            "which is "
        )
        message += f"number {pitch_word} of MIDI"
        raise TextError(message, length=len(pitch_word), code="E203")


def _respelled(note_word: str) -> str | None:
    """A note written in German, in small letters or with the accidental last, respelled in this
    notation.
    """
    match = _FOREIGN_NOTE.fullmatch(note_word)
    if match is None:
        return None
    letter, sign_before_octave, octave, sign_after_octave = match.groups()
    accidental = (sign_before_octave or sign_after_octave or "").lower()
    if sign_before_octave and sign_after_octave:
        return None
    letter = letter.upper()
    return f"{'B' if letter == 'H' else letter}{_FOREIGN_SIGNS.get(accidental, accidental)}{octave}"


Read = Callable[[str], float]


def span(span_text: str, read_end: Read, example: str) -> tuple[float, float]:
    """`low..high`, each read by `read_end`; a bare number takes the other's unit."""
    low_text, dots, high_text = span_text.strip().partition("..")
    if not dots:
        message = f"{quote(span_text.strip())} is not a range such as {example}"
        raise TextError(message, length=len(span_text.strip()), code="E201")
    low_text, high_text = low_text.strip(), high_text.strip()
    if _NUMBER.fullmatch(low_text) and (unit := _unit_of(high_text)):
        low_text += unit
    elif _NUMBER.fullmatch(high_text) and (unit := _unit_of(low_text)):
        high_text += unit
    low = read_end(low_text)
    try:
        high = read_end(high_text)
    except TextError as error:
        error.offset += span_text.index("..") + 2
        raise
    if low > high:
        message = f"the range {quote(span_text.strip())} runs downwards; write the lower end first"
        raise TextError(
            message, length=len(span_text), suggestion=f"{high_text}..{low_text}", code="E202"
        )
    return low, high


def _unit_of(word: str) -> str:
    match = _NUMBER.match(word)
    return word[match.end() :].strip() if match else ""


def ratio_of(decibels: float) -> float:
    """The ratio of amplitudes of a level [dB]."""
    return _core.decibels(decibels)


def decibels_of(ratio: float) -> float:
    """The level of an amplitude ratio above 0 [dB]."""
    return 20.0 * _core.ln(ratio) / _LN_10


def gain(gain_text: str) -> float:
    """A ratio of amplitudes from a level (`-6dB`) or a factor (`x0.5`)."""
    word = gain_text.strip()
    if word.startswith("x"):
        return factor(gain_text)
    if _NUMBER.fullmatch(word):
        factor_words = "" if word.startswith("-") else f"x{word} for a factor, or "
        message = f"{quote(word)} has no unit; write {factor_words}{word}dB for a level"
        suggestion = f"x{word}" if factor_words else f"{word}dB"
        raise TextError(message, length=len(word), suggestion=suggestion, code="E203")
    if _NUMBER.fullmatch(percentage := word.removesuffix("%").rstrip()) and percentage != word:
        factor_text = f"x{float(percentage) / 100.0:g}"
        message = (
            f"{quote(word)} is a percentage; write {factor_text} for a factor, or a level in dB"
        )
        raise TextError(message, length=len(word), suggestion=factor_text, code="E203")
    return _core.decibels(quantity(gain_text, LEVEL))


def factor(text: str) -> float:
    """`x1.5`: a factor that is not negative."""
    factor_word = text.strip()
    if not factor_word.startswith("x"):
        message = f"{quote(factor_word)} is not a factor such as x1.5"
        raise TextError(message, length=len(factor_word), code="E201")
    try:
        return quantity(factor_word[1:], RATIO)
    except TextError as error:
        error.offset += 1
        raise


def integer(text: str, low_bound: int, high_bound: int) -> int:
    """A whole number within bounds; `1e4` is accepted."""
    word = _trimmed(text)
    if re.fullmatch(r"[+-]?\d{1,30}", word):  # not through a float: seeds have 64 bits
        integer_value = int(word)
    elif (number := quantity(word, NUMBER)) == int(number):
        integer_value = int(number)
    else:
        raise TextError(f"{quote(word)} is not a whole number", length=len(word), code="E201")
    if not low_bound <= integer_value <= high_bound:
        message = f"{quote(word)} lies outside the range from {low_bound:,} to {high_bound:,}"
        raise TextError(message, length=len(word), code="E202")
    return integer_value


def level_between(low: float, high: float, share: float) -> float:
    """The ratio of amplitudes on a share (0 to 1) of the way in dB between two ratios above 0."""
    return low * _core.pow(high / low, share)
