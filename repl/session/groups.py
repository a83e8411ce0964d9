"""Lines that take effect together, and the version that was made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TYPE_CHECKING

from ergon.repl.session.line_kinds import LineKind
from ergon.repl.session.version import is_same_music

if TYPE_CHECKING:
    from ergon.repl.session.running import RunningVersion
    from ergon.repl.session.waiting_lines import WaitingLine


def group_of(waiting_lines: Sequence[WaitingLine]) -> tuple[WaitingLine, ...]:
    """The first lines that take effect together: those of one frame and one way to the engine."""
    if not waiting_lines or waiting_lines[0].start_frame is None:
        return ()
    start_frame, line_kind = waiting_lines[0].start_frame, _quick_kind(waiting_lines[0])
    return tuple(
        takewhile(
            lambda waiting_line: (
                waiting_line.start_frame == start_frame and _quick_kind(waiting_line) is line_kind
            ),
            waiting_lines,
        )
    )


def staged_group_of(waiting_lines: Sequence[WaitingLine]) -> tuple[WaitingLine, ...]:
    """The next lines that need a stage, which is made for all of them; faders wait for nothing.

    Empty if a line that ends what plays comes before them.
    """
    group = group_of(
        [waiting_line for waiting_line in waiting_lines if waiting_line.kind is not LineKind.FADERS]
    )
    return () if group and group[0].rule.is_quick else group


def _quick_kind(waiting_line: WaitingLine) -> LineKind | None:
    return waiting_line.kind if waiting_line.rule.is_quick else None


@dataclass(frozen=True, slots=True)
class StagedGroup:
    """The version that lines make of the version `running_before`."""

    lines: Sequence[WaitingLine]
    running_before: RunningVersion
    running_after: RunningVersion

    def matches(self, group: Sequence[WaitingLine], running: RunningVersion) -> bool:
        """Whether it is what these lines make of a running version, but for faders."""
        old_running = self.running_before
        return (
            len(group) == len(self.lines)
            and all(
                (waiting_line.number, waiting_line.start_frame, waiting_line.beat)
                == (staged_line.number, staged_line.start_frame, staged_line.beat)
                and is_same_music(waiting_line.result(), staged_line.result())
                for waiting_line, staged_line in zip(group, self.lines, strict=True)
            )
            and old_running.serial == running.serial
            and self.running_after.start_frame > running.start_frame
            # What an extension put behind the old end may sound at the takeover.
            and (
                old_running is running
                or old_running.beat(self.running_after.start_frame) <= old_running.timeline_end
            )
        )
