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

_POSITION = rf"([+-]?{NUMBER})({UNIT})"
_TIME = rf"({NUMBER})(?:/({NUMBER}))?({UNIT})"
POINT = re.compile(rf"{_POSITION}@(\+?){_TIME}")
ROW = re.compile(rf"\s*+(?:{_TIME}\s++{_POSITION}(?:\s++(\w++))?\s*+)?(?:#.*)?")
_ONLY_POSITION = re.compile(_POSITION)
_ONLY_TIME = re.compile(_TIME)


def curve_word(word: str, offset: int) -> str:
    """Return `word` if it names a curve. Raises TextError."""
    if word in CURVES:
        return word
    if _ONLY_POSITION.fullmatch(word):
        raise TextError(f"'{word}' has no time; write {word}@1/4", offset=offset, length=len(word))
    raise TextError(
        f"unknown word '{word[:40]}'; curves are {', '.join(CURVES)}",
        offset=offset,
        length=len(word),
        suggestion=nearest(word, CURVES),
    )


def metres(number: str, unit: str, offset: int) -> float:
    """Return metres; `offset` is where the number begins."""
    divisor = UNITS_PER_METRE.get(unit)
    if divisor is None:
        raise TextError(
            f"unit '{unit}' does not measure position (use mm, cm, m, um)",
            offset=offset + len(number),
            length=len(unit),
            code="E203",
        )
    x = float(number) / divisor
    if not abs(x) <= MAX_POSITION:
        raise TextError(f"position {number[:40]} is too large", offset=offset, length=len(number))
    return x


def instant(number: str, denominator: str | None, unit: str, offset: int) -> tuple[float, float]:
    """Return (beats, seconds), one of them 0; `offset` is where the number begins."""
    time = time_of(number, denominator, offset)
    if (scale := UNITS_PER_BEAT.get(unit)) is not None:
        return time / scale, 0.0
    if (scale := UNITS_PER_SECOND.get(unit)) is not None:
        return 0.0, time / scale
    length = len(number) if denominator is None else len(number) + 1 + len(denominator)
    if unit in ("bar", "bars"):
        raise TextError(
            "a gesture has no bars, because their length depends "
            "on where it is played; write beats",
            offset=offset + length,
            length=len(unit),
            code="E203",
        )
    raise TextError(
        f"unit '{unit}' does not measure time (use beats without a unit, ms, s)",
        offset=offset + length,
        length=len(unit),
        code="E203",
    )


def point_error(word: str, offset: int) -> TextError:
    """Say why `word`, which has an @, is not a point."""
    position, _, time = word.partition("@")
    if not position:
        return TextError(
            f"the position is missing; write for instance 0mm{word}",
            offset=offset,
            length=len(word),
        )
    if not _ONLY_POSITION.fullmatch(position):
        ascii_position = position.replace("\u2212", "-")
        return TextError(
            f"'{position[:40]}' is not a position such as 6mm",
            offset=offset,
            length=len(position),
            suggestion=ascii_position if _ONLY_POSITION.fullmatch(ascii_position) else None,
        )
    time_offset = offset + len(position) + 1
    return _time_error(time, time_offset, word)


def _time_error(time: str, offset: int, word: str) -> TextError:
    if not time:
        return TextError(f"'{word[:40]}' has no time after its @", offset=offset - 1)
    if time.startswith("-") and _ONLY_TIME.fullmatch(time[1:]):
        return TextError(
            "a time cannot be negative; `do: [shift -1/8]` plays the gesture earlier",
            offset=offset,
            length=len(time),
        )
    return TextError(
        f"'{time[:40]}' is not a time such as 1/8, 0.5 or 250ms", offset=offset, length=len(time)
    )


def row_error(line: str, offset: int) -> TextError:
    """Say why a table's row is not `t x [curve]`."""
    words = list(re.finditer(r"\S+", line.partition("#")[0]))
    if len(words) > 3:
        extra_word = words[3]
        return TextError(
            "a row has a time, a position and at most a curve word",
            offset=offset + extra_word.start(),
            length=len(extra_word.group()),
        )
    first_word = words[0]
    if "@" in first_word.group():
        return TextError(
            "a row of a table is `t x` without '@', such as 1/8 6mm",
            offset=offset + first_word.start(),
            length=len(first_word.group()),
        )
    if not _ONLY_TIME.fullmatch(first_word.group()):
        return _time_error(first_word.group(), offset + first_word.start(), first_word.group())
    if len(words) == 1:
        return TextError(
            "this row has a time and no position", offset=offset, length=first_word.end()
        )
    second = words[1]
    if not _ONLY_POSITION.fullmatch(second.group()):
        return TextError(
            f"'{second.group()[:40]}' is not a position such as 6mm",
            offset=offset + second.start(),
            length=len(second.group()),
        )
    third = words[2].group() if len(words) > 2 else ""
    word_offset = words[-1].start()
    return TextError(
        f"unknown word '{third[:40]}'; curves are {', '.join(CURVES)}",
        offset=offset + word_offset,
        length=len(words[-1].group()),
        suggestion=nearest(third, CURVES),
    )
