"""Signs and numbers of a rhythm text, and mistakes in their places."""

from __future__ import annotations

import re
from fractions import Fraction

from ergon.notation.text.errors import TextError, quote
from ergon.scores.pattern.rhythm import Euclid, parse_euclid

MAX_NUMBER = 1_000
MAX_DIGITS = 8  # digits of a number, since exact fractions grow

NUMBER = re.compile(r"[0-9]+(?:\.[0-9]+)?")
_EUCLID = re.compile(r"\(\s*([0-9]{1,4})\s*,\s*([0-9]{1,4})\s*(?:,\s*([0-9]{1,4})\s*)?\)")
# Signs that change the step before them, each with an example.
_EXAMPLE_BY_SIGN = {
    "*": "kick*2",
    "/": "kick/2",
    "@": "kick@3",
    "?": "kick? or kick?0.3",
    "(": "kick(3,8)",
    "!": "kick!3",
    "%": "{kick snare hat}%4",
}


class Scanner:
    """Reads a text from left to right; `cursor` is the next character."""

    def __init__(self, text: str, start: int) -> None:
        """Begin at the first character; mistakes have places in the text plus `start`."""
        self.text = text
        self.start = start
        self.cursor = 0

    def peek(self, skips: bool = True) -> str:
        """The next character, after white space if that is skipped; empty at the end."""
        while skips and self.text[self.cursor : self.cursor + 1].isspace():
            self.cursor += 1
        return self.text[self.cursor : self.cursor + 1]

    def read_amount(self, sign: str) -> Fraction:
        """Read the number after a sign."""
        number_start = self.cursor
        match = NUMBER.match(self.text, number_start)
        if match is None:
            message = f"'{sign}' needs a plain number directly after it: {_EXAMPLE_BY_SIGN[sign]}"
            raise self.mistake(message, number_start - 1)
        self.cursor = match.end()
        number_length = self.cursor - number_start
        if re.match(r"[\w.]", self.text[self.cursor : self.cursor + 1]):
            message = (
                f"a space must follow the number {quote(match.group())}: {_EXAMPLE_BY_SIGN[sign]}"
            )
            raise self.mistake(message, self.cursor)
        number = Fraction(match.group())
        if number_length > MAX_DIGITS:
            message = f"this number is too long; it has at most {MAX_DIGITS} characters"
        elif sign == "?" and number > 1:
            message = "'?' is followed by a probability from 0 to 1: kick?0.3"
        elif number == 0 and sign != "?":
            message = (
                f"'{sign}' needs a number above 0: {_EXAMPLE_BY_SIGN[sign]}; a rest is written ~"
            )
        elif number > MAX_NUMBER:
            message = f"numbers of a rhythm are at most {MAX_NUMBER:,}"
        else:
            return number
        raise self.mistake(message, number_start, number_length)

    def read_euclid(self) -> Euclid:
        """Read `(3,8)` or `(3,8,2)`."""
        start = self.cursor
        match = _EUCLID.match(self.text, start)
        if match is None:
            stop = self.text.find(")", start) + 1 or len(self.text)
            message = "'(' needs plain numbers of pulses and steps: kick(3,8), kick(3,8,2)"
            raise self.mistake(message, start, stop - start)
        self.cursor = match.end()
        pulses, steps, turn = match.groups("0")
        try:
            return parse_euclid(f"{pulses} {steps} rotate {turn}")
        except TextError as error:
            raise self.mistake(error.message, start, self.cursor - start) from error

    def unknown_sign_error(self, sign: str) -> TextError:
        """The mistake of a sign that does not begin a step."""
        if sign == "%":
            message = f"'%' follows braces without a space: {_EXAMPLE_BY_SIGN[sign]}"
            return self.mistake(message, self.cursor)
        if sign in _EXAMPLE_BY_SIGN:
            message = f"'{sign}' follows a step without a space: {_EXAMPLE_BY_SIGN[sign]}"
            return self.mistake(message, self.cursor)
        if sign == ")":
            message = "')' has no '(' before it; steps are grouped by [ … ], ( ) is for kick(3,8)"
            return self.mistake(message, self.cursor)
        if sign == ":":
            message = "':' and a strength follow the word of a step, before the signs that change "
            return self.mistake(message + "it: hat:p(7,16), kick:f*4", self.cursor)
        message = f"{quote(sign)} does not begin a step; words begin with a letter or a digit, "
        message += "and the signs are ~ [ ] < > { } * / ! @ ? | , . _"
        return self.mistake(message, self.cursor, suggestion="~" if sign == "-" else None)

    def mistake(
        self, message: str, place: int, length: int = 1, suggestion: str | None = None
    ) -> TextError:
        """A mistake at a place of the text."""
        offset = self.start + place
        return TextError(message, offset=offset, length=max(1, length), suggestion=suggestion)
