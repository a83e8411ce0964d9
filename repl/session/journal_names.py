"""Names of files in a journal: below the score's folder, or in the library; no other file."""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath, PureWindowsPath

from ergon.common.errors import ErgonError
from ergon.notation.text.files import installed_path, is_below, is_file, is_shipped, shipped

LIBRARY_PREFIX = "ergon:"  # prefix of a file that ships with ergon
_CONTROL_PATTERN = re.compile(
    "[\x00-\x1f\x7f-\x9f\ud800-\udfff]"
)  # half of a surrogate pair is no character
_NAME_MAX = 1000  # characters of a name
_PART_MAX = 255  # bytes of a file's or folder's name, which no file system exceeds


class JournalNameError(ErgonError):
    """A journal names a file in a way that is not allowed: one sentence."""


def journal_name(file_name: str, folder: Path) -> str:
    """The name that a journal gives a file, for a score in `folder`."""
    name = shipped(Path(file_name))
    if name is not None:
        return LIBRARY_PREFIX + name
    return Path(os.path.relpath(file_name, folder)).as_posix()


def file_named(written_name: str, folder: Path) -> str:
    """The file that a journal names, for a score in `folder`. Raises JournalNameError."""
    if written_name.startswith(LIBRARY_PREFIX):
        path = installed_path(_check_relative(written_name.removeprefix(LIBRARY_PREFIX)))
        if path.suffix != ".yaml" or not is_shipped(path):
            raise JournalNameError(f"{_printable_text(written_name)} is not a file of the library")
        return str(path)
    path = folder / _check_relative(written_name)
    if not is_below(path, folder):
        raise JournalNameError(
            f"{_printable_text(written_name)} is outside the folder of the score"
        )
    return str(path)


def score_named(score_name: str, journal: Path) -> Path | None:
    """The score that a journal names, if it is below the journal's folder or the current one; else
    None.

    Raises JournalNameError if no score can have such a name.
    """
    _check_file_name(score_name)
    path = Path(score_name)
    path_beside = journal.parent / path
    if not is_file(path) and is_file(path_beside):
        path = path_beside
    if any(is_below(path, folder) for folder in (Path(), journal.parent)) or is_shipped(path):
        return path
    return None


def _check_relative(relative_name: str) -> str:
    """Check that a name is relative and does not go up, on any system."""
    _check_file_name(relative_name)
    windows_path, posix_path = PureWindowsPath(relative_name), PurePosixPath(relative_name)
    if windows_path.drive or windows_path.root or posix_path.is_absolute() or not posix_path.parts:
        raise JournalNameError(
            f"{_printable_text(relative_name)} is not relative to the folder of the score"
        )
    if ".." in (*windows_path.parts, *posix_path.parts):
        raise JournalNameError(
            f"{_printable_text(relative_name)} is outside the folder of the score"
        )
    return str(posix_path)


def _check_file_name(file_name: str) -> None:
    """Check that a file can have such a name."""
    if not file_name or _CONTROL_PATTERN.search(file_name) or Path(file_name).name in ("", ".."):
        raise JournalNameError(f"{_printable_text(file_name)} is not a valid file name")
    if len(file_name) > _NAME_MAX or any(
        len(part.encode()) > _PART_MAX for part in file_name.split("/")
    ):
        raise JournalNameError(f"{_printable_text(file_name)} is too long for a file name")


def _printable_text(name: str) -> str:
    return ascii(name if len(name) <= 80 else f"{name[:80]}…")
