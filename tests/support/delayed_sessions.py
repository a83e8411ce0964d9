"""Sessions in virtual time whose versions take a while to make, while the sound goes on.

A delay stands for a busy machine: during it the engine computes, and the threads that hand over
and that extend the timeline have their turns, as beside a real prompt.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np
from sessions import EVERY, Stepped

from ergon.repl.session import takeover
from ergon.scores.staging.stage import Stage

_TURN = 0.02  # [s] between two turns of the session's threads
MARGIN = EVERY  # frames in which a change reaches the engine


class Delayed(Stepped):
    """A session whose makings take as long as `delay` says [s]."""

    delay: Callable[[], float] = staticmethod(lambda: 0.0)
    is_delaying = False

    def _open(self, *given: Any, **named: Any) -> None:
        super()._open(*given, **named)
        self.session.schedule.moments.margin = MARGIN

    def wait(self, seconds: float) -> None:
        """Let the sound go on while a version is made."""
        left = int(seconds * self.rate) // EVERY * EVERY
        turn = max(EVERY, int(_TURN * self.rate) // EVERY * EVERY)
        while left > 0:
            self.session.hand_over_due()
            self.session.extend_timeline()
            self.advance(min(turn, left))
            left -= turn

    def advance(self, n_frames: int) -> None:
        """Compute frames."""
        block = self.engine.process(n_frames)
        self.hash.update(block)
        if self._keeps:
            self._sound.append(block)


@contextlib.contextmanager
def delays(session: Callable[[], Delayed]) -> Iterator[None]:
    """Let versions take the time that the present session says."""
    staged = takeover.stage_spans

    def slowly(*arguments: Any, **named: Any) -> Stage:
        position = session()
        lock = position.session.schedule.lock
        if not position.is_delaying and not lock._is_owned():
            position.is_delaying = True
            try:
                position.wait(position.delay())
            finally:
                position.is_delaying = False
        return staged(*arguments, **named)

    with mock.patch.object(takeover, "stage_spans", slowly):
        yield


def events(delayed: Stepped, name: str) -> list[dict[str, Any]]:
    """The journal's events of a name."""
    rows = (json.loads(row) for row in delayed.journal.read_text().splitlines())
    return [row for row in rows if row["event"] == name]


def check_render(delayed: Delayed) -> None:
    """The journal renders what was heard."""
    delayed.close()
    delayed.delay = lambda: 0.0
    assert np.array_equal(delayed.again(), delayed.sound)


def peaks_of_seconds(delayed: Stepped, channel: int) -> np.ndarray:
    """The peak of each second of a channel."""
    n = int(delayed.rate)
    sound = np.abs(delayed.sound[: len(delayed.sound) // n * n, channel])
    return sound.reshape(-1, n).max(axis=1)
