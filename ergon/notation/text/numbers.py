"""The notation of a number with a unit, shared by all parsers."""

import re

from ergon.notation.text.errors import TextError

# Possessive quantifiers (*+): a hostile line is read once, never by backtracking.
NUMBER = r"(?:[0-9]++(?:\.[0-9]*+)?|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
UNIT = r"[^\W\d_]*+"
_CLOCK = re.compile(r"(?:([0-9]{1,3}):)?([0-9]{1,4}):([0-5][0-9])(\.[0-9]{1,9})?")
MAX_TIME = 1e9  # beats or seconds, thirty years: keeps every sum finite


def clock_time(word: str) -> str | None:
    """The seconds of a clock time: `90s` for `1:30`, `3723s` for `1:02:03`; None if it is none."""
    clock_match = _CLOCK.fullmatch(word)
    if clock_match is None:
        return None
    hours, minutes, seconds, second_fraction = clock_match.groups()
    return f"{3600 * int(hours or 0) + 60 * int(minutes) + int(seconds)}{second_fraction or ''}s"


def stripped(text: str) -> tuple[str, int]:
    """The text without space round it, and where it begins."""
    return text.strip(), len(text) - len(text.lstrip())


def time_of(number_text: str, denominator: str | None, number_offset: int) -> float:
    """The time `number_text`, divided by `denominator` if there is one; `number_text` begins at
    `number_offset`. Raises TextError.
    """
    time_value = float(number_text)
    number_length = len(number_text)
    if denominator is not None:
        number_length += 1 + len(denominator)
        divisor = float(denominator)
        if divisor == 0.0:
            raise TextError("the time divides by zero", offset=number_offset, length=number_length)
        time_value /= divisor
    if not time_value <= MAX_TIME:
        raise TextError("the time is too large", offset=number_offset, length=number_length)
    return time_value
