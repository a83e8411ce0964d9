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
_STEPS = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_NOTE_NUMBER_MAX = 127

Sign = Literal["any", "positive", "not negative"]


@dataclass(frozen=True, slots=True)
class Dimension:
    """What a quantity measures: its units as powers of ten of the SI unit, and its bounds."""

    name: str
    units: Mapping[str, int]
    example: str
    sign: Sign = "any"
    bare: bool = True  # whether a number without a unit is taken as SI
    low: float = -MAX_SIZE
    high: float = MAX_SIZE

    @property
    def si(self) -> str:
        """The unit in which values and bounds are kept; "" for plain numbers."""
        return next((unit for unit, power in self.units.items() if power == 0), "")


def _dimension(
    name: str,
    units: str,
    example: str,
    sign: Sign = "any",
    *,
    bare: bool = True,
    low: float = -MAX_SIZE,
    high: float = MAX_SIZE,
) -> Dimension:
    table = {}
    for word in units.split():
        unit, _, power = word.partition(":")
        table[unit] = int(power or 0)
    return Dimension(name, table, example, sign, bare, low, high)


_LENGTH = "mm:-3 cm:-2 m um:-6 µm:-6 μm:-6"
_HARDENING = "N/m3 N/mm3:9 kN/m3:3 MN/m3:6"
MASS = _dimension("mass", "kg g:-3 mg:-6", "400g", "positive", bare=False)
MASS_OR_NUMBER = _dimension("mass", "kg g:-3 mg:-6", "400g", "positive")  # of `units: ca`
STIFFNESS = _dimension("stiffness", "N/m kN/m:3 N/mm:3 mN/m:-3", "60N/m", "not negative")
DAMPING = _dimension("viscosity", "Ns/m mNs/m:-3", "1.2Ns/m", "not negative")
POSITION = _dimension("length", _LENGTH, "1mm", high=1e3, low=-1e3)
SIZE = _dimension("length", _LENGTH, "0.5mm", "positive", high=1e3)
SPAN = _dimension("length", _LENGTH, "5mm", "not negative", high=1e3)
DISTANCE = _dimension("distance", _LENGTH, "2m", "positive", low=0.01, high=100.0)
ROOM_SIZE = _dimension("size of a room", _LENGTH, "10m", "positive", low=0.5, high=100.0)
AZIMUTH = _dimension("azimuth", "deg", "30deg", low=-360.0, high=360.0)
ELEVATION = _dimension("elevation", "deg", "35deg", low=-90.0, high=90.0)
PAN = _dimension("place from -1 (first channel) to 1 (second)", "", "-0.3", low=-1.0, high=1.0)
DENSITY = _dimension("density", "kg/m3 g/cm3:3", "7850kg/m3", "positive", bare=False)
SURFACE_TENSION = _dimension("tension of a membrane", "N/m kN/m:3", "3kN/m", "positive", bare=False)
PRESSURE = _dimension("pressure", "Pa kPa:3 MPa:6 GPa:9", "200GPa", "positive", bare=False)
INHARMONICITY = _dimension("inharmonicity", "", "0.0003", "not negative", high=0.1)
POISSON = _dimension("Poisson's ratio", "", "0.33", "not negative", high=0.5)
SPEED = _dimension("speed", "m/s mm/s:-3", "0.5m/s", high=1e6, low=-1e6)
GRAVITY = _dimension("acceleration", "m/s2 m/s²", "9.81m/s2", high=1e5, low=-1e5)
PUSH = _dimension("force", "N mN:-3 kN:3", "-5N")
FORCE = _dimension("force", "N mN:-3 kN:3", "5N", "positive")
# Of an input of a sound card: full scale is so much, and no more than so much acts.
INPUT_FORCE = _dimension("force", "N kN:3 mN:-3 uN:-6 µN:-6 μN:-6", "2mN", low=-1e3, high=1e3)
INPUT_LENGTH = _dimension("length", _LENGTH, "0.1mm", low=-1.0, high=1.0)
IMPULSE = _dimension("impulse", "Ns mNs:-3 uNs:-6 µNs:-6 μNs:-6", "2uNs", bare=False)
POLES = _dimension(
    "force times the square of a distance", "Nm2 Ncm2:-4 Nmm2:-6 mNmm2:-9", "200Nmm2"
)
HARDENING = _dimension("hardening", _HARDENING, "4e8N/m3", "not negative")
FREQUENCY = _dimension("frequency", "Hz kHz:3", "220Hz", "positive", high=1e6)
RATE = _dimension("rate", "Hz kHz:3", "44100Hz", "positive", low=1e3, high=2e6)
TICK_RATE = _dimension("rate of ticks", "Hz kHz:3", "1kHz", "positive", low=1.0, high=1e5)
DURATION = _dimension(
    "time in seconds", "s ms:-3 us:-6 µs:-6 μs:-6", "2.5s", "positive", bare=False
)
INSTANT = _dimension(
    "time in seconds", "s ms:-3 us:-6 µs:-6 μs:-6", "0.4s", "not negative", bare=False
)
CONTACT_TIME = _dimension(
    "time in seconds", "s ms:-3 us:-6 µs:-6 μs:-6", "2ms", "not negative", bare=False, high=0.05
)
# The highest level that a session takes, from a line or from the network: a slip of the finger must
# not hurt the ears [dB].
LOUDEST_DB = 24.0
LOUDNESS = _dimension("loudness", "LUFS", "-31LUFS", bare=False, low=-150.0, high=60.0)
LEVEL = _dimension("level", "dB", "-6dB", bare=False, low=-400.0, high=200.0)
ERROR = _dimension("error", "dB", "-60dB", bare=False, low=-160.0, high=-10.0)
CENTS = _dimension("error of pitch in cents", "", "3", "positive", low=0.01, high=1200.0)
CHANCE = _dimension("chance", "%:-2", "0.6", "not negative", high=1.0)
SHARE = _dimension("share of the processor", "%:-2", "80%", "positive", bare=False, high=64.0)
NUMBER = _dimension("plain number", "", "0.5")
RATIO = _dimension("plain number", "", "0.5", "not negative")
FACTOR = _dimension("number", "", "1.5", "positive")
FRICTION = _dimension("coefficient of friction", "", "0.4", "not negative", high=10.0)
EXPONENT = _dimension("exponent", "", "1.5", low=1.0, high=16.0)
RADIUS = _dimension("radius", "", "0.3", "not negative", high=10.0)
PATH_AZIMUTH = _dimension("angle", "deg", "1080deg", low=-36000.0, high=36000.0)
WIDTH = _dimension("width", "", "0.06", "positive", low=0.001, high=4.0)
HOLE = _dimension("radius of a hole", "", "0.3", "positive", low=0.01, high=1.0)
UNIT_RATIO = _dimension("number from 0 to 1", "", "0.5", "not negative", high=1.0)

