"""A line that makes a version: what it edits, when, and its place in the history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ergon.repl.session import computing
from ergon.repl.session.line_kinds import LineKind

if TYPE_CHECKING:
    from ergon.repl.language.commands import When
    from ergon.repl.session.version import Version
    from ergon.repl.session.waiting_lines import VersionEdit


@dataclass(frozen=True, slots=True)
class Entry:
    """A line that makes a version: what it edits, when, and its place in the history.

    It is a new version, or restores that of the line `restored_line_number`. In the history it may
    take the place of the line `replaced_number`; a line that is not `is_typed` is not in the
    history. The journal keeps texts that were read from files (`reads_files`).
    """

    line: str
    edit: VersionEdit
    kind: LineKind = LineKind.STRUCTURE
    when: When = None
    sets_running: bool | None = None
    enter_beat: float | None = None  # the beat from which the piece starts
    resets: bool = False
    restored_line_number: int | None = None
    reads_files: bool = False
    is_redo: bool = False
    replaced_number: int | None = None
    is_typed: bool = True

    @property
    def restores_version(self) -> bool:
        """Whether it restores an earlier version."""
        return self.restored_line_number not in (None, -1)

    def numbered_edit(self, line_number: int) -> VersionEdit:
        """The edit of a line whose version has a number."""

        def edit(version: Version, beat: float) -> Version:
            return replace(self.edit(version, beat), number=line_number, line=self.line)

        return edit

    @property
    def is_stop(self) -> bool:
        """Whether it ends what plays, which a full disk must not prevent."""
        return self.resets or self.sets_running is False

    @property
    def step_limit(self) -> int | None:
        """The limit of its computation; None for a stop."""
        if self.resets:
            return None
        is_long = (
            self.reads_files
            or self.restored_line_number is not None
            or self.sets_running is not None
        )
        return computing.FILES_STEPS if is_long else computing.LINE_STEPS
