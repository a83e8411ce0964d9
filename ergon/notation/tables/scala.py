"""Scales (`.scl`) and keyboard maps (`.kbm`) in the formats of the program Scala.

Source: Manuel Op de Coul, "Scala scale file format" and "Scala keyboard mapping format"
(huygens-fokker.org/scala). A line that begins with `!` is a comment.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

from ergon import _core
from ergon.notation.text.errors import TextError, quote

MAX_DEGREES = 8_192  # of a scale; the largest of the Scala archive has 1,000 or so
MAX_KEYS = 1_024  # of a keyboard map
_MAX_CENTS = 120_000.0  # a hundred octaves
_MAX_RATIO = 2.0**100

_CENTS = re.compile(r"[+-]?(?:\d{1,12}\.\d{0,40}|\.\d{1,40})(?:[eE][+-]?\d{1,3})?")
_RATIO = re.compile(r"([+-]?\d{1,400})(?:\s*/\s*([+-]?\d{1,400}))?")
_LINE_END = re.compile(r"\r\n|\r|\n")  # \x85 is a letter of older code pages
_LAST_END = re.compile(r"(?:\r\n|\r|\n)\Z")
_INTEGER = re.compile(r"[+-]?\d{1,9}")
_DECIMAL = re.compile(r"\d{1,12}\.?\d{0,20}(?:[eE][+-]?\d{1,3})?")


def decoded(scala_bytes: bytes) -> str:
    """The text of a file of Scala: UTF-8, or Latin-1 as in its archive."""
    try:
        return scala_bytes.decode("utf-8-sig")
    except UnicodeDecodeError:
        return scala_bytes.decode("latin-1")


class ScalaError(TextError):
    """What is wrong with a line of a file; `line` counts from 1."""

    def __init__(self, message: str, line: int, text: str = "") -> None:
        """Say where; the whole line is at fault."""
        super().__init__(message, length=max(1, min(len(text), 80)), code="E201")
        self.line = line


@dataclass(frozen=True, slots=True)
class Scale:
    """The ratios of the degrees above 1/1; the last is the interval after which they repeat."""

    ratios: tuple[float, ...]
    title: str = ""

    def ratio(self, degree: int) -> float:
        """The ratio of a degree of any octave to 1/1."""
        octave, step = divmod(degree, len(self.ratios))
        return self.ratios[-1] ** octave * (self.ratios[step - 1] if step else 1.0)


@dataclass(frozen=True, slots=True)
class KeyMap:
    """Which degree each key plays. Keys are numbers of MIDI notes.

    `degrees` repeat from the key `middle` on, each time higher by `octave` degrees (0: by the
    interval of repetition of the scale); None is a key without a pitch. Without `degrees` each
    key plays the degree after that of the key below it. The key `reference` has `frequency` [Hz].
    """

    low: int = 0
    high: int = 127
    middle: int = 60
    reference: int = 69
    frequency: float = 440.0
    octave: int = 0
    degrees: tuple[int | None, ...] = ()

    def degree(self, key: int, scale: Scale) -> int | None:
        """The degree of a key; None if the key has no pitch."""
        if not self.degrees:
            return key - self.middle
        period, index_in_period = divmod(key - self.middle, len(self.degrees))
        degree = self.degrees[index_in_period]
        return None if degree is None else degree + period * (self.octave or len(scale.ratios))

    def hertz(self, key: int, scale: Scale) -> float | None:
        """The frequency of a key [Hz]; None if the key has no pitch."""
        degree = self.degree(key, scale) if self.low <= key <= self.high else None
        reference_degree = self.degree(self.reference, scale)
        if degree is None or reference_degree is None:
            return None
        return self.frequency * (scale.ratio(degree) / scale.ratio(reference_degree))


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are no comments, with their numbers from 1."""
    for number, line in enumerate(_LINE_END.split(_LAST_END.sub("", text)), 1):
        if not line.startswith("!"):
            yield number, line.strip()


