"""`record audio`: writes the sound that is heard into a file while it plays."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ergon.repl.session.version import NotTakenError

if TYPE_CHECKING:
    from ergon.repl.session.engine import Engine, SoundFileStatus


class SoundFile:
    """The sound file that a session writes, one at a time."""

    def __init__(self) -> None:
        """Begin without a file."""
        self._path: Path | None = None
        self._is_ending = False
        self._n_missing = 0

    def begin(self, engine: Engine, path: Path) -> None:
        """Begin a new file. Raises NotTakenError, EngineError."""
        if self._path is not None:
            raise NotTakenError(f"{self._path} is still being recorded", "record audio off")
        if path.exists():
            raise NotTakenError(f"{path} exists, and a recording overwrites no file")
        engine.record_sound(path)
        self._path, self._is_ending, self._n_missing = path, False, 0

    def end(self, engine: Engine) -> Path:
        """End the file; `report_change` reports when it is complete. Raises NotTakenError."""
        if self._path is None or self._is_ending:
            raise NotTakenError("no sound is being recorded; `record audio FILE` begins")
        engine.end_sound()
        self._is_ending = True
        return self._path

    def report_change(self, engine: Engine, rate: float) -> tuple[str, SoundFileStatus | None]:
        """A sentence about a change in the state of the file, empty if there is none; and its
        status once it is complete.
        """
        if self._path is None:
            return "", None
        status = engine.sound_file_status()
        if status is None:
            return "", None
        if status.has_ended or status.error is not None:
            path, self._path = self._path, None
            if status.error is not None:
                engine.end_sound()
                return status.error, None
            return (
                f"sound of {status.n_frames / rate:.1f} s{_missing_text(status, rate)} -> {path}",
                status,
            )
        if status.n_missing > self._n_missing:
            self._n_missing = status.n_missing
            return f"{self._path}: the disk is too slow{_missing_text(status, rate)}", None
        return "", None


def _missing_text(status: SoundFileStatus, rate: float) -> str:
    if not status.n_missing:
        return ""
    return f", of which {status.n_missing / rate:.3f} s are silence, for the disk was too slow"
