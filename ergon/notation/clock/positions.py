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
    trimmed_text, text_start = stripped(text)
    length_match = _ONLY_LENGTH.fullmatch(trimmed_text)
    if length_match is None:
        duration = clock_time(trimmed_text)
        advice = "; write a clock time in seconds" if duration else ""
        raise TextError(
            f"'{trimmed_text[:40]}' is not a length such as 4bar, 1/2 or 250ms{advice}",
            offset=text_start,
            length=max(1, len(trimmed_text)),
            suggestion=duration or _without_spaces(trimmed_text),
        )
    return _length(length_match, 1, text_start)


def parse_position(position_text: str) -> Position:
    """Read `3|2.5`, `B`, `B+2`, `B - 1bar`, `12.5s`, `250ms`, or beats from the start.

    Marks are looked up when the position is resolved. Raises TextError.
    """
    trimmed_text, text_start = stripped(position_text)
    if match := _BAR_BEAT.fullmatch(trimmed_text):
        bar = int(match[1])
        beat_in_bar = time_of(match[2], match[3], text_start + match.start(2))
        if bar < 1 or beat_in_bar < 1.0:
            raise TextError(
                "bars and beats count from 1; the beginning of the piece is 1|1",
                offset=text_start,
                length=len(match[1]) + 1 + len(match[2]),
            )
        return Position(
            bar=bar, beat=beat_in_bar, plus=_plus(match, 4, text_start), text=trimmed_text
        )
    if match := _ONLY_LENGTH.fullmatch(trimmed_text):
        length = _length(match, 1, text_start)
        if length.bars:
            raise TextError(
                f"a number of bars is not a position; write {match[1]}|1, or a mark and a length",
                offset=text_start,
                length=len(trimmed_text),
                suggestion=f"{match[1]}|1",
            )
        return Position(plus=length, text=trimmed_text)
    if match := _MARK.fullmatch(trimmed_text):
        return Position(mark=match[1], plus=_plus(match, 2, text_start), text=trimmed_text)
    if (duration := clock_time(trimmed_text)) is not None:
        minutes, _, seconds_text = trimmed_text.rpartition(":")
        message = f"'{trimmed_text}' is a clock time: write {duration}"
        if minutes.isdigit():
            message = (
                f"'{trimmed_text}' may be a clock time or a bar and a beat: write {duration} for "
            )
            message += (
                f"{minutes} min {seconds_text} s, or {minutes}|{seconds_text} for beat "
                f"{seconds_text} of bar {minutes}"
            )
        raise TextError(message, offset=text_start, length=len(trimmed_text), suggestion=duration)
    raise TextError(
        f"'{trimmed_text[:40]}' is not a position such as 3|2.5, B+2, 12.5s or a number of beats",
        offset=text_start,
        length=max(1, len(trimmed_text)),
        suggestion=_with_bar(trimmed_text) or _without_spaces(trimmed_text),
    )


def parse_mark(position_text: str) -> Position:
    """Read the position of a mark, where `3.1` has a unit. Raises TextError."""
    position = parse_position(position_text)
    trimmed_text, text_start = stripped(position_text)
    if (match := _LIKE_BAR_BEAT.fullmatch(trimmed_text)) and position.plus.is_some:
        bar, beat_text = match.groups()
        message = (
            f"'{trimmed_text}' has no unit; it could be bar {bar}, beat {beat_text} "
            f"({bar}|{beat_text}), or "
        )
        message += f"{trimmed_text} beats after the beginning ({trimmed_text}beats)"
        suggestion = f"{bar}|{beat_text}"
        raise TextError(
            message, offset=text_start, length=len(trimmed_text), suggestion=suggestion, code="E203"
        )
    return position


def _without_spaces(word: str) -> str | None:
    joined = "".join(word.split())
    length_match = _ONLY_LENGTH.fullmatch(joined)
    return joined if joined != word and length_match and length_match[3] in _UNITS else None


def _with_bar(written_word: str) -> str | None:
    """`5:1` and `bar 5`, as they are written here."""
    if bar_match := re.fullmatch(r"([0-9]{1,9})\s*+[:/]\s*+([0-9.]+)", written_word):
        return f"{bar_match[1]}|{bar_match[2]}"
    bar_match = re.fullmatch(r"bar\s*+([0-9]{1,9})", written_word)
    return f"{bar_match[1]}|1" if bar_match else None


def _plus(plus_match: re.Match[str], first_group: int, word_start: int) -> Length:
    plus_sign = plus_match[first_group]
    if plus_sign is None:
        return _NOTHING
    return _length(plus_match, first_group + 1, word_start).times(-1.0 if plus_sign == "-" else 1.0)


def _length(match: re.Match[str], first_group: int, word_start: int) -> Length:
    length_value = time_of(
        match[first_group], match[first_group + 1], word_start + match.start(first_group)
    )
    unit_text = match[first_group + 2]
    if unit_text not in _UNITS:
        raise TextError(
            f"unit '{unit_text}' does not measure time (use beats without a unit, bar, ms, s)",
            offset=word_start + match.start(first_group + 2),
            length=len(unit_text),
            code="E203",
        )
    name, divisor = _UNITS[unit_text]
    return Length(**{name: length_value / divisor})