def parse_scale(text: str) -> Scale:
    """Read a `.scl` file. Raises ScalaError."""
    lines = _lines(text)
    last_line = text.count("\n") + 1
    _, title = next(lines, (last_line, ""))
    number, count_line = next(lines, (last_line, ""))
    match = re.match(r"\d{1,9}(?!\S)", count_line)
    if match is None:
        message = "the second line that is no comment is the number of degrees, such as 12"
        raise ScalaError(message, number, count_line)
    count = int(match[0])
    if not 1 <= count <= MAX_DEGREES:
        message = f"{count:,} degrees are announced; a scale has from 1 to {MAX_DEGREES:,}"
        raise ScalaError(message, number, count_line)
    ratios: list[float] = []
    while len(ratios) < count:
        number, line = next(lines, (0, ""))
        if not number:
            message = f"{count:,} degrees are announced, but the file has {len(ratios):,}"
            raise ScalaError(message, last_line)
        ratios.append(_pitch(line, number))
    return Scale(tuple(ratios), title)


def _pitch(line: str, number: int) -> float:
    """The ratio of one degree: cents if there is a period in it, else a ratio."""
    word = line.split()[0] if line else ""
    if _CENTS.fullmatch(word):
        cents = float(word)
        if abs(cents) > _MAX_CENTS:
            raise ScalaError(f"{quote(word)} lies outside ±{_MAX_CENTS:,.0f} cents", number, line)
        return _core.pow(2.0, cents / 1200.0)
    match = _RATIO.match(line)
    sign_after = "" if match is None else line[match.end() : match.end() + 1]
    if match is None or sign_after.isalnum() or sign_after in {"/", ".", ","}:
        message = f"{quote(line[:40])} is no pitch; write cents with a period, or a ratio as 3/2"
        raise ScalaError(message, number, line)
    numerator, denominator = int(match[1]), int(match[2] or 1)
    if denominator == 0 or numerator * denominator <= 0:
        raise ScalaError(f"{quote(match[0])} is not a ratio above 0", number, line)
    if abs(math.log2(abs(numerator)) - math.log2(abs(denominator))) > math.log2(_MAX_RATIO):
        raise ScalaError(f"{quote(match[0][:40])} is more than 100 octaves", number, line)
    return float(Fraction(numerator, denominator))


def parse_key_map(text: str) -> KeyMap:
    """Read a `.kbm` file. Raises ScalaError."""
    lines = _lines(text)
    last_line = text.count("\n") + 1

    def word(noun: str) -> tuple[int, str]:
        number, line = next(lines, (last_line, ""))
        if not line.split():
            raise ScalaError(f"{noun} is missing", number, line)
        return number, line.split()[0]

    def integer(noun: str, low: int, high: int) -> int:
        number, text_of_number = word(noun)
        if not _INTEGER.fullmatch(text_of_number) or not low <= int(text_of_number) <= high:
            message = f"{quote(text_of_number)} is not {noun}, a whole number from {low} to {high}"
            raise ScalaError(message, number, text_of_number)
        return int(text_of_number)

    size = integer("the size of the map", 0, MAX_KEYS)
    low, high = integer("the first key", 0, 127), integer("the last key", 0, 127)
    middle = integer("the middle key", -MAX_KEYS, MAX_KEYS)
    reference = integer("the reference key", -MAX_KEYS, MAX_KEYS)
    number, hertz = word("the reference frequency")
    if not _DECIMAL.fullmatch(hertz) or not 0.001 <= float(hertz) <= 1e6:
        message = f"{quote(hertz)} is not the reference frequency in hertz, such as 440.0"
        raise ScalaError(message, number, hertz)
    octave = integer("the degree of the formal octave", 0, MAX_DEGREES)
    degrees: list[int | None] = []
    rows = [*lines]
    while rows and not rows[-1][1]:  # blank lines at the end of the file
        rows.pop()
    for number, line in rows:
        if len(degrees) == size:
            break
        cell = line.split()[0] if line else ""
        if cell.lower() == "x":
            degrees.append(None)
        elif _INTEGER.fullmatch(cell) and abs(int(cell)) <= MAX_DEGREES:
            degrees.append(int(cell))
        else:
            message = f"{quote(line[:40])} is neither a degree nor x, for a key without a pitch"
            raise ScalaError(message, number, line)
    degrees += [None] * (size - len(degrees))  # Scala: keys that are left out have no pitch
    key_map = KeyMap(low, high, middle, reference, float(hertz), octave, tuple(degrees))
    if key_map.degrees and key_map.degrees[(reference - middle) % size] is None:
        raise ScalaError(f"the reference key {reference} has no degree in the map", number)
    return key_map
