"""Cache folders: their files can be lost without harm, and the least recently used go first.

The folder is $XDG_CACHE_HOME/ergon/NAME, or ~/.cache/ergon/NAME; ERGON_CACHE=off stores nothing,
ERGON_CACHE=plans only plans. A folder that cannot be written is not an error. A file that is
read may be damaged or written by another program: the caller has to check it.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ergon import _core
from ergon.common.private import is_own_alone, make_private_folder
from ergon.common.regular import open_regular
from ergon.common.user_folders import cache_folder

from .safe import FileRefusedError, open_for_writing

PLANS_FOLDER = "plans"  # a few megabytes at most, where rendered sound takes gigabytes


@dataclass(frozen=True, slots=True)
class CacheFolder:
    """Files by a key, in a folder that need not exist; `suffix` ends their names.

    `n_files_max` and `n_bytes_max` bound all files together, `n_bytes_max_of_file` bounds each of
    them.
    """

    path: Path
    suffix: str
    n_files_max: int
    n_bytes_max: int
    n_bytes_max_of_file: int

    def read(self, key: str) -> memoryview | None:
        """The content that was kept under a key (64 hex digits)."""
        path = self._path(key)
        try:
            # What others may change, or have left there, is not ours.
            if not (is_own_alone(self.path.stat()) and is_own_alone(path.stat())):
                return None
            stored_bytes = _regular_file_bytes(path, self.n_bytes_max_of_file)
        except OSError:
            return None
        if stored_bytes is None:
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return stored_bytes

    def has(self, key: str) -> bool:
        """Whether something was kept under a key."""
        return self._path(key).is_file()

    def write(self, key: str, *content_parts: bytes | memoryview) -> bool:
        """Store the content, which may come in parts, if possible; True if it was stored."""
        if sum(memoryview(part).nbytes for part in content_parts) > self.n_bytes_max_of_file:
            return False
        try:
            for folder in (self.path.parent, self.path):
                make_private_folder(folder)
            if not is_own_alone(self.path.stat()):
                return False
            with open_for_writing(
                self._path(key), binary=False, force=True, sync=False, replaceable=False
            ) as file:
                for part in content_parts:
                    file.write(part)
        except (OSError, FileRefusedError):
            return False
        return True

    def remove_oldest(self) -> None:
        """Remove the files that were used least recently, until the rest is within the bounds."""
        name_pattern = re.compile(f"[0-9a-f]{{64}}{re.escape(self.suffix)}")
        cache_files = []
        with contextlib.suppress(OSError):
            for path in self.path.iterdir():
                if name_pattern.fullmatch(path.name):
                    with contextlib.suppress(OSError):  # another run has removed it
                        stat = path.lstat()
                        cache_files.append((stat.st_mtime_ns, path.name, stat.st_size, path))
        n_bytes = 0
        for count, (_, _, size, path) in enumerate(sorted(cache_files, reverse=True), start=1):
            n_bytes += size
            if count > self.n_files_max or n_bytes > self.n_bytes_max:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _path(self, key: str) -> Path:
        return self.path / f"{key}{self.suffix}"


def _regular_file_bytes(path: Path, n_bytes_max: int) -> memoryview | None:
    """The bytes of a regular file; None if there are more than `n_bytes_max`."""
    import numpy as np

    with open_regular(path) as open_file:
        n_bytes = os.fstat(open_file.fileno()).st_size
        if n_bytes > n_bytes_max:
            return None
        # Large arrays come in large pages, which takes a third of the time of `read`.
        data = np.empty(n_bytes, np.uint8).data
        return data[: open_file.readinto(data)]


def user_folder(folder_name: str, environment: Mapping[str, str] = os.environ) -> Path | None:
    """The path of `folder_name` in the user's own cache folder; None if nothing is to be kept."""
    setting = environment.get("ERGON_CACHE", "").lower()
    if setting in ("off", "0", "no") or (setting == PLANS_FOLDER and folder_name != PLANS_FOLDER):
        return None
    folder = cache_folder(environment)
    return None if folder is None else folder / folder_name


def versioned_key(cache_key: str) -> str:
    """A key that only this version of the engine finds, since another may compute something
    else.
    """
    return hashlib.sha256(f"{_engine_hash()} {cache_key}".encode()).hexdigest()


@cache
def _engine_hash() -> str:
    """Hash of the bytes of the compiled engine."""
    return hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()
