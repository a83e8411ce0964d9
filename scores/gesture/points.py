"""One written point: its position, its time, its curve word, and error messages for each."""

import re
from typing import Literal, get_args

from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import NUMBER, UNIT, time_of
from ergon.notation.text.spelling import nearest

Approach = Literal["smooth", "line", "hold"]  # a path into a point
Curve = Literal[Approach, "throw"]
CURVES: tuple[Curve, ...] = get_args(Curve)
MAX_POSITION = 1e3  # m; a key travels millimetres

# Division by a whole number rounds once, so that 6mm is exactly the float 0.006.
UNITS_PER_METRE = {"": 1e3, "mm": 1e3, "cm": 1e2, "m": 1.0, "um": 1e6, "µm": 1e6, "μm": 1e6}
UNITS_PER_BEAT = {"": 1.0, "beat": 1.0, "beats": 1.0}
UNITS_PER_SECOND = {"s": 1.0, "ms": 1e3}

_POSITION_PATTERN = rf"([+-]?{NUMBER})({UNIT})"
_TIME_PATTERN = rf"({NUMBER})(?:/({NUMBER}))?({UNIT})"
POINT_PATTERN = re.compile(rf"{_POSITION_PATTERN}@(\+?){_TIME_PATTERN}")
ROW_PATTERN = re.compile(
    rf"\s*+(?:{_TIME_PATTERN}\s++{_POSITION_PATTERN}(?:\s++(\w++))?\s*+)?(?:#.*)?"
)
_POSITION_REGEX = re.compile(_POSITION_PATTERN)
_TIME_REGEX = re.compile(_TIME_PATTERN)


def checked_curve(curve_name: str, word_offset: int) -> str:
    """Return `curve_name` if it names a curve. Raises TextError."""
    if curve_name in CURVES:
        return curve_name
    if _POSITION_REGEX.fullmatch(curve_name):
        raise TextError(
            f"'{curve_name}' has no time; write {curve_name}@1/4",
            offset=word_offset,
            length=len(curve_name),
        )
    raise TextError(
        f"unknown word '{curve_name[:40]}'; curves are {', '.join(CURVES)}",
        offset=word_offset,
        length=len(curve_name),
        suggestion=nearest(curve_name, CURVES),
    )


def parse_metres(number_text: str, unit_text: str, number_offset: int) -> float:
    """Return metres; `number_offset` is where the number begins."""
    divisor = UNITS_PER_METRE.get(unit_text)
    if divisor is None:
        raise TextError(
            f"unit '{unit_text}' does not measure position (use mm, cm, m, um)",
            offset=number_offset + len(number_text),
            length=len(unit_text),
            code="E203",
        )
    x = float(number_text) / divisor
    if not abs(x) <= MAX_POSITION:
        raise TextError(
            f"position {number_text[:40]} is too large",
            offset=number_offset,
            length=len(number_text),
        )
    return x


def parse_time(
    number_text: str, denominator: str | None, unit_text: str, number_offset: int
) -> tuple[float, float]:
    """Return (beats, seconds), one of them 0; `number_offset` is where the number begins."""
    time = time_of(number_text, denominator, number_offset)
    if (divisor := UNITS_PER_BEAT.get(unit_text)) is not None:
        return time / divisor, 0.0
    if (divisor := UNITS_PER_SECOND.get(unit_text)) is not None:
        return 0.0, time / divisor
    time_length = (
        len(number_text) if denominator is None else len(number_text) + 1 + len(denominator)
    )
    if unit_text in ("bar", "bars"):
        raise TextError(
            "a gesture has no bars, because their length depends "
            "on where it is played; write beats",
            offset=number_offset + time_length,
            length=len(unit_text),
            code="E203",
        )
    raise TextError(
        f"unit '{unit_text}' does not measure time (use beats without a unit, ms, s)",
        offset=number_offset + time_length,
        length=len(unit_text),
        code="E203",
    )


def point_error(point_word: str, word_offset: int) -> TextError:
    """Say why `point_word`, which has an @, is not a point."""
    position_text, _, time = point_word.partition("@")
    if not position_text:
        return TextError(
            f"the position is missing; write for instance 0mm{point_word}",
            offset=word_offset,
            length=len(point_word),
        )
    if not _POSITION_REGEX.fullmatch(position_text):
        ascii_position = position_text.replace("\u2212", "-")
        return TextError(
            f"'{position_text[:40]}' is not a position such as 6mm",
            offset=word_offset,
            length=len(position_text),
            suggestion=ascii_position if _POSITION_REGEX.fullmatch(ascii_position) else None,
        )
    time_offset = word_offset + len(position_text) + 1
    return _time_error(time, time_offset, point_word)


def _time_error(time_text: str, time_offset: int, word: str) -> TextError:
    if not time_text:
        return TextError(f"'{word[:40]}' has no time after its @", offset=time_offset - 1)
    if time_text.startswith("-") and _TIME_REGEX.fullmatch(time_text[1:]):
        return TextError(
            "a time cannot be negative; `do: [shift -1/8]` plays the gesture earlier",
            offset=time_offset,
            length=len(time_text),
        )
    return TextError(
        f"'{time_text[:40]}' is not a time such as 1/8, 0.5 or 250ms",
        offset=time_offset,
        length=len(time_text),
    )


def row_error(line: str, line_offset: int) -> TextError:
    """Say why a table's row is not `t x [curve]`."""
    word_matches = list(re.finditer(r"\S+", line.partition("#")[0]))
    if len(word_matches) > 3:
        extra_word = word_matches[3]
        return TextError(
            "a row has a time, a position and at most a curve word",
            offset=line_offset + extra_word.start(),
            length=len(extra_word.group()),
        )
    first_word = word_matches[0]
    if "@" in first_word.group():
        return TextError(
            "a row of a table is `t x` without '@', such as 1/8 6mm",
            offset=line_offset + first_word.start(),
            length=len(first_word.group()),
        )
    if not _TIME_REGEX.fullmatch(first_word.group()):
        return _time_error(first_word.group(), line_offset + first_word.start(), first_word.group())
    if len(word_matches) == 1:
        return TextError(
            "this row has a time and no position", offset=line_offset, length=first_word.end()
        )
    second_word = word_matches[1]
    if not _POSITION_REGEX.fullmatch(second_word.group()):
        return TextError(
            f"'{second_word.group()[:40]}' is not a position such as 6mm",
            offset=line_offset + second_word.start(),
            length=len(second_word.group()),
        )
    third_word = word_matches[2].group() if len(word_matches) > 2 else ""
    word_offset = word_matches[-1].start()
    return TextError(
        f"unknown word '{third_word[:40]}'; curves are {', '.join(CURVES)}",
        offset=line_offset + word_offset,
        length=len(word_matches[-1].group()),
        suggestion=nearest(third_word, CURVES),
    )
