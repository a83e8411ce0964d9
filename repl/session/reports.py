"""What a schedule reports: each becomes events of the journal and messages to the player."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


class LineMoved(NamedTuple):
    """A waiting line has another frame now."""

    line: WaitingLine


class LinesSlipped(NamedTuple):
    """Lines were not ready in time, and wait for a later frame, together."""

    lines: Sequence[WaitingLine]


class LineDropped(NamedTuple):
    """A line will not take effect."""

    line: WaitingLine
    reason: str


class LineSuperseded(NamedTuple):
    """A line will not take effect, because one that was typed later does its work before it."""

    line: WaitingLine


class LinesDone(NamedTuple):
    """Lines took effect at a frame, as change number `change`, in the version `running_after`.

    Without lines the timeline was extended.
    """

    frame: int
    change: int
    lines: Sequence[WaitingLine]
    running_after: RunningVersion


class TimelineFailed(NamedTuple):
    """The timeline cannot be extended."""

    sentence: str


Report = LineMoved | LinesSlipped | LineDropped | LineSuperseded | LinesDone | TimelineFailed
