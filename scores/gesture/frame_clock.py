"""Frames of motion capture follow each other at the rate that their file states.

A row says its number, its instant, or both. Where frames are missing between two rows, a reader
that counts rows would compress time; so the file is refused, with the line.
"""

from __future__ import annotations

import math
from decimal import Decimal, InvalidOperation
from pathlib import Path

from ergon.scores.gesture.take_file import TakeError

RATE_TOLERANCE = 0.05  # part of a frame by which instants may differ from the stated rate
_STEP_TOLERANCE = 0.5  # part of a frame by which one step may differ
_FINE_RESOLUTION = 0.25  # part of a frame: instants that are rounded no more tell frames apart
_HELP_TEXT = (
    "fill the gap in the program that captured it, or export the frames before or behind it"
)


def instant_and_step(cell_text: str) -> tuple[float, float] | None:
    """The number in a cell, and the step to which its text rounds it; None if it is none."""
    try:
        number = Decimal(cell_text.strip())
    except InvalidOperation:
        return None
    exponent = number.as_tuple().exponent
    if not isinstance(exponent, int) or not abs(number) <= 10**12:
        return None
    return float(number), 10.0 ** max(exponent, -300)


class FrameClock:
    """Follows the rows of a file, and refuses steps in which frames are missing."""

    def __init__(self, rate: float | None, path: Path) -> None:
        """Begin before the first row; without a `rate` [Hz] only numbers are followed."""
        self._rate, self._path = rate, path
        self._resolution = math.inf  # [s] the finest step of the instants so far
        self._first_instant: float | None = None
        self._instant: float | None = None
        self._number: float | None = None
        self._number_step: float | None = None  # between numbers; programs leave some out evenly
        self._n_instants = 0

    def follow(self, number_text: str, time_text: str, line_number: int) -> None:
        """Follow a row by the cells of its number and its instant. Raises TakeError."""
        instant, number = instant_and_step(time_text), instant_and_step(number_text)
        if instant is not None:
            self._resolution = min(self._resolution, instant[1])
        frame_resolution = self._resolution * (self._rate or math.inf)
        if frame_resolution > _FINE_RESOLUTION:
            self._check_number(None if number is None else number[0], line_number)
        self._check_instant(None if instant is None else instant[0], frame_resolution, line_number)

    def finish(self) -> None:
        """Compare the instants of all rows with the rate. Raises TakeError."""
        if self._rate is None or self._instant is None or self._first_instant is None:
            return
        n_steps = self._n_instants - 1
        if n_steps < 1:
            return
        frame_step = (self._instant - self._first_instant) / n_steps
        tolerance = RATE_TOLERANCE + self._resolution * self._rate / n_steps
        if not abs(frame_step * self._rate - 1) <= tolerance:
            raise TakeError(
                f"its head says {self._rate:g} frames a second, but its frames are "
                f"{frame_step:g} s apart",
                self._path,
            )

    def _check_number(self, number: float | None, line_number: int) -> None:
        last_number, self._number = self._number, number
        if number is None or last_number is None:
            return
        step = number - last_number
        if self._number_step is None:
            self._number_step = step
        elif step != self._number_step:
            raise TakeError(
                f"frame {number:g} follows frame {last_number:g}, but those before are "
                f"{self._number_step:g} apart; {_HELP_TEXT}",
                self._path,
                line_number,
            )

    def _check_instant(
        self, instant: float | None, frame_resolution: float, line_number: int
    ) -> None:
        last_instant, self._instant = self._instant, instant
        if instant is None or self._rate is None:
            return
        self._n_instants += 1
        if last_instant is None:
            self._first_instant, self._n_instants = instant, 1
            return
        n_frames = (instant - last_instant) * self._rate
        if not abs(n_frames - 1) <= _STEP_TOLERANCE + frame_resolution:
            raise TakeError(
                f"the time {instant:g} s follows {last_instant:g} s, which is {n_frames:.3g} "
                f"frames at {self._rate:g} a second; {_HELP_TEXT}",
                self._path,
                line_number,
            )
