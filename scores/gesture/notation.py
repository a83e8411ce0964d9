"""Written gestures: `0mm@0 smooth 6mm@1/8 (0mm@1/4 6mm@1/2)*4`, and tables of `t x [curve]`.

A bare position counts millimetres, a bare time beats; `1/8` is an eighth of a beat. Positions
become metres. A point's curve is the last curve word written to its left, so every repetition of
a group plays alike. A point that repeats the one before it (same instant, same position) adds
nothing and is left out: `(0@0 6@1/8 0@1/4)*4` may name its own beginning.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

from ergon._core import poll
from ergon.notation.text.errors import TextError
from ergon.notation.text.numbers import MAX_TIME
from ergon.notation.text.spelling import nearest
from ergon.notation.text.values import Point, Time
from ergon.scores.gesture.points import (
    CURVES,
    POINT_PATTERN,
    ROW_PATTERN,
    checked_curve,
    parse_metres,
    parse_time,
    point_error,
    row_error,
)

MAX_DEPTH = 8  # groups inside groups
MAX_EVENTS = 500_000  # points after expansion: some 140 MB while they are read
ROUNDING_TOLERANCE = 1e-9  # tolerance for rounding: beats, seconds, metres

_TOKEN_PATTERN = re.compile(r"(\()|(\))(?:\s*+\*\s*+([^\s()|]++))?|(\|)|([^\s()|]++)")


class HoldMovesError(TextError):
    """A point with `hold` that is elsewhere than the one before it."""


@dataclass(frozen=True, slots=True)
class BarCheck:
    """A `|`: the instant of the point before it should be on a bar."""

    at: Time
    offset: int


@dataclass(frozen=True, slots=True)
class Notation:
    """A gesture as written: its points in order of time, and its bar checks."""

    points: tuple[Point, ...]
    bar_checks: tuple[BarCheck, ...] = ()


class _TimedEvent(NamedTuple):
    """A point (or, where x is None, a bar check) at a time from the start of its group."""

    beats: float
    seconds: float
    x: float | None
    curve: str
    offset: int
    length: int


class _Group:
    """An open bracket: its events so far, in times from its own start."""

    def __init__(self, offset: int, events_max: int = MAX_EVENTS) -> None:
        self.offset = offset
        self.events_max = events_max
        self.events: list[_TimedEvent] = []
        self.beats = 0.0
        self.seconds = 0.0

    def add_point(self, match: re.Match[str], curve: str, offset: int) -> None:
        """Add the point of `match`. Raises TextError if it lies before the last."""
        point_word = match.group()
        x, x_unit, plus, t, denominator, t_unit = match.groups()
        x_metres = parse_metres(x, x_unit, offset)
        beats, seconds = parse_time(t, denominator, t_unit, offset + match.start(4))
        if plus:
            beats += self.beats
            seconds += self.seconds
        self._advance(beats, seconds, offset + match.start(4), len(point_word) - match.start(4))
        self.events.append(_TimedEvent(beats, seconds, x_metres, curve, offset, len(point_word)))

    def add_row(self, match: re.Match[str], default_curve: str, offset: int) -> None:
        """Add the point of a table row."""
        t, denominator, t_unit, x, x_unit, curve_name = match.groups()
        row_start = offset + match.start(1)
        beats, seconds = parse_time(t, denominator, t_unit, row_start)
        x_metres = parse_metres(x, x_unit, offset + match.start(4))
        curve = (
            default_curve
            if curve_name is None
            else checked_curve(curve_name, offset + match.start(6))
        )
        self._advance(beats, seconds, row_start, match.end(3) - match.start(1))
        stop = match.end(5) if curve_name is None else match.end(6)
        self.events.append(
            _TimedEvent(beats, seconds, x_metres, curve, row_start, stop - match.start(1))
        )

    def add_bar_check(self, offset: int) -> None:
        self.events.append(_TimedEvent(self.beats, self.seconds, None, "", offset, 1))

    def add_repeated(self, group: "_Group", count: int, offset: int) -> None:
        """Add the events of a closed group `count` times, each from the end of the one before."""
        if len(self.events) + count * len(group.events) > self.events_max:
            raise TextError(
                _too_many_message("this group makes", self.events_max), offset=offset, length=1
            )
        if max(self.beats + count * group.beats, self.seconds + count * group.seconds) > MAX_TIME:
            raise TextError("this group lasts too long", offset=offset, length=1)
        for repetition in range(count):
            beats = self.beats + repetition * group.beats
            seconds = self.seconds + repetition * group.seconds
            self.events.extend(
                _TimedEvent(
                    beats + event.beats,
                    seconds + event.seconds,
                    event.x,
                    event.curve,
                    event.offset,
                    event.length,
                )
                for event in group.events
            )
        self.beats += count * group.beats
        self.seconds += count * group.seconds

    def _advance(self, beats: float, seconds: float, offset: int, length: int) -> None:
        # Beats and seconds can be compared only with a tempo; a point that is earlier in both is an
        # error.
        is_early = (
            beats < self.beats - ROUNDING_TOLERANCE or seconds < self.seconds - ROUNDING_TOLERANCE
        )
        if (
            is_early
            and beats <= self.beats + ROUNDING_TOLERANCE
            and seconds <= self.seconds + ROUNDING_TOLERANCE
        ):
            raise TextError(
                "this point is earlier than the point before it; times must rise",
                offset=offset,
                length=length,
            )
        self.beats, self.seconds = beats, seconds


def parse(text: str, first_curve: str = "smooth", events_max: int = MAX_EVENTS) -> Notation:
    """Read one-line notation; `first_curve` is that of points before the first curve word.

    More than `events_max` points are refused. Raises TextError with the characters at fault.
    """
    poll()
    stack = [_Group(0, events_max)]
    pending_curve: tuple[str, int] | None = None  # a curve word without its point
    for token_match in _TOKEN_PATTERN.finditer(text):
        open_sign, close_sign, count_text, bar_sign, point_or_curve = token_match.groups()
        if open_sign:
            _require_point(stack, token_match.start(1), open_sign)
            if len(stack) > MAX_DEPTH:
                raise TextError(
                    f"groups are nested more than {MAX_DEPTH} deep", offset=token_match.start(1)
                )
            stack.append(_Group(token_match.start(1), events_max))
        elif close_sign:
            _refuse_pending_curve(pending_curve)
            _close_group(stack, token_match, count_text)
        elif bar_sign:
            _require_point(stack, token_match.start(4), bar_sign)
            stack[-1].add_bar_check(token_match.start(4))
        elif point := POINT_PATTERN.fullmatch(point_or_curve):
            stack[-1].add_point(point, first_curve, token_match.start(5))
            pending_curve = None
        else:
            word_offset = token_match.start(5)
            if "@" in point_or_curve:
                raise point_error(point_or_curve, word_offset)
            _require_point(stack, word_offset, point_or_curve)
            _refuse_pending_curve(pending_curve)
            first_curve = checked_curve(point_or_curve, word_offset)
            pending_curve = (point_or_curve, word_offset)
        if len(stack[-1].events) > events_max:
            raise TextError(
                _too_many_message("this notation has", events_max), offset=token_match.start()
            )
    _refuse_pending_curve(pending_curve)
    if len(stack) > 1:
        raise TextError("this group is not closed; write ( … )*4", offset=stack[-1].offset)
    return _checked_points(stack[0].events)


def parse_table(text: str, curve: str = "smooth", events_max: int = MAX_EVENTS) -> Notation:
    """Read rows `t x [curve]`; `curve` is that of rows without a curve word.

    More than `events_max` rows are refused. `#` starts a comment. Raises TextError with the
    characters at fault.
    """
    poll()
    group = _Group(0)
    line_offset = 0
    for table_line in text.split("\n"):
        row_match = ROW_PATTERN.fullmatch(table_line.rstrip("\r"))
        if row_match is None:
            raise row_error(table_line, line_offset)
        if row_match.group(1) is not None:
            group.add_row(row_match, curve, line_offset)
            if len(group.events) > events_max:
                raise TextError(_too_many_message("this table has", events_max), offset=line_offset)
        line_offset += len(table_line) + 1
    return _checked_points(group.events)


def _require_point(stack: list[_Group], sign_offset: int, sign_word: str) -> None:
    if len(stack) == 1 and not stack[0].events:
        example = (
            "0mm@0 before the group: 0mm@0 ( … )*4" if sign_word == "(" else "one, such as 0mm@0"
        )
        raise TextError(
            f"a notation begins with a point; write {example}",
            offset=sign_offset,
            length=len(sign_word),
            suggestion=None
            if sign_word in "(|" or sign_word in CURVES
            else nearest(sign_word, CURVES),
        )


def _refuse_pending_curve(pending_curve: tuple[str, int] | None) -> None:
    if pending_curve is not None:
        word, offset = pending_curve
        raise TextError(f"'{word}' has no point after it", offset=offset, length=len(word))


def _close_group(stack: list[_Group], token_match: re.Match[str], count_text: str | None) -> None:
    count_offset = token_match.start(2)
    if len(stack) == 1:
        raise TextError("')' has no '(' before it", offset=count_offset)
    if count_text is None:
        raise TextError(
            "this group has no number of repetitions; write ( … )*4", offset=count_offset
        )
    if not re.fullmatch(r"[0-9]{1,9}", count_text) or int(count_text) == 0:
        raise TextError(
            f"'{count_text}' is not a number of repetitions; write ( … )*4",
            offset=token_match.start(3),
            length=len(count_text),
        )
    closed_group = stack.pop()
    if all(event.x is None for event in closed_group.events):
        raise TextError("this group has no points", offset=closed_group.offset)
    stack[-1].add_repeated(closed_group, int(count_text), closed_group.offset)


def _checked_points(notation_events: list[_TimedEvent]) -> Notation:
    """Check points against their neighbours, and leave out points that repeat the one before."""
    joined_points: list[Point] = []
    bar_checks: list[BarCheck] = []
    last_event: _TimedEvent | None = None
    notation_events.reverse()
    while notation_events:  # popped, to free memory: there may be a million
        next_event = notation_events.pop()
        x = next_event.x
        time = Time(next_event.beats, next_event.seconds)
        if x is None:
            bar_checks.append(BarCheck(time, next_event.offset))
            continue
        if last_event is not None and last_event.x is not None:
            is_still = abs(x - last_event.x) <= ROUNDING_TOLERANCE
            if next_event.curve == "hold" and not is_still:
                raise HoldMovesError(
                    f"'hold' keeps the position {_millimetres_text(last_event.x)}; "
                    f"this point is at {_millimetres_text(x)}",
                    offset=next_event.offset,
                    length=next_event.length,
                    suggestion="smooth",
                )
            if next_event.curve == "hold":
                x = joined_points[-1].x  # the engine compares them exactly
            if (
                abs(time[0] - last_event.beats) <= ROUNDING_TOLERANCE
                and abs(time[1] - last_event.seconds) <= ROUNDING_TOLERANCE
            ):
                if is_still:
                    continue
                raise TextError(
                    "this point has the same time as the point before it",
                    offset=next_event.offset,
                    length=next_event.length,
                )
        joined_points.append(Point(time, x, next_event.curve, next_event.offset, next_event.length))
        last_event = next_event
    if not joined_points:
        raise TextError("a gesture needs a point, such as 0mm@0")
    return Notation(tuple(joined_points), tuple(bar_checks))


def _too_many_message(subject: str, count_max: int) -> str:
    if count_max > 0:
        return f"{subject} more than {count_max:,} points"
    return f"the gestures of the piece have more than {MAX_EVENTS:,} points together"


def _millimetres_text(x: float) -> str:
    return f"{x * 1e3:g}mm"
