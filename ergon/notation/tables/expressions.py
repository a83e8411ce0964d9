"""Values with names and arithmetic: `2*heavy`, `low + 7st`, `(3 + 1/2)*beat_length`.

An expression is replaced by the literal of its value, which is then read as if it had been
written. Numbers are exact fractions and notes are semitones, so `3*100g` gives exactly the float
of `300g`. No code is executed: there are only numbers, units, notes, names of `let:`, + - * /
mod sqrt() and parentheses, bounded in length and depth.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from ergon import _core
from ergon.notation.tables import quantities as q
from ergon.notation.tables import tuning
from ergon.notation.tables.octaves import octaves_of_ratio
from ergon.notation.text.errors import TextError, quote
from ergon.notation.text.spelling import nearest

MAX_LENGTH = 200  # characters of an expression
MAX_DEPTH = 16  # parentheses and signs inside one another
_MAX_BITS = 4_096  # bits of a numerator or denominator
_MAX_EXPONENT = 40

_EXPECTED = "a name of `let:`, a note or a number"

_NUMBER = re.compile(r"(\d{1,40}\.?\d{0,40}|\.\d{1,40})(?:[eE]([+-]?\d{1,2})(?!\d))?")
_PART = re.compile(r"/(\d{1,15})(?![\d.eE])")
_NOTE = re.compile(r"([A-G])([#♯b♭]?)(-?\d)(?![\w#♯♭])")
WORD = re.compile(r"[A-Za-z_]\w*")
_ROOT = re.compile(r"sqrt\s*(?=\()")
_SPACE = re.compile(r"\s*")
_MOD = re.compile(r"\s*(mod)\b")
_LETTERS = {"C": -9, "D": -7, "E": -5, "F": -4, "G": -2, "A": 0, "B": 2}
_SIGNS = {"": 0, "#": 1, "♯": 1, "b": -1, "♭": -1}
_NOTE_NAMES = ("A", "A#", "B", "C", "C#", "D", "D#", "E", "F", "F#", "G", "G#")


def _units() -> Iterator[tuple[str, tuple[str, int]]]:
    """Each unit with the unit in which its values are kept, and the power of ten between them."""
    dimensions = (
        *(q.MASS, q.STIFFNESS, q.DAMPING, q.POSITION, q.SPEED, q.PUSH, q.IMPULSE, q.HARDENING),
        q.LOUDNESS,
        *(q.FREQUENCY, q.DURATION, q.LEVEL, q.PRESSURE, q.DENSITY, q.POLES),
    )
    for unit_name, power in q.CONSTANT.units.items():
        if power == 0:
            yield unit_name, (unit_name, 0)
    for dimension in dimensions:
        for unit_name, power in dimension.units.items():
            yield unit_name, (dimension.si, power)
    for word, unit_name in {"bar": "bar", "bars": "bar", "beat": "beat", "beats": "beat"}.items():
        yield word, (unit_name, 0)
    yield from {"st": ("st", 0), "cent": ("st", -2), "cents": ("st", -2), "%": ("", -2)}.items()


UNITS: Mapping[str, tuple[str, int]] = dict(_units())
_BY_LENGTH = sorted(UNITS, key=lambda unit: (-len(unit), unit))
_UNIT = re.compile(rf"\s?({'|'.join(map(re.escape, _BY_LENGTH))})(?![\w%])")


@dataclass(frozen=True, slots=True)
class Amount:
    """A number with its unit; for the unit `note`, semitones above 440 Hz."""

    number: Fraction
    unit: str

    @property
    def literal(self) -> str:
        """The amount as a score writes it."""
        if self.unit == "note":
            if self.number.denominator == 1 and tuning.written() is None:
                octave, step = divmod(int(self.number) + 9, 12)
                octave, name = 4 + octave, _NOTE_NAMES[(step - 9) % 12]
                if 0 <= octave <= 9:
                    return f"{name}{octave}"
            return f"{_plain(_hertz(self))}Hz"
        return f"{_plain(float(self.number))}{self.unit}"


def _plain(plain_number: float) -> str:
    """A float without an exponent, to the last bit."""
    return f"{Decimal(repr(plain_number)).normalize():f}"


def _hertz(note: Amount) -> float:
    octaves, steps_above = divmod(note.number, 12)
    return 440.0 * _core.pow(2.0, float(octaves)) * _core.pow(2.0, float(steps_above) / 12.0)


class _Reader:
    """Reads one expression, from left to right, once."""

    def __init__(
        self,
        text: str,
        known_names: Mapping[str, Amount],
        later_names: Container[str],
        expected: str,
    ) -> None:
        self.text = text
        self.names = known_names
        self.later_names = later_names
        self.expected = expected
        self.offset = 0

    def read_all(self) -> Amount:
        if len(self.text) > MAX_LENGTH:
            message = f"an expression has at most {MAX_LENGTH} characters; give a part of it a name"
            raise TextError(message, length=MAX_LENGTH, code="E201")
        amount = self._sum(0)
        if self.offset < len(self.text):
            unread_text = self.text[self.offset :]
            message = f"{quote(unread_text)} is not allowed here; write + - * / between values"
            raise self._error(message, self.offset, len(unread_text))
        return amount

    def _sum(self, depth: int) -> Amount:
        amount = self._product(depth)
        while sign := self._sign("+-"):
            place = self.offset - 1
            amount = self._checked(self._added(amount, self._product(depth), sign, place), place)
        return amount

    def _product(self, depth: int) -> Amount:
        amount = self._single(depth)
        while sign := self._sign("*/") or self._mod():
            place = self.offset - len(sign)
            amount = self._checked(self._scaled(amount, self._single(depth), sign, place), place)
        return amount

    def _mod(self) -> str:
        match = self._skip(_MOD)
        return match[1] if match else ""

    def _single(self, depth: int) -> Amount:
        text_start = self._skip_spaces()
        if depth > MAX_DEPTH:
            message = f"an expression is nested at most {MAX_DEPTH} deep; give a part of it a name"
            raise self._error(message, text_start, 1)
        if sign := self._sign("+-"):
            amount = self._single(depth + 1)
            if sign == "+":
                return amount
            if amount.unit == "note":
                raise self._error(
                    "a note cannot be negated; subtract semitones (7st)", text_start, 1
                )
            return Amount(-amount.number, amount.unit)
        if self._sign("("):
            amount = self._sum(depth + 1)
            if not self._sign(")"):
                raise self._error("this parenthesis is never closed", text_start, 1)
            return amount
        return self._atom(text_start, depth)

    def _root(self, amount: Amount, place: int, length: int) -> Amount:
        if amount.unit:
            message = (
                f"cannot take the square root of {unit_in_words(amount)}; take that of a ratio, "
            )
            raise self._error(f"{message}sqrt(heavy/100g)", place, length)
        if amount.number < 0:
            raise self._error("cannot take the square root of a number below 0", place, length)
        # IEEE 754 rounds a root correctly: the same bits everywhere.
        return Amount(Fraction(math.sqrt(float(amount.number))), "")

    def _atom(self, text_start: int, depth: int) -> Amount:
        if text_match := _NUMBER.match(self.text, text_start):
            self.offset = text_match.end()
            literal_number = _fraction(text_match)
            if literal_number is None:
                raise self._error(
                    "the number is too large or too small", text_start, len(text_match[0])
                )
            if (part_match := _PART.match(self.text, self.offset)) and text_match[1].isdigit():
                unit_match = _UNIT.match(self.text, part_match.end())
                if unit_match is not None:  # 1/3bar is a third of a bar
                    if int(part_match[1]) == 0:
                        raise self._error(
                            "the number divides by zero", text_start, len(text_match[0])
                        )
                    literal_number, self.offset = (
                        literal_number / int(part_match[1]),
                        part_match.end(),
                    )
            if unit_match := _UNIT.match(self.text, self.offset):
                self.offset = unit_match.end()
                name, power = UNITS[unit_match[1]]
                return Amount(literal_number * Fraction(10) ** power, name)
            return Amount(literal_number, "")
        if text_match := _ROOT.match(self.text, text_start):
            self.offset = text_match.end()
            return self._root(self._single(depth + 1), text_start, len(text_match[0]))
        word_match = WORD.match(self.text, text_start)
        if word_match is not None and word_match[0] in self.names:
            self.offset = word_match.end()
            return self.names[word_match[0]]
        if text_match := _NOTE.match(self.text, text_start):
            self.offset = text_match.end()
            letter, accidental_sign, octave = text_match.groups()
            tuning_written = tuning.written()
            hertz = None if tuning_written is None else tuning_written.hertz(text_match[0])
            if hertz is not None:
                return Amount(Fraction(12.0 * octaves_of_ratio(hertz / 440.0)), "note")
            steps = _LETTERS[letter] + _SIGNS[accidental_sign] + 12 * (int(octave) - 4)
            return Amount(Fraction(steps), "note")
        if word_match is not None and word_match[0] in self.later_names:
            message = (
                f"{quote(word_match[0])} is named below: a value of `let:` uses names above it"
            )
            raise self._error(message, text_start, len(word_match[0]))
        if word_match is not None:
            message = f"{quote(word_match[0])} is not {self.expected}"
            suggestion = nearest(word_match[0], self.names)
            raise self._error(message, text_start, len(word_match[0]), suggestion)
        if text_start >= len(self.text):
            raise self._error("a value is missing at the end", max(0, text_start - 1), 1)
        raise self._error(f"{quote(self.text[text_start])} cannot begin a value", text_start, 1)

    def _added(self, first_amount: Amount, second_amount: Amount, sign: str, place: int) -> Amount:
        signed_number = second_amount.number if sign == "+" else -second_amount.number
        if first_amount.unit == "note" and second_amount.unit == "st":
            return Amount(first_amount.number + signed_number, "note")
        if first_amount.unit == "st" and second_amount.unit == "note" and sign == "+":
            return Amount(first_amount.number + second_amount.number, "note")
        if first_amount.unit == "Hz" and second_amount.unit == "st":
            return Amount(
                Fraction(_shifted(float(first_amount.number), float(signed_number))), "Hz"
            )
        if first_amount.unit == "note" and second_amount.unit == "note":
            if sign == "-":
                return Amount(first_amount.number - second_amount.number, "st")
            raise self._error("cannot add two notes; add semitones (7st)", place, 1)
        first_amount, second_amount = (
            self._as_hertz(first_amount, second_amount),
            self._as_hertz(second_amount, first_amount),
        )
        if first_amount.unit != second_amount.unit:
            message = f"cannot add {unit_in_words(first_amount)} and {unit_in_words(second_amount)}"
            if sign == "-":
                message = (
                    f"cannot subtract {unit_in_words(second_amount)} from "
                    f"{unit_in_words(first_amount)}"
                )
            raise self._error(message, place, 1)
        return Amount(
            first_amount.number + (second_amount.number if sign == "+" else -second_amount.number),
            first_amount.unit,
        )

    def _scaled(
        self, first_amount: Amount, second_amount: Amount, operator_sign: str, sign_place: int
    ) -> Amount:
        if first_amount.unit == "note":
            first_amount = Amount(Fraction(_hertz(first_amount)), "Hz")
        if second_amount.unit == "note":
            second_amount = Amount(Fraction(_hertz(second_amount)), "Hz")
        if operator_sign == "*":
            if first_amount.unit and second_amount.unit:
                message = (
                    f"cannot multiply {unit_in_words(first_amount)} by "
                    f"{unit_in_words(second_amount)}; "
                )
                message += "one must be a plain number"
                raise self._error(message, sign_place, 1)
            return Amount(
                first_amount.number * second_amount.number, first_amount.unit or second_amount.unit
            )
        if second_amount.number == 0:
            raise self._error("this divides by zero", sign_place, 1)
        if operator_sign == "mod":
            if first_amount.unit or second_amount.unit:
                raise self._error(
                    "mod takes plain numbers: i mod 3 is what i/3 leaves", sign_place, 3
                )
            return Amount(first_amount.number % second_amount.number, "")
        if second_amount.unit and first_amount.unit != second_amount.unit:
            message = (
                f"cannot divide {unit_in_words(first_amount)} by {unit_in_words(second_amount)}"
            )
            raise self._error(message, sign_place, 1)
        return Amount(
            first_amount.number / second_amount.number,
            "" if second_amount.unit else first_amount.unit,
        )

    @staticmethod
    def _as_hertz(amount: Amount, second_amount: Amount) -> Amount:
        is_note_beside_hertz = amount.unit == "note" and second_amount.unit == "Hz"
        return Amount(Fraction(_hertz(amount)), "Hz") if is_note_beside_hertz else amount

    def _checked(self, amount: Amount, offset: int) -> Amount:
        amount_number = amount.number
        if (
            max(amount_number.numerator.bit_length(), amount_number.denominator.bit_length())
            > _MAX_BITS
        ):
            raise self._error("the numbers of this expression grow too long", offset, 1)
        limit = 400 if amount.unit in ("note", "st") else q.MAX_SIZE
        if abs(amount_number) > limit:
            raise self._error("the value is too large", offset, 1)
        return amount

    def _sign(self, signs: str) -> str:
        sign_offset = self._skip_spaces()
        if sign_offset < len(self.text) and self.text[sign_offset] in signs:
            self.offset = sign_offset + 1
            return self.text[sign_offset]
        return ""

    def _skip_spaces(self) -> int:
        self._skip(_SPACE)
        return self.offset

    def _skip(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        match = pattern.match(self.text, self.offset)
        self.offset = match.end() if match else self.offset
        return match

    @staticmethod
    def _error(message: str, offset: int, length: int, suggestion: str | None = None) -> TextError:
        return TextError(message, offset=offset, length=length, suggestion=suggestion, code="E201")


def _fraction(number_match: re.Match[str]) -> Fraction | None:
    power = int(number_match[2] or 0)
    return None if abs(power) > _MAX_EXPONENT else Fraction(f"{number_match[1]}e{power}")


def _shifted(hertz: float, semitones: float) -> float:
    return hertz * _core.pow(2.0, semitones / 12.0)


def unit_in_words(amount: Amount) -> str:
    """The unit of an amount, for messages."""
    if not amount.unit:
        return "a plain number"
    return "a note" if amount.unit == "note" else f"a value in {amount.unit}"


def evaluate(
    expression_text: str,
    known_names: Mapping[str, Amount],
    later_names: Container[str] = (),
    expected: str = _EXPECTED,
) -> Amount:
    """The value of an expression; `later_names` are names that it may not use yet, and `expected`
    is what a word may be, for messages. Raises TextError with the characters at fault.
    """
    return _Reader(expression_text, known_names, later_names, expected).read_all()


def looks_like(written_text: str, known_names: Mapping[str, Amount]) -> bool:
    """Whether a text that is no plain value is meant as an expression."""
    words = WORD.findall(written_text)
    if any(word in known_names for word in words):
        return True
    if re.fullmatch(r"\s*[a-z_]\w*\s*", written_text):
        return nearest(written_text.strip(), known_names) is not None
    return bool(
        re.search(r"\bmod\b|[\w)#]\s*[*(]|[\w)#]\s+[-+/]\s|\)\s*[-+*/]", written_text)
    ) or bool(
        re.search(
            r"\d[A-Za-z%]*\s*[-+]\s*[\d(]|\d[A-Za-z%]+/[\d.(]|[A-G][#b]?-?\d\s*[-+]\s*\d",
            written_text,
        )
    )
