"""Positions and lengths as written, before any tempo is known: `3|2.5`, `B+2`, `12.5s`, `4bar`.

Bars and the beats in them count from 1, so `1|1` is the beginning. A bare number counts beats
that have passed since the beginning, so `0` is `1|1` and `4` is `2|1` in 4/4.
"""

import re
from dataclasses import dataclass, field

from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import NUMBER, UNIT, clock_time, stripped, time_of

# For each unit: the field of Length that it fills, and the divisor of a value in it. A division
# rounds once.
_UNITS = {
    "": ("beats", 1.0),
    "beat": ("beats", 1.0),
    "beats": ("beats", 1.0),
    "bar": ("bars", 1.0),
    "bars": ("bars", 1.0),
    "s": ("seconds", 1.0),
    "ms": ("seconds", 1e3),
}
_LENGTH = rf"({NUMBER})(?:/({NUMBER}))?({UNIT})"
_ONLY_LENGTH = re.compile(_LENGTH)
_PLUS = rf"(?:\s*([+-])\s*{_LENGTH})?"
_BAR_BEAT = re.compile(rf"([0-9]{{1,9}})\|({NUMBER})(?:/({NUMBER}))?{_PLUS}")
# A minus before a digit subtracts; before a letter it belongs to the name.
_MARK = re.compile(rf"([^\W\d]\w*+(?:-[^\W\d]\w*+)*+){_PLUS}")


@dataclass(frozen=True, slots=True)
class Length:
    """A length as written, in bars, beats or seconds; fields that are not written are 0.

    Lengths of a MIDI file are in quarter notes, which are beats where the meter has quarters.
    """

    bars: float = 0.0
    beats: float = 0.0
    seconds: float = 0.0
    quarters: float = field(default=0.0, metadata={"hash_omits_empty": True})

    def times(self, count: float) -> "Length":
        """The length `count` times over."""
        bars, beats, seconds = self.bars * count, self.beats * count, self.seconds * count
        return Length(bars, beats, seconds, self.quarters * count)

    @property
    def is_some(self) -> bool:
        """Whether it is longer than nothing."""
        return max(self.bars, self.beats, self.seconds, self.quarters) > 0.0


@dataclass(frozen=True, slots=True)
class Position:
    """An instant as written: `plus` after a mark, else after a bar and beat, else after the
    start.
    """

    mark: str | None = None
    bar: int | None = None
    beat: float = 1.0
    plus: Length = field(default_factory=Length)
    text: str = ""


_LIKE_BAR_BEAT = re.compile(r"([0-9]+)\.([1-9])")
_NOTHING = Length()  # most positions add nothing: they share it


def parse_length(text: str) -> Length:
    """Read `4bar`, `2`, `1/4`, `500ms`, `12s`. Raises TextError."""
    word, start = stripped(text)
    match = _ONLY_LENGTH.fullmatch(word)
    if match is None:
        seconds = clock_time(word)
        advice = "; write a clock time in seconds" if seconds else ""
        raise TextError(
            f"'{word[:40]}' is not a length such as 4bar, 1/2 or 250ms{advice}",
            offset=start,
            length=max(1, len(word)),
            suggestion=seconds or _without_spaces(word),
        )
    return _length(match, 1, start)


def parse_position(text: str) -> Position:
    """Read `3|2.5`, `B`, `B+2`, `B - 1bar`, `12.5s`, `250ms`, or beats from the start.

    Marks are looked up when the position is resolved. Raises TextError.
    """
    word, start = stripped(text)
    if match := _BAR_BEAT.fullmatch(word):
        bar = int(match[1])
        beat = time_of(match[2], match[3], start + match.start(2))
        if bar < 1 or beat < 1.0:
            raise TextError(
                "bars and beats count from 1; the beginning of the piece is 1|1",
                offset=start,
                length=len(match[1]) + 1 + len(match[2]),
            )
        return Position(bar=bar, beat=beat, plus=_plus(match, 4, start), text=word)
    if match := _ONLY_LENGTH.fullmatch(word):
        length = _length(match, 1, start)
        if length.bars:
            raise TextError(
                f"a number of bars is not a position; write {match[1]}|1, or a mark and a length",
                offset=start,
                length=len(word),
                suggestion=f"{match[1]}|1",
            )
        return Position(plus=length, text=word)
    if match := _MARK.fullmatch(word):
        return Position(mark=match[1], plus=_plus(match, 2, start), text=word)
    if (seconds := clock_time(word)) is not None:
        minutes, _, seconds_text = word.rpartition(":")
        message = f"'{word}' is a clock time: write {seconds}"
        if minutes.isdigit():
            message = f"'{word}' may be a clock time or a bar and a beat: write {seconds} for "
            message += (
                f"{minutes} min {seconds_text} s, or {minutes}|{seconds_text} for beat "
                f"{seconds_text} of bar {minutes}"
            )
        raise TextError(
            message,
            offset=start,
            length=len(word),
            suggestion=seconds,
        )
    raise TextError(
        f"'{word[:40]}' is not a position such as 3|2.5, B+2, 12.5s or a number of beats",
        offset=start,
        length=max(1, len(word)),
        suggestion=_with_bar(word) or _without_spaces(word),
    )


def parse_mark(text: str) -> Position:
    """Read the position of a mark, where `3.1` has a unit. Raises TextError."""
    position = parse_position(text)
    word, start = stripped(text)
    if (match := _LIKE_BAR_BEAT.fullmatch(word)) and position.plus.is_some:
        bar, beat = match.groups()
        message = f"'{word}' has no unit; it could be bar {bar}, beat {beat} ({bar}|{beat}), or "
        message += f"{word} beats after the beginning ({word}beats)"
        suggestion = f"{bar}|{beat}"
        raise TextError(message, offset=start, length=len(word), suggestion=suggestion, code="E203")
    return position


def _without_spaces(word: str) -> str | None:
    joined = "".join(word.split())
    is_length = _ONLY_LENGTH.fullmatch(joined)
    return joined if joined != word and is_length and is_length[3] in _UNITS else None


def _with_bar(word: str) -> str | None:
    """`5:1` and `bar 5`, as they are written here."""
    if match := re.fullmatch(r"([0-9]{1,9})\s*+[:/]\s*+([0-9.]+)", word):
        return f"{match[1]}|{match[2]}"
    match = re.fullmatch(r"bar\s*+([0-9]{1,9})", word)
    return f"{match[1]}|1" if match else None


def _plus(match: re.Match[str], first_group: int, start: int) -> Length:
    sign = match[first_group]
    if sign is None:
        return _NOTHING
    return _length(match, first_group + 1, start).times(-1.0 if sign == "-" else 1.0)


def _length(match: re.Match[str], first_group: int, start: int) -> Length:
    value = time_of(match[first_group], match[first_group + 1], start + match.start(first_group))
    unit = match[first_group + 2]
    if unit not in _UNITS:
        raise TextError(
            f"unit '{unit}' does not measure time (use beats without a unit, bar, ms, s)",
            offset=start + match.start(first_group + 2),
            length=len(unit),
            code="E203",
        )
    name, divisor = _UNITS[unit]
    return Length(**{name: value / divisor})