# A constant of a law may have any of these; what it must measure depends on the law's text.
_LAW_UNITS = (
    f"{_HARDENING} N/m2 N/m N/mm:3 kN/m:3 Ns/m mNs/m:-3 Ns2/m2 N mN:-3 kN:3 m/s mm/s:-3 {_LENGTH} "
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


def full_scale(text: str) -> tuple[float, bool]:
    """Read the value of full scale of an input [N or m], and whether it is a force.

    Raises TextError if the unit is neither of force nor of length, or if the value is 0.
    """
    word = text.strip()
    is_force = word.endswith("N")
    if not is_force and not word.endswith("m"):
        raise TextError(f"{quote(word)} must have a unit of force or length, such as 2mN or 0.1mm")
    value = quantity(text, INPUT_FORCE if is_force else INPUT_LENGTH)
    if value == 0.0:
        raise TextError("full scale must not be 0")
    return value, is_force


def quantity(text: str, dimension: Dimension) -> float:
    """The SI value of a number with a unit. Raises TextError: E201, E202 or E203."""
    word = _trimmed(text)
    match = _FRACTION.match(word) or _NUMBER.match(word)
    if match is None:
        raise _not_a_number(word, dimension)
    unit = word[match.end() :].strip()
    power = _power(unit, word, len(word) - len(unit), dimension)
    if match.re is _FRACTION:
        if int(match[2]) == 0:
            raise TextError("the number divides by zero", length=len(word), code="E202")
        value = float(Fraction(int(match[1]), int(match[2])) * Fraction(10) ** power)
    else:
        value = float(f"{match[1]}e{int(match[2] or 0) + power}")
    return bounded(value, word, dimension)


def bounded(value: float, word: str, dimension: Dimension) -> float:
    """The value when it lies within the dimension's bounds. Raises TextError E202."""
    reason = ""
    if not math.isfinite(value) or abs(value) > MAX_SIZE:
        reason = f"too large; the maximum is {min(dimension.high, MAX_SIZE):g}{dimension.si}"
    elif dimension.sign == "positive" and value <= 0:
        reason = f"not positive; write a positive {dimension.name}, such as {dimension.example}"
    elif dimension.sign == "not negative" and value < 0:
        reason = f"negative; write 0 or a positive {dimension.name}, such as {dimension.example}"
    elif value < dimension.low:
        reason = f"below the minimum of {dimension.low:g}{dimension.si}"
    elif value > dimension.high:
        reason = f"above the maximum of {dimension.high:g}{dimension.si}"
    if reason:
        raise TextError(f"{quote(word)} is {reason}", length=len(word), code="E202")
    return value


def _power(unit: str, word: str, offset: int, dimension: Dimension) -> int:
    power = dimension.units.get(unit)
    if power is not None:
        return power
    units = ", ".join(unit for unit in dimension.units if unit.isascii())
    length = len(word)
    if not unit:
        if dimension.bare or not word.strip("+-0."):
            return 0
        usual = dimension.example.lstrip("+-.0123456789")
        other_unit = next((name for name in (dimension.si, *dimension.units) if name != usual), "")
        could = f"; it could be {word}{usual} or {word}{other_unit}" if other_unit else ""
        message = f"{quote(word)} has no unit (use {units}){could}"
        raise TextError(message, length=length, suggestion=word + usual, code="E203")
    length = len(unit)
    if unit[0] in ":_," or unit[0].isdigit():
        raise _not_a_number(word, dimension)
    if not units:
        message = f"{with_article(dimension.name)} has no unit; remove {quote(unit)}"
        raise TextError(message, offset=offset, length=length, code="E203")
    measures = next((name for of_dimension, name in _ALL_UNITS if of_dimension == unit), None)
    if measures is None:
        likely_unit = _likely(unit, dimension)
        message = f"unknown unit {quote(unit)} ({with_article(dimension.name)} has {units})"
        raise TextError(message, offset=offset, length=length, suggestion=likely_unit, code="E203")
    message = f"unit {quote(unit)} does not measure {dimension.name} (use {units})"
    raise TextError(message, offset=offset, length=length, code="E203")


def _likely(unit: str, dimension: Dimension) -> str | None:
    """The unit that was most likely meant; None if `unit` is a valid unit with a prefix that this
    dimension does not have.
    """
    spoken = _SPOKEN.get(unit.lower()) or _SPOKEN.get(unit.lower().removesuffix("s"))
    if spoken in dimension.units:
        return spoken
    is_multiple = unit[0] in _PREFIXES and unit[1:] in dimension.units
    return None if is_multiple else nearest(unit, dimension.units)


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


def _not_a_number(word: str, dimension: Dimension) -> TextError:
    noun = with_article(dimension.name)
    message = f"{quote(word)} is not a number; {noun} is written like {dimension.example}"
    suggestion = None
    if (seconds := clock_time(word)) is not None:
        message = f"{quote(word)} is a clock time; write it in seconds"
        suggestion = seconds
    elif re.fullmatch(r"[+-]?[\d_,]+\D*", word) and ("_" in word or "," in word):
        message = f"{quote(word)}: write digits without '_' and ',', and '.' as the decimal point"
        suggestion = _plain_digits(word)
    elif re.fullmatch(r"[+-]?\.?(nan|inf|infinity)", word, re.IGNORECASE):
        message = f"{quote(word)} is not a finite number"
    return TextError(message, length=len(word), suggestion=suggestion, code="E201")


def _plain_digits(word: str) -> str:
    """`4,5s` is 4.5s; `1,000` and `1_000` are 1000."""
    decimal = re.fullmatch(r"([+-]?\d+),(\d{1,2}|\d{4,})(\D.*)?", word)
    return word.replace(",", ".") if decimal else re.sub("[_,]", "", word)


def frequency(text: str, dimension: Dimension = FREQUENCY) -> float:
    """A frequency [Hz], or a note of the tuning of the file that is read: `A3`, `C#4`,
    `A3+20cents`; with a tuning also a ratio above its root: `3/2`.
    """
    word = _trimmed(text)
    tuned = tuning.written()
    spelling = tuning.spelled(word)
    if tuned is None and _FRACTION.fullmatch(word):
        spelling = word  # hertz, as ever
    value = (tuned or tuning.PLAIN).hertz(spelling)
    if value is not None and not spelling.endswith("Hz"):
        return bounded(value, word, dimension)
    if value is None and word[:1].isalpha():
        message = f"{quote(word)} is neither a frequency such as 220Hz nor a note such as A3 or Bb2"
        raise note_slip(word) or TextError(message, length=len(word), code="E201")
    if value is None:
        _check_pitch(word)
    return quantity(word.replace("_", ".") if value is not None else text, dimension)


def note_slip(word: str) -> TextError | None:
    """What is wrong with a word that means a note, a chord or a rest: solfège, a letter without an
    octave, a spelling of another program; None if it means none.
    """
    if word.lower() in _RESTS:
        message = f"{quote(word)} is a rest, which is not written among entries: each entry stands "
        return TextError(
            f"{message}at its time; in a rhythm a rest is ~", length=len(word), code="E201"
        )
    if (chord := _CHORD.fullmatch(word)) is not None:
        root = f"{chord[1].upper()}{chord[2]}"
        message = (
            f"{quote(word)} is the name of a chord; write its notes, each with an octave, such "
        )
        return TextError(f"{message}as {root}4 and those above it", length=len(word), code="E201")
    if (ticks := _LILYPOND.fullmatch(word)) is not None:
        octave = 3 + ticks[3].count("'") - ticks[3].count(",")
        note = f"{ticks[1].upper()}{_FOREIGN_SIGNS.get(ticks[2], ticks[2])}{octave}"
        message = f"{quote(word)} counts octaves by ticks, and a score by numbers: C4 is middle C"
        return TextError(message, length=len(word), suggestion=note, code="E201")
    suggestion = _respelled(word)
    match = _SOLFEGE.fullmatch(word)
    letter = None if match is None else _SYLLABLES[match[1].lower()]
    if match is not None and match[3]:
        sign, octave = _FOREIGN_SIGNS.get(match[2].lower(), match[2]), int(match[3])
        suggestion = f"{letter}{sign}{octave}"
        message = (
            f"{quote(word)} is solfège, and notes are written by letters: {suggestion}, or "
            f"{letter}{sign}{octave + 1} where octaves are counted as in France (la3 is A4, 440 Hz)"
        )
    elif match is not None or re.fullmatch(r"[A-Ga-g](##|bb|[#b♯♭])?", word):
        note = (
            f"{word[0].upper()}{word[1:]}" if letter is None or match is None else letter + match[2]
        )
        suggestion = f"{note}4"
        message = (
            f"{quote(word)} has no octave: write {note}3, {note}4 or another one; C4 is middle C, "
            "A4 has 440 Hz"
        )
    elif suggestion is not None:
        message = f"{quote(word)} is neither a frequency such as 220Hz nor a note such as A3 or Bb2"
    else:
        return None
    return TextError(message, length=len(word), suggestion=suggestion, code="E201")


def _check_pitch(word: str) -> None:
    """Refuse a number that could be that of a note of MIDI. Raises TextError E203."""
    if word.isdigit() and 0 < int(word[:4]) <= _NOTE_NUMBER_MAX:
        octave, step = divmod(int(word), 12)
        name = f"{_STEPS[step]}{octave - 1}"
        message = f"{quote(word)} has no unit; it could be {word}Hz, or the note {name}, which is "
        message += f"number {word} of MIDI"
        raise TextError(message, length=len(word), code="E203")


def _respelled(word: str) -> str | None:
    """A note written in German, in small letters or with the accidental last, respelled in this
    notation.
    """
    match = _FOREIGN_NOTE.fullmatch(word)
    if match is None:
        return None
    letter, middle, octave, last_letter = match.groups()
    sign = (middle or last_letter or "").lower()
    if middle and last_letter:
        return None
    letter = letter.upper()
    return f"{'B' if letter == 'H' else letter}{_FOREIGN_SIGNS.get(sign, sign)}{octave}"


Read = Callable[[str], float]


def span(text: str, read: Read, example: str) -> tuple[float, float]:
    """`low..high`, each read by `read`; a bare number takes the other's unit."""
    low, dots, high = text.strip().partition("..")
    if not dots:
        message = f"{quote(text.strip())} is not a range such as {example}"
        raise TextError(message, length=len(text.strip()), code="E201")
    low, high = low.strip(), high.strip()
    if _NUMBER.fullmatch(low) and (unit := _unit_of(high)):
        low += unit
    elif _NUMBER.fullmatch(high) and (unit := _unit_of(low)):
        high += unit
    a = read(low)
    try:
        b = read(high)
    except TextError as error:
        error.offset += text.index("..") + 2
        raise
    if a > b:
        message = f"the range {quote(text.strip())} runs downwards; write the lower end first"
        raise TextError(message, length=len(text), suggestion=f"{high}..{low}", code="E202")
    return a, b


def _unit_of(word: str) -> str:
    match = _NUMBER.match(word)
    return word[match.end() :].strip() if match else ""


def ratio_of(decibels: float) -> float:
    """The ratio of amplitudes of a level [dB]."""
    return _core.decibels(decibels)


def gain(text: str) -> float:
    """A ratio of amplitudes from a level (`-6dB`) or a factor (`x0.5`)."""
    word = text.strip()
    if word.startswith("x"):
        return factor(text)
    if _NUMBER.fullmatch(word):
        factor_like = "" if word.startswith("-") else f"x{word} for a factor, or "
        message = f"{quote(word)} has no unit; write {factor_like}{word}dB for a level"
        suggestion = f"x{word}" if factor_like else f"{word}dB"
        raise TextError(message, length=len(word), suggestion=suggestion, code="E203")
    if _NUMBER.fullmatch(share := word.removesuffix("%").rstrip()) and share != word:
        ratio = f"x{float(share) / 100.0:g}"
        message = f"{quote(word)} is a percentage; write {ratio} for a factor, or a level in dB"
        raise TextError(message, length=len(word), suggestion=ratio, code="E203")
    return _core.decibels(quantity(text, LEVEL))


def factor(text: str) -> float:
    """`x1.5`: a factor that is not negative."""
    word = text.strip()
    if not word.startswith("x"):
        message = f"{quote(word)} is not a factor such as x1.5"
        raise TextError(message, length=len(word), code="E201")
    try:
        return quantity(word[1:], RATIO)
    except TextError as error:
        error.offset += 1
        raise


def integer(text: str, low: int, high: int) -> int:
    """A whole number within bounds; `1e4` is accepted."""
    word = _trimmed(text)
    if re.fullmatch(r"[+-]?\d{1,30}", word):  # not through a float: seeds have 64 bits
        value = int(word)
    elif (number := quantity(word, NUMBER)) == int(number):
        value = int(number)
    else:
        raise TextError(f"{quote(word)} is not a whole number", length=len(word), code="E201")
    if not low <= value <= high:
        message = f"{quote(word)} lies outside the range from {low:,} to {high:,}"
        raise TextError(message, length=len(word), code="E202")
    return value


def level_between(low: float, high: float, share: float) -> float:
    """The ratio of amplitudes on a share (0 to 1) of the way in dB between two ratios above 0."""
    return low * _core.pow(high / low, share)
