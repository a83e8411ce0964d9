"""MIDI clock: where another program's beat is, from its messages and the instants of these."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from .midi_messages import CLOCKS, Message, SongPosition, Transport

_KEPT = 96  # clocks from which tempo and phase are estimated: four beats
_ENOUGH = 12  # clocks before anything is estimated
_JUMP = 0.006  # [s] by which a clock is off the estimate where the tempo has jumped
_SILENCE = 0.5  # [s] without a clock after which there is none to follow
_LONGEST, _SHORTEST = 60.0 / 20.0, 60.0 / 400.0  # [s] of a beat that is followed


class Beat(NamedTuple):
    """The estimate: `at` [s] is the instant of `beat`, and a beat lasts `length` [s]."""

    at: float
    beat: float
    length: float

    def when(self, beat: float) -> float:
        """The instant of a beat [s]."""
        return self.at + (beat - self.beat) * self.length


class ClockFollower:
    """Follows the clock of another program; `receive` may be called by any one thread.

    Beats count from 0 at the beginning of the piece. `is_placed` says whether that beginning is
    known: a program that was playing before tells clocks alone.
    """

    def __init__(self) -> None:
        """Begin without a clock."""
        self._clocks: deque[tuple[int, float]] = deque(maxlen=_KEPT)
        self._next = 0  # the number of the next clock
        self._last = -math.inf
        self.is_placed = False
        self.is_running = False

    def receive(self, message: Message, at: float) -> None:
        """Take in a message that came at an instant [s]."""
        if isinstance(message, SongPosition):
            self._place(message.clocks)
        elif message is Transport.START:
            self._place(0)
            self.is_running = True
        elif message is Transport.CONTINUE:
            self.is_running = True
        elif message is Transport.STOP:
            self.is_running = False
        elif message is Transport.CLOCK:
            self._clock(at)

    @property
    def position(self) -> float:
        """The beat of the next clock."""
        return self._next / CLOCKS

    def _place(self, clocks: int) -> None:
        """Go on counting from a place; the tempo is known as before."""
        by = clocks - self._next
        moved = [(number + by, at) for number, at in self._clocks]
        self._clocks.clear()
        self._clocks.extend(moved)
        self._next = clocks
        self.is_placed = True

    def _clock(self, at: float) -> None:
        if at - self._last > _SILENCE or at < self._last:
            self._clocks.clear()
        else:
            known = self.beat()
            if known is not None and abs(known.when(self._next / CLOCKS) - at) > _JUMP:
                self._forget()
        self._last = at
        self._clocks.append((self._next, at))
        self._next += 1

    def _forget(self) -> None:
        """Keep the latest clocks alone: the tempo has jumped, or one came late."""
        while len(self._clocks) > _ENOUGH // 2:
            self._clocks.popleft()

    def is_heard(self, now: float) -> bool:
        """Whether clocks come."""
        return now - self._last <= _SILENCE

    def beat(self) -> Beat | None:
        """The line through the latest clocks; None where there are too few, or no tempo."""
        clocks = list(self._clocks)
        n = len(clocks)
        if n < _ENOUGH:
            return None
        first, since = clocks[0]
        numbers = [number - first for number, _ in clocks]
        instants = [at - since for _, at in clocks]
        x, y = sum(numbers) / n, sum(instants) / n
        along = sum((number - x) ** 2 for number in numbers)
        rises = zip(numbers, instants, strict=True)
        length = sum((number - x) * (at - y) for number, at in rises) / along
        if not _SHORTEST <= length * CLOCKS <= _LONGEST:
            return None
        return Beat(since + y, (first + x) / CLOCKS, length * CLOCKS)
