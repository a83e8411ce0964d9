"""The timeline of the running version is extended before it ends."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from ergon._core import EngineError
from ergon.repl.session.engine import Change
from ergon.repl.session.making_time import MakingTime
from ergon.repl.session.reports import TimelineFailed

if TYPE_CHECKING:
    from collections import deque

    from ergon.repl.session.changes import Changes
    from ergon.repl.session.engine import Engine
    from ergon.repl.session.makings import VersionMaker
    from ergon.repl.session.moments import Moments
    from ergon.repl.session.reports import Report
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


class Extensions:
    """Extensions of the timeline. An extension is made in any thread; all else needs the
    schedule's lock.
    """

    def __init__(
        self,
        engine: Engine,
        changes: Changes,
        moments: Moments,
        version_maker: VersionMaker,
        reports: deque[Report],
    ) -> None:
        """Begin with the changes that are under way; what cannot be extended is reported."""
        self._changes, self._moments, self._version_maker = changes, moments, version_maker
        self._reports = reports
        self._making_time = MakingTime(engine, changes.running.stage.rate)

    def due_frame(self, waiting: Iterable[WaitingLine]) -> int | None:
        """The frame of the next extension; None if none is needed now."""
        if not self._changes.running.is_ending(self._moments.beat_now()):
            return None
        start_frame = self._moments.first_frame(self._making_time.expected_seconds)
        # A line that takes over sooner extends the timeline too.
        is_extended_by_waiting_line = any(
            line.frame <= start_frame and not line.rule.is_quick for line in waiting
        )
        return None if is_extended_by_waiting_line else start_frame

    def extended(self, running: RunningVersion, start_frame: int) -> RunningVersion:
        """A version whose timeline goes on from frame `start_frame`. Raises one of `REFUSALS`."""
        making_start_frame = self._making_time.begin_frame()
        try:
            return self._version_maker.extended(running, start_frame)
        finally:
            self._making_time.add(making_start_frame)

    def send(self, next_running_version: RunningVersion) -> None:
        """Send an extension to the engine."""
        running = self._changes.running
        change = Change(
            next_running_version.start_frame,
            next_running_version.stage,
            running.stage,
            damping_t60=next_running_version.damping_t60,
            force_bounds=next_running_version.force_bounds,
        )
        try:
            self._changes.send(change, (), next_running_version)
        except EngineError as error:  # too many changes wait: the next turn tries again
            self._reports.append(TimelineFailed(f"the score could not be continued yet: {error}"))

    def stop_extending(self, error: Exception) -> None:
        """Extend the running version no more."""
        running = self._changes.running
        end_text = running.version.piece.tempo_map.written(running.timeline_end)
        sentence = f"the score could not be continued after {end_text}: {error}"
        self._reports.append(TimelineFailed(f"{sentence}; what plays rings out"))
        self._changes.running = replace(running, timeline_end=math.inf)
