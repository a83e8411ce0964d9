"""Which version of a session played in which frames, and what other programs receive of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.schedule import Schedule


class PlayedVersions:
    """The versions that the engine has played, each with its range of frames."""

    def __init__(self, schedule: Schedule) -> None:
        """Begin at frame 0."""
        self._schedule = schedule
        self._next_frame = 0
        self._last_version = schedule.running

    def pop_before(self, frame: int) -> Iterator[tuple[RunningVersion, int, int]]:
        """Each version with its first frame and the frame after its last, up to `frame`.

        Frames that were returned before are left out.
        """
        first_frame, self._next_frame = self._next_frame, max(self._next_frame, frame)
        schedule = self._schedule
        # Versions that are under way come between; those that were over before are not included.
        versions = [
            self._last_version,
            *(change.running_before for change in schedule.changes.pending[:]),
            schedule.running,
        ]
        for version_index, running in enumerate(versions):
            begin_frame = max(first_frame, running.start_frame) if version_index else first_frame
            end_frame = min(
                [
                    frame,
                    *(later_version.start_frame for later_version in versions[version_index + 1 :]),
                ]
            )
            if begin_frame < end_frame:
                self._last_version = running
                yield running, begin_frame, end_frame
