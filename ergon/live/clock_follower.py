"""Where the beat of another program's MIDI clock is, from its messages and their instants.

`repl/session/midi_clock.py` applies it to a session.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median
from typing import NamedTuple

from .midi_messages import CLOCKS_PER_BEAT, Message, SongPosition, Transport

_CLOCKS_KEPT = 96  # clocks from which tempo and phase are estimated: four beats
_CLOCKS_MIN = 12  # clocks before anything is estimated
_ERROR_MAX = 0.006  # [s]; a clock further off the estimate is late, or the tempo has jumped
_CLOCKS_BEFORE_JUMP = 12  # such clocks in a row after which the tempo has jumped
# A clock is late if it lags behind the line by more than this many times the median error, and by
# more than this time [s].
_LATE_FACTOR, _LATE_MIN = 4.0, 0.002
_FITS_MAX = 4  # lines fitted, each without the clocks that are late against the one before
_SILENCE_MAX = 0.5  # [s] without a clock after which there is none to follow
_BEAT_MAX, _BEAT_MIN = 60.0 / 20.0, 60.0 / 400.0  # [s] of a beat that is followed


class BeatEstimate(NamedTuple):
    """The estimate: `instant` [s] is that of `beat`, and a beat lasts `beat_length` [s]."""

    instant: float
    beat: float
    beat_length: float

    def instant_of(self, beat: float) -> float:
        """The instant of a beat [s]."""
        return self.instant + (beat - self.beat) * self.beat_length


class ClockFollower:
    """Follows the clock of another program; `receive` may be called by any one thread.

    Beats count from 0 at the beginning of the piece. `has_position` says whether that beginning is
    known: a program that was already playing sends clocks only.
    """

    def __init__(self) -> None:
        """Begin without a clock."""
        self._clocks: deque[tuple[int, float]] = deque(maxlen=_CLOCKS_KEPT)
        # The latest clocks, where all are off the estimate.
        self._stray_clocks: list[tuple[int, float]] = []
        self._next_clock = 0  # the number of the next clock
        self._last_instant = -math.inf
        self.has_position = False
        self.is_running = False

    def receive(self, message: Message, instant: float) -> None:
        """Process a message that came at an instant [s]."""
        if isinstance(message, SongPosition):
            self._move_to(message.clocks)
        elif message is Transport.START:
            self._move_to(0)
            self.is_running = True
        elif message is Transport.CONTINUE:
            self.is_running = True
        elif message is Transport.STOP:
            self.is_running = False
        elif message is Transport.CLOCK:
            self._add_clock(instant)

    @property
    def position(self) -> float:
        """The beat of the next clock."""
        return self._next_clock / CLOCKS_PER_BEAT

    def _move_to(self, clock_number: int) -> None:
        """Continue counting from another position; the estimate of the tempo is kept."""
        clock_shift = clock_number - self._next_clock
        moved_clocks = [(number + clock_shift, instant) for number, instant in self._clocks]
        self._clocks.clear()
        self._clocks.extend(moved_clocks)
        self._stray_clocks = [
            (number + clock_shift, instant) for number, instant in self._stray_clocks
        ]
        self._next_clock = clock_number
        self.has_position = True

    def _add_clock(self, instant: float) -> None:
        if instant - self._last_instant > _SILENCE_MAX or instant < self._last_instant:
            self._clocks.clear()
            self._stray_clocks.clear()
        self._last_instant = instant
        beat_estimate, clock = self.estimate(), (self._next_clock, instant)
        self._next_clock += 1
        if (
            beat_estimate is None
            or abs(beat_estimate.instant_of(clock[0] / CLOCKS_PER_BEAT) - instant) <= _ERROR_MAX
        ):
            self._stray_clocks.clear()
            self._clocks.append(clock)
            return
        # After a delay in a program or a wire, several clocks come at once, and then it goes on as
        # before. Only if so many in a row are off the estimate has the tempo jumped.
        self._stray_clocks.append(clock)
        if len(self._stray_clocks) == _CLOCKS_BEFORE_JUMP:
            self._clocks.clear()
            self._clocks.extend(self._stray_clocks)
            self._stray_clocks.clear()

    def is_receiving(self, instant_now: float) -> bool:
        """Whether clocks are coming."""
        return instant_now - self._last_instant <= _SILENCE_MAX

    def estimate(self) -> BeatEstimate | None:
        """The line through the latest clocks, without those that came late; None if there are too
        few, or if the tempo is out of range.
        """
        clocks = list(self._clocks)
        if len(clocks) < _CLOCKS_MIN:
            return None
        clock_line = _fit_line(clocks)
        for _ in range(_FITS_MAX):
            errors = [
                instant - clock_line.instant_of(number / CLOCKS_PER_BEAT)
                for number, instant in clocks
            ]
            lateness_max = max(_LATE_MIN, _LATE_FACTOR * median(map(abs, errors)))
            punctual_clocks = [
                clock for clock, error in zip(clocks, errors, strict=True) if error <= lateness_max
            ]
            if len(punctual_clocks) == len(clocks) or len(punctual_clocks) < _CLOCKS_MIN // 2:
                break
            clocks, clock_line = punctual_clocks, _fit_line(punctual_clocks)
        return clock_line if _BEAT_MIN <= clock_line.beat_length <= _BEAT_MAX else None


def _fit_line(clocks: list[tuple[int, float]]) -> BeatEstimate:
    """The least-squares line through clocks: (number, instant [s])."""
    n_clocks = len(clocks)
    first_number, first_instant = clocks[0]
    clock_numbers = [number - first_number for number, _ in clocks]
    instants = [instant - first_instant for _, instant in clocks]
    mean_number, mean_instant = sum(clock_numbers) / n_clocks, sum(instants) / n_clocks
    number_variation = sum((number - mean_number) ** 2 for number in clock_numbers)
    pairs = zip(clock_numbers, instants, strict=True)
    clock_length = (
        sum((number - mean_number) * (instant - mean_instant) for number, instant in pairs)
        / number_variation
    )
    return BeatEstimate(
        first_instant + mean_instant,
        (first_number + mean_number) / CLOCKS_PER_BEAT,
        clock_length * CLOCKS_PER_BEAT,
    )
