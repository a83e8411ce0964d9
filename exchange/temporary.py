"""Temporary files beside their targets, and what killed programs left of them.

A process locks its temporary files, and the locks end with the process in any case. So an
unlocked temporary file is litter, and the next writer in the same folder removes it.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import stat
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # no POSIX system: nothing is locked, so nothing is swept
    fcntl = None  # type: ignore[assignment]

IS_LOCKED = fcntl is not None
_LONGEST = 255  # bytes of a name
_OURS = re.compile(r"\.[^/]+\.\d+-\d+\.part")
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_LOOK = os.O_RDWR | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_serial = itertools.count()
_swept: set[Path] = set()  # folders: each is swept once in a process


def open_temporary(path: Path, paths: list[Path]) -> BinaryIO:
    """A new file beside `path`, so that a rename is one step within one file system.

    Its name is appended to `paths` before the file exists: whatever interrupts the call, the
    caller can remove the file. Raises OSError.
    """
    folder = path.parent
    if folder not in _swept:
        _swept.add(folder)
        remove_abandoned(folder)
    while True:
        name = f".{path.name[:200]}.{os.getpid()}-{next(_serial)}.part"
        while len(os.fsencode(name)) > _LONGEST:
            name = f".{name[2:]}"
        temporary = folder / name
        paths.append(temporary)
        try:
            handle = os.open(temporary, _FLAGS, 0o600)
        except FileExistsError:  # left by an earlier process with our number
            paths.pop()
            continue
        file = _try_lock(handle)
        if file is None or (file and _is_at(handle, temporary)):
            return open(handle, "w+b")
        os.close(handle)  # somebody else swept it before it was locked
        paths.pop()


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove temporary files whose writer has ended; returns their paths."""
    if not IS_LOCKED:
        return []
    swept = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        names = [entry.name for entry in entries if _OURS.fullmatch(entry.name)]
        for name in names:
            if _remove_if_abandoned(folder / name):
                swept.append(folder / name)
    return swept


def _remove_if_abandoned(path: Path) -> bool:
    with contextlib.suppress(OSError):
        found = path.lstat()
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.geteuid():
            return False
        handle = os.open(path, _LOOK)
        try:
            if _try_lock(handle) and _is_at(handle, path):
                path.unlink()
                return True
        finally:
            os.close(handle)
    return False


def _try_lock(handle: int) -> bool | None:
    """Lock a file until it is closed; False if another process holds the lock, None if there are no
    locks.
    """
    if not IS_LOCKED:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return None
    return True


def _is_at(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except OSError:
        return False
