"""Arguments of what transforms a pattern in cycles: counts, times, amounts, rhythms."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from ergon.notation.tables.octaves import octaves_of_ratio
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest
from ergon.scores.pattern.cycle_operations import filter_values
from ergon.scores.pattern.cycles import Cycles
from ergon.scores.pattern.phrasing import ORDERS
from ergon.scores.pattern.rhythm import MAX_STEPS
from ergon.scores.pattern.rhythm_signs import MAX_DIGITS, MAX_NUMBER
from ergon.scores.pattern.rhythm_text import parse
from ergon.scores.pattern.struck import Repeats

MAX_COPIES = 32  # copies of an echo
MAX_SEMITONES = 127
MAX_FACTOR = 100
MAX_RATE = 100  # rate of a tremolo [Hz]
MAX_LENGTH = 8  # length of a stroke over the distance to the next

Argument = int | float | str | Fraction | Repeats

_RATIO_PATTERN = re.compile(r"([0-9]+(?:\.[0-9]+)?)(?:/([0-9]+(?:\.[0-9]+)?))?")
_INTERVAL_PATTERN = re.compile(r"([+-]?[0-9]{1,5}(?:\.[0-9]{1,6})?)(st|cents?)")
_BEAT_BY_WORD: Mapping[str, bool] = {
    "t": True,
    "x": True,
    "1": True,
    "true": True,
    "f": False,
    "0": False,
    "false": False,
}


@dataclass(frozen=True, slots=True)
class Reader:
    """How an argument is read: `description` it is, for messages, and a function of its word.

    The function returns None for a word that is no such argument. `known_words` are the words that
    are suggested.
    """

    description: str
    parse_word: Callable[[str], Argument | None]
    known_words: tuple[str, ...] = ()

    def read_argument(self, typed_word: str, word_offset: int, example: str) -> Argument:
        """Read a word at an offset. Raises TextError."""
        value = self.parse_word(typed_word)
        if value is None:
            message = f"{quote(typed_word)} is not {self.description}; write for instance {example}"
            suggestion = nearest(typed_word.strip("\"'"), self.known_words)
            raise TextError(
                message, offset=word_offset, length=max(1, len(typed_word)), suggestion=suggestion
            )
        return value


def parse_ratio(word: str) -> Fraction | None:
    """A number without a sign such as `2`, `1.5` or `3/2`; None if the word is none."""
    ratio_match = _RATIO_PATTERN.fullmatch(word)
    if ratio_match is None or max(len(part or "") for part in ratio_match.groups()) > MAX_DIGITS:
        return None
    divisor = Fraction(ratio_match[2] or 1)
    return Fraction(ratio_match[1]) / divisor if divisor else None


def _ratio_reader(minimum: Fraction, maximum: int) -> Callable[[str], Fraction | None]:
    """A reader of numbers from `minimum` to `maximum`."""

    def read(word: str) -> Fraction | None:
        value = parse_ratio(word)
        return value if value is not None and minimum <= value <= maximum else None

    return read


def _count_reader(minimum: int, maximum: int) -> Callable[[str], int | None]:
    """A reader of numbers without fractions."""

    def read(word: str) -> int | None:
        is_count = word.isascii() and word.isdigit() and len(word) <= MAX_DIGITS
        return int(word) if is_count and minimum <= int(word) <= maximum else None

    return read


def _read_semitones(typed_word: str) -> float | None:
    """The semitones of `-5st`, `50cents`, `3/2` or `x1.5`; whole ones of `st` as an integer, for
    they are keys of a scale.
    """
    semitones: float
    if interval_match := _INTERVAL_PATTERN.fullmatch(typed_word):
        amount = Fraction(interval_match[1])
        is_integer = interval_match[2] == "st" and amount.denominator == 1
        semitones = (
            int(amount) if is_integer else float(amount / (1 if interval_match[2] == "st" else 100))
        )
    else:
        factor = (
            parse_ratio(typed_word.removeprefix("x"))
            if "/" in typed_word or typed_word[:1] == "x"
            else None
        )
        if not factor:
            return None
        semitones = 12.0 * (
            octaves_of_ratio(factor.numerator) - octaves_of_ratio(factor.denominator)
        )
    return semitones if abs(semitones) <= MAX_SEMITONES else None


def _amount_reader(maximum: int) -> Callable[[str], float | None]:
    """A reader of numbers from 0 that need not be exact."""
    read = _ratio_reader(Fraction(0), maximum)
    return lambda word: None if (value := read(word)) is None else float(value)


def _read_repeats(typed_word: str) -> int | Repeats | None:
    """`8`, or `12Hz`."""
    if not typed_word.endswith("Hz"):
        return _count_reader(1, MAX_NUMBER)(typed_word)
    value = _ratio_reader(_FACTOR_MIN, MAX_RATE)(typed_word.removesuffix("Hz"))
    return None if value is None else Repeats(float(value))


def _read_seconds(typed_word: str) -> float | None:
    """`20ms` or `-0.02s`, up to a second either way, and not nothing."""
    units_per_second = 1000 if typed_word.endswith("ms") else 1
    number = parse_ratio(typed_word.removeprefix("-").removesuffix("s").removesuffix("m"))
    if not typed_word.endswith("s") or number is None or not 0 < number <= units_per_second:
        return None
    return float(-number / units_per_second if typed_word[0] == "-" else number / units_per_second)


def _read_signed_share(typed_word: str) -> Fraction | None:
    """A share from -1 to 1, and not nothing."""
    share = parse_ratio(typed_word.removeprefix("-"))
    if share is None or not 0 < share <= 1:
        return None
    return -share if typed_word[0] == "-" else share


_FACTOR_MIN = Fraction(1, MAX_NUMBER)

COUNT = Reader(f"a number from 1 to {MAX_NUMBER:,}", _count_reader(1, MAX_NUMBER))
COUNT_FROM_ZERO = Reader(f"a number from 0 to {MAX_NUMBER:,}", _count_reader(0, MAX_NUMBER))
COPIES = Reader(f"a number of copies from 1 to {MAX_COPIES}", _count_reader(1, MAX_COPIES))
STEPS = Reader(f"a number of steps from 1 to {MAX_STEPS}", _count_reader(1, MAX_STEPS))
SPEED = Reader(
    f"a factor from 1/{MAX_NUMBER} to {MAX_NUMBER:,}", _ratio_reader(_FACTOR_MIN, MAX_NUMBER)
)
TIME = Reader("a share of a cycle", _ratio_reader(Fraction(0), MAX_NUMBER))
SHARE = Reader("a share of a slice from 0 to 1", _ratio_reader(Fraction(0), 1))
PROBABILITY = Reader("a probability from 0 to 1", _amount_reader(1))
FACTOR = Reader(f"a factor from 0 to {MAX_FACTOR}", _amount_reader(MAX_FACTOR))
LENGTH = Reader(
    f"a share of the time until the next stroke, up to {MAX_LENGTH}",
    _ratio_reader(_FACTOR_MIN, MAX_LENGTH),
)
CYCLE_STEP = Reader("a share of a cycle from 1/1000 to 1", _ratio_reader(_FACTOR_MIN, 1))
REPEATS = Reader(
    f"a number of strokes from 1 to {MAX_NUMBER:,}, or a rate up to {MAX_RATE}Hz", _read_repeats
)
SWELL = Reader(
    f"a factor from 1/{MAX_NUMBER} to {MAX_FACTOR}", _ratio_reader(_FACTOR_MIN, MAX_FACTOR)
)
SECONDS = Reader("a time up to a second, such as 20ms or -20ms", _read_seconds)
SIGNED_SHARE = Reader("a share of the length from -1 to 1 without 0", _read_signed_share)
ORDER = Reader(
    f"an order of notes: {', '.join(ORDERS)}",
    lambda word: word if word in ORDERS else None,
    tuple(ORDERS),
)
SEMITONES = Reader(
    f"an interval such as -5st, 50cents or 3/2, up to {MAX_SEMITONES}st", _read_semitones
)


def parse_beats(text: str, start: int, first_number: int) -> Cycles[bool]:
    """Read a rhythm of `t` and `f`; only the beats that are true are events. Raises TextError."""
    return filter_values(bool, parse(text, _read_beat, start, first_number))


def _read_beat(typed_word: str, word_offset: int) -> bool:
    beat = _BEAT_BY_WORD.get(typed_word)
    if beat is None:
        message = (
            f"{quote(typed_word)} is not a beat; write t for a beat, and ~ or f for a rest: t ~ t t"
        )
        suggestion = nearest(typed_word, _BEAT_BY_WORD)
        raise TextError(message, offset=word_offset, length=len(typed_word), suggestion=suggestion)
    return beat
