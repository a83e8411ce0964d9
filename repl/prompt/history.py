"""The lines of earlier sessions, in a file that only its owner can read."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from prompt_toolkit.history import FileHistory

from ergon.common.private import make_private_folder

LINE_MAX = 10_000  # characters; a longer one is a paste that nobody looks for again


class LineHistory(FileHistory):
    """Lines kept in a file; if it cannot be used, they last for this session only."""

    def __init__(self, path: Path) -> None:
        """Use a file, which need not exist."""
        self._path = path
        super().__init__(path)

    def load_history_strings(self) -> Iterable[str]:
        """The lines, the newest first."""
        try:
            return list(super().load_history_strings())
        except OSError:
            return []

    def store_string(self, typed_line: str) -> None:
        """Keep a line."""
        if len(typed_line) > LINE_MAX:
            return
        with contextlib.suppress(OSError):
            make_private_folder(self._path.parent)
            # Create it for its owner alone before anything is written.
            os.close(os.open(self._path, os.O_CREAT | os.O_APPEND | os.O_WRONLY, 0o600))
            super().store_string(typed_line)
