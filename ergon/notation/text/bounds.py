"""Which files a score may name: those of its folder or its project, and those that ship.

A score may come from anybody. Files that it names are read, and quoted in messages about them;
the file of `render: {file: …}` is written. So a name that leads out of the score's folder, by
`..`, by an absolute path or by a link, is refused unless whoever runs the score trusts it.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

MARKER = "ergon.project"  # an empty file that makes its folder one project with all below it

_PACKAGE = Path(__file__).parents[2]
SHIPPED_INSTRUMENTS_FOLDER = _PACKAGE / "instruments" / "library"
SHIPPED_SCORES_FOLDER = _PACKAGE / "scores" / "library"


@dataclass(frozen=True, slots=True)
class FileBounds:
    """Folders, without links in their names, whose files a score may name; None stands for any
    folder.
    """

    folders: tuple[Path, ...] | None

    @classmethod
    def around(cls, folder: Path, *, trust: bool = False) -> FileBounds:
        """The bounds of a score in a folder; with `trust` it may name any file."""
        if trust:
            return cls(None)
        return cls(
            (
                _project_folder(_real_path(folder)),
                _real_path(SHIPPED_INSTRUMENTS_FOLDER),
                _real_path(SHIPPED_SCORES_FOLDER),
            )
        )

    @property
    def allows_any_file(self) -> bool:
        """Whether any file may be named."""
        return self.folders is None

    def allows(self, path: Path) -> bool:
        """Whether a path, with links followed, lies inside the bounds; the file need not exist."""
        if self.folders is None or _is_installed(path):
            return True
        try:
            real_path = _real_path(path)
        except ValueError:  # a name that no file can have
            return False
        return any(real_path.is_relative_to(folder) for folder in self.folders)


@lru_cache(maxsize=1024)  # a session asks at each of its lines
def _is_installed(path: Path) -> bool:
    """Whether a path is that of a file that ships."""
    folders = (SHIPPED_INSTRUMENTS_FOLDER, SHIPPED_SCORES_FOLDER)
    if ".." in path.parts or not any(map(path.is_relative_to, folders)) or not os.path.isfile(path):
        return False
    real_path = _real_path(path)
    return any(real_path.is_relative_to(_real_path(folder)) for folder in folders)


def _real_path(path: Path) -> Path:
    return Path(os.path.realpath(path))


def _project_folder(folder: Path) -> Path:
    """The nearest folder, from this one up, that holds a marker file owned by the user; else this
    one.
    """
    for parent_folder in (folder, *folder.parents):
        try:
            marker_stat = os.lstat(parent_folder / MARKER)
        except OSError:
            continue
        # In a folder that everybody can write to, the marker may belong to somebody else.
        if stat.S_ISREG(marker_stat.st_mode) and marker_stat.st_uid == _effective_uid(
            marker_stat.st_uid
        ):
            return parent_folder
    return folder


def _effective_uid(default: int) -> int:
    return os.geteuid() if hasattr(os, "geteuid") else default
