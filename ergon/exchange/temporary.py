"""Temporary files and folders beside their targets, and what killed programs left of them.

    .NAME.0123456789abcdef0123456789abcdef.part

The first 16 digits are drawn by chance. The last 16 are a hash of them, of NAME and of this
machine, which no other program makes: so no file of others is taken for one of ours, nor is a copy
of ours under another name. A process locks its temporary files, and the locks end with the process
in any case. So a temporary file of this machine that is not locked is litter, and the next writer
in the same folder removes it. Files of other machines are left alone, because not every network
file system shows the locks that those hold.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import platform
import re
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

try:
    import fcntl
except ImportError:  # no POSIX system: nothing is locked, so nothing is swept
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

IS_LOCKED = fcntl is not None
_NAME_MAX = 200  # bytes of NAME; a whole name has at most 255
_HEX_DIGITS = 16
_TEMPORARY_NAME_PATTERN = re.compile(r"\.(.+)\.([0-9a-f]{16})([0-9a-f]{16})\.part", re.DOTALL)
_CREATE_FLAGS = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_OPEN_FLAGS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_swept_folders: set[Path] = set()  # folders: each is swept once in a process


class _TargetFile(io.FileIO):
    """A temporary file; an error of the disk names the target."""

    def __init__(self, handle: int, target: Path) -> None:
        super().__init__(handle, "rb+")
        self._target = target

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            error.filename = str(self._target)
            raise


def open_temporary(path: Path, paths: list[Path]) -> BinaryIO:
    """A new file beside `path`, so that a rename is one step within one file system.

    Its name is appended to `paths` before the file exists: whatever interrupts the call, the
    caller can remove the file. Raises OSError.
    """
    for temporary in _new_names(path.parent, path.name):
        paths.append(temporary)
        handle = os.open(temporary, _CREATE_FLAGS, 0o600)
        if _lock_new_file(handle, temporary):
            return io.BufferedRandom(_TargetFile(handle, path))
        os.close(handle)  # somebody else swept it before it was locked
        paths.pop()
    raise AssertionError  # the sequence of names is endless


def link_temporary(path: Path, paths: list[Path]) -> int:
    """A second name for a file, beside it, also appended to `paths`; returns the handle that locks
    it, unless another program does. Raises OSError.
    """
    paths.append(next(_new_names(path.parent, path.name)))
    os.link(path, paths[-1])
    handle = os.open(paths[-1], os.O_RDONLY | _OPEN_FLAGS)
    try_lock(handle)
    return handle


@contextlib.contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """A new folder, for the time of the block; the caller may rename it. Raises OSError."""
    for folder in _new_names(parent, name):
        try:
            folder.mkdir()
            handle = os.open(folder, os.O_RDONLY | _OPEN_FLAGS) if IS_LOCKED else -1
            try:
                if not IS_LOCKED or _lock_new_file(handle, folder):
                    yield folder
                    return
            finally:
                if IS_LOCKED:
                    os.close(handle)
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove temporary files and folders whose writer has ended; returns their paths."""
    if not IS_LOCKED:
        return []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        left_over_files = [
            folder / entry.name for entry in entries if _is_temporary_name(entry.name)
        ]
        return [path for path in left_over_files if _remove_if_abandoned(path)]
    return []


def try_lock(handle: int) -> bool | None:
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


def has_path(handle: int, path: Path) -> bool:
    """Whether an open file has this name by now."""
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except OSError:
        return False


def _new_names(folder: Path, file_name: str) -> Iterator[Path]:
    """Temporary names in a folder, whose litter is removed before."""
    if folder not in _swept_folders:
        _swept_folders.add(folder)
        remove_abandoned(folder)
    file_name = os.fsencode(file_name)[:_NAME_MAX].decode(errors="ignore") or "_"
    while True:
        random_digits = os.urandom(_HEX_DIGITS // 2).hex()
        yield folder / f".{file_name}.{random_digits}{_check_digits(file_name, random_digits)}.part"


def _check_digits(name: str, random_digits: str) -> str:
    identity = f"temporary file of ergon\0{platform.node()}\0{random_digits}\0{name}"
    return hashlib.sha256(identity.encode(errors="surrogateescape")).hexdigest()[:_HEX_DIGITS]


def _is_temporary_name(name: str) -> bool:
    parts = _TEMPORARY_NAME_PATTERN.fullmatch(name)
    return parts is not None and parts[3] == _check_digits(parts[1], parts[2])


def _lock_new_file(handle: int, path: Path) -> bool:
    """Lock a new temporary file; False if another process swept it, or is about to."""
    is_locked = try_lock(handle)
    return is_locked is None or (is_locked and has_path(handle, path))


def _remove_if_abandoned(path: Path) -> bool:
    with contextlib.suppress(OSError):
        path_stat = path.lstat()
        is_folder = stat.S_ISDIR(path_stat.st_mode)
        if not (is_folder or stat.S_ISREG(path_stat.st_mode)) or path_stat.st_uid != os.geteuid():
            return False
        # A network file system locks for writing only what is open for writing; folders never are.
        handle = os.open(path, _OPEN_FLAGS | (os.O_RDONLY if is_folder else os.O_RDWR))
        try:
            if try_lock(handle) and has_path(handle, path):
                if is_folder:
                    shutil.rmtree(path)
                else:
                    path.unlink()
                return True
        finally:
            os.close(handle)
    return False
