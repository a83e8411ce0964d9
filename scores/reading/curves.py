"""Curves of a parameter: the notation of gestures, with values in place of positions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import cast

from ergon.notation.text.errors import TextError
from ergon.notation.text.values import Time
from ergon.scores.gesture import notation
from ergon.scores.gesture.points import Approach
from ergon.scores.pattern.values import Amount, ReadAmount

MAX_POINTS = 1_000  # with repetitions
_VALUE_PATTERN = re.compile(r"(?<![^\s(])[^\s()|@]+(?=@)")


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """A value at a time from where the curve begins, and the way to it."""

    at: Time
    amount: Amount
    way: Approach


def is_curve(text: str) -> bool:
    """Whether a text says when each of its values is reached."""
    return "@" in text


def parse_curve(curve_text: str, read_amount: ReadAmount) -> tuple[CurvePoint, ...]:
    """Read `A3@0 smooth C4@2`, its values by `read_amount`. Raises TextError with the characters at
    fault.
    """
    amounts: list[Amount] = []
    moved_offsets: list[tuple[int, int]] = []  # (offset in the parsed text, offset as written)
    notation_pieces, text_offset, parsed_length = [], 0, 0
    for value_match in _VALUE_PATTERN.finditer(curve_text):
        try:
            amount = read_amount(value_match.group())
        except TextError as error:
            error.offset += value_match.start()
            raise
        if amount not in amounts:
            amounts.append(amount)
        # Write each value as a position of a gesture: its index in metres.
        for notation_piece in (
            curve_text[text_offset : value_match.start()],
            f"{amounts.index(amount)}m",
        ):
            notation_pieces.append(notation_piece)
            parsed_length += len(notation_piece)
        text_offset = value_match.end()
        moved_offsets.append((parsed_length, text_offset))
    notation_pieces.append(curve_text[text_offset:])
    try:
        curve_points = notation.parse("".join(notation_pieces), events_max=MAX_POINTS).points
    except TextError as error:
        offsets_before = [
            offset_pair for offset_pair in moved_offsets if offset_pair[0] <= error.offset
        ]
        if offsets_before:
            error.offset += offsets_before[-1][1] - offsets_before[-1][0]
        if isinstance(error, notation.HoldMovesError):
            error.message = "'hold' keeps the value; this point has another"
        error.length = max(1, min(error.length, len(curve_text) - error.offset))
        raise
    if curve_points[0].at != Time():
        raise TextError(
            "a curve begins at 0: write its first value as VALUE@0", length=len(curve_text)
        )
    points = []
    for curve_point in curve_points:
        if curve_point.curve == "throw":
            raise TextError(
                "`throw` is for gestures only; write smooth or line", length=len(curve_text)
            )
        points.append(
            CurvePoint(
                curve_point.at, amounts[round(curve_point.x)], cast("Approach", curve_point.curve)
            )
        )
    return tuple(points)
