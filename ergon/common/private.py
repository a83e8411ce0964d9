"""Folders that their owner alone may open, whatever the umask, and what may be read from them."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path

from .errors import ErgonError

_GROUP_AND_OTHERS_MODE = 0o077
_OTHERS_WRITE = 0o022


class NotPrivateError(ErgonError):
    """A folder that others may open, or that is not the user's own: one sentence."""


def set_umask() -> None:
    """Let a command write what its owner may use and what not everybody may change.

    What the umask says of a group's rights, and of reading by others, holds.
    """
    os.umask(os.umask(_GROUP_AND_OTHERS_MODE) & _GROUP_AND_OTHERS_MODE | 0o002)


def make_private_folder(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for their owner alone.

    In one that is there and is the user's own, others may not write any more. Raises OSError.
    """
    missing_folders = [path for path in (folder, *folder.parents) if not os.path.lexists(path)]
    for path in reversed(missing_folders):
        with contextlib.suppress(FileExistsError):  # made by another process meanwhile
            path.mkdir(mode=0o700)
            path.chmod(0o700)  # a umask can take the owner's rights too
    status = folder.stat()
    if stat.S_ISDIR(status.st_mode) and is_own(status) and not is_own_alone(status):
        folder.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_WRITE)


def is_own(status: os.stat_result) -> bool:
    """Whether the user owns a file or folder."""
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def is_own_alone(status: os.stat_result) -> bool:
    """Whether the user owns a file or folder, and no other user may change it."""
    return is_own(status) and not (hasattr(os, "geteuid") and status.st_mode & _OTHERS_WRITE)


def _is_open(status: os.stat_result) -> bool:
    """Whether anybody but its owner may open a folder."""
    return hasattr(os, "geteuid") and bool(status.st_mode & _GROUP_AND_OTHERS_MODE)


def runtime_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """$XDG_RUNTIME_DIR/ergon, or else a folder of the user's own under /tmp, which is made.

    Raises OSError, and NotPrivateError if it does not belong to the user alone.
    """
    runtime = environment.get("XDG_RUNTIME_DIR", "")
    # The XDG specification says to ignore relative paths.
    has_runtime_folder = Path(runtime).is_absolute() and Path(runtime).is_dir()
    user = os.geteuid() if hasattr(os, "geteuid") else os.getlogin()
    temporary_folder = Path(tempfile.gettempdir()) / f"ergon-{user}"
    folder = Path(runtime) / "ergon" if has_runtime_folder else temporary_folder
    if not os.path.lexists(folder):
        make_private_folder(folder)
    status = folder.lstat()
    # Another user could have made a folder of that name under /tmp.
    if not stat.S_ISDIR(status.st_mode) or not is_own(status) or _is_open(status):
        raise NotPrivateError(f"{folder} must be a folder that you alone may open (chmod 700)")
    return folder
