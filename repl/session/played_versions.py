"""Which version of a session played in which frames; other programs are told of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.repl.session.commits import Commits
    from ergon.repl.session.running import RunningVersion


class PlayedVersions:
    """The versions that the engine has played, each with its range of frames."""

    def __init__(self, commits: Commits) -> None:
        """Begin at frame 0."""
        self._commits = commits
        self._from = 0
        self._last = commits.running

    def pop_before(self, frame: int) -> Iterator[tuple[RunningVersion, int, int]]:
        """Each version with its first frame and the frame after its last, up to `frame`.

        Frames that were returned before are left out.
        """
        first, self._from = self._from, max(self._from, frame)
        commits = self._commits
        # Versions that are under way come between; those that were over before are not included.
        versions = [self._last, *(before for *_, before in commits.under_way[:]), commits.running]
        for number, running in enumerate(versions):
            begins = max(first, running.start) if number else first
            ends = min([frame, *(other.start for other in versions[number + 1 :])])
            if begins < ends:
                self._last = running
                yield running, begins, ends
