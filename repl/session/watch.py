"""Watches whether another program has saved the score while it plays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ergon.scores.edits.texts import Texts


class FileWatch:
    """Tells whether another program has saved the score or a file that it uses."""

    def __init__(self, texts: Texts) -> None:
        """Watch the files of these texts."""
        self.watch_texts(texts)

    def watch_texts(self, texts: Texts) -> None:
        """Watch the files of these texts instead of the previous ones."""
        self._files = [Path(name) for name in texts.load().files]
        self._last_stamps = self._stamps()

    def has_changed(self) -> bool:
        """Whether a file was saved since the last call."""
        stamps = self._stamps()
        changed, self._last_stamps = stamps != self._last_stamps, stamps
        return changed

    def _stamps(self) -> list[int]:
        return [_file_stamp(path) for path in self._files]


def _file_stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:  # an editor puts a new file in its place
        return 0
