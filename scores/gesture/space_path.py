"""Paths of a point in space: `(0, 0, 0)@0 smooth (6, 0, 2)@1/4` is a gesture for each axis.

A point has a position for each axis, in brackets; everything else is as in the notation of one
axis, with the same error messages.
"""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import replace
from typing import NamedTuple

from ergon.notation.tables.value_kinds import AXES
from ergon.notation.text.errors import TextError
from ergon.scores.gesture import notation
from ergon.scores.gesture.notation import MAX_EVENTS, Notation

# Brackets with a comma and without a time (a group has times).
_POSITIONS_PATTERN = re.compile(r"\(([^()|@]*,[^()|@]*)\)")
_BARE_POSITION_PATTERN = re.compile(r"[^\s()|@]*@\S*")


class _Brackets(NamedTuple):
    """The positions of one point: where the brackets begin and end, and the offset of each
    position.
    """

    start: int
    stop: int
    positions: tuple[tuple[int, str], ...]


class _PositionInText(NamedTuple):
    """A position in the text: where its brackets begin, where it begins itself, and its length."""

    bracket_start: int
    position_start: int
    length: int


def axis_count(text: str) -> int:
    """The number of positions that each point of a notation has; 1 if it is not a path in space."""
    match = _POSITIONS_PATTERN.search(text)
    return 1 if match is None else match[1].count(",") + 1


def played_names(gesture_name: str, gesture_names: Container[str]) -> tuple[str, ...]:
    """The names by which a gesture is played: its own, or, for a path, those of its axes, such as
    `pour.x`.
    """
    return tuple(
        axis_name
        for axis_name in (gesture_name, *(f"{gesture_name}.{axis}" for axis in AXES))
        if axis_name in gesture_names
    )


def parse(
    path_text: str, curve: str = "smooth", events_max: int = MAX_EVENTS
) -> tuple[Notation, ...]:
    """Read a path in space, axis by axis; `curve` and `events_max` are those of `notation.parse`.

    Raises TextError with the characters at fault.
    """
    bracket_points = [
        _bracketed_positions(match) for match in _POSITIONS_PATTERN.finditer(path_text)
    ]
    n_axes = axis_count(path_text)
    _check_positions(path_text, bracket_points, n_axes)
    return tuple(
        _axis_notation(path_text, bracket_points, axis, curve, events_max // n_axes)
        for axis in range(n_axes)
    )


def _bracketed_positions(bracket_match: re.Match[str]) -> _Brackets:
    positions, part_offset = [], bracket_match.start(1)
    for part in bracket_match[1].split(","):
        positions.append((part_offset + len(part) - len(part.lstrip()), part.strip()))
        part_offset += len(part) + 1
    return _Brackets(bracket_match.start(), bracket_match.end(), tuple(positions))


def _check_positions(path_text: str, points: Sequence[_Brackets], n_axes: int) -> None:
    """Check that each point has as many positions as the first, two or three, and a time."""
    for bracket_start, bracket_stop, positions in points:
        point_text = path_text[bracket_start:bracket_stop]
        if not 2 <= len(positions) <= len(AXES):
            message = f"a point in space has two or three positions, not {len(positions)}"
            raise TextError(message, offset=bracket_start, length=bracket_stop - bracket_start)
        if len(positions) != n_axes:
            message = f"this point has {len(positions)} positions, and the first has {n_axes}"
            raise TextError(message, offset=bracket_start, length=bracket_stop - bracket_start)
        if path_text[bracket_stop : bracket_stop + 1] != "@":
            message = f"'{point_text[:40]}' has no time; write {point_text[:40]}@1/4"
            raise TextError(message, offset=bracket_start, length=bracket_stop - bracket_start)
    for bare_match in _BARE_POSITION_PATTERN.finditer(path_text):
        if path_text[bare_match.start() - 1 : bare_match.start()] != ")" or bare_match[0][0] != "@":
            example = ", ".join(("0mm",) * n_axes)
            message = f"this point has one position; write one for each axis: ({example})@…"
            raise TextError(message, offset=bare_match.start(), length=len(bare_match[0]))


def _axis_notation(
    path_text: str, bracket_points: Sequence[_Brackets], axis: int, curve: str, events_max: int
) -> Notation:
    """The notation along one axis, with offsets into the text as written."""
    pieces: list[str] = []
    piece_end = 0
    # By the offset of a position in the text that is parsed: where it is in the text as written.
    positions_by_offset: dict[int, _PositionInText] = {}
    for bracket_start, bracket_stop, positions in bracket_points:
        part_offset, axis_text = positions[axis]
        # The replacement has the same length, with the position next to its time, so that other
        # offsets stay.
        pieces += (
            path_text[piece_end:bracket_start],
            axis_text.rjust(bracket_stop - bracket_start),
        )
        positions_by_offset[bracket_stop - len(axis_text)] = _PositionInText(
            bracket_start, part_offset, len(axis_text)
        )
        piece_end = bracket_stop
    try:
        axis_notation = notation.parse("".join((*pieces, path_text[piece_end:])), curve, events_max)
    except TextError as error:
        parsed_offset = max(
            (begin_offset for begin_offset in positions_by_offset if begin_offset <= error.offset),
            default=-1,
        )
        if parsed_offset >= 0 and error.offset <= parsed_offset + max(
            0, positions_by_offset[parsed_offset].length - 1
        ):
            error.offset += positions_by_offset[parsed_offset].position_start - parsed_offset
        raise
    placed_points = []
    for axis_point in axis_notation.points:
        bracket_start = positions_by_offset[axis_point.offset].bracket_start
        length = axis_point.offset + axis_point.length - bracket_start
        placed_points.append(replace(axis_point, offset=bracket_start, length=length))
    return replace(axis_notation, points=tuple(placed_points))
