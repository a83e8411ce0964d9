"""Opening files under untrusted names: only regular files, and never blocking on a pipe."""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from io import BufferedReader
from pathlib import Path

from ergon.common.errors import ErgonError


class NotRegularError(ErgonError, OSError):
    """The name refers to a folder, a pipe, a socket or a device."""


def open_regular(path: Path) -> BufferedReader:
    """Open a regular file for reading. Raises OSError, also for a name that no file can have.

    Opening a pipe would wait for its other end, and a device has no end: O_NONBLOCK opens both
    at once, and `fstat` then gives the kind of the open file.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
    flags |= getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        handle = os.open(path, flags)
    except ValueError:  # a null byte, or what the file system's encoding cannot say
        raise FileNotFoundError(2, "no file can have this name", str(path)) from None
    try:
        mode = os.fstat(handle).st_mode
        if stat.S_ISDIR(mode):
            raise NotRegularError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise NotRegularError(22, "not a regular file", str(path))
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bounded(path: Path, limit: int) -> bytes:
    """Up to `limit` + 1 bytes of a regular file; more than `limit` mean that the file is larger."""
    with open_regular(path) as file:
        # `read` allocates as many bytes as it is asked for: ask for no more than the file has.
        return file.read(min(limit, os.fstat(file.fileno()).st_size) + 1)


def file_digest(path: Path) -> bytes:
    """SHA-256 of a regular file, in bounded memory."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").digest()
