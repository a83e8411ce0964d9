"""A folder of files that are convenient and never needed: the least recently used go first.

$XDG_CACHE_HOME/ergon/NAME, or ~/.cache/ergon/NAME; ERGON_CACHE=off keeps none, ERGON_CACHE=plans
plans alone. A folder that cannot be written is no mistake, and what is read may be broken or
foreign: whoever asks has to look.
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
from ergon.common.regular import read_bounded

from .safe import FileRefusedError, writing

PLANS = "plans"  # a few megabytes at most, where rendered sound takes gigabytes


@dataclass(frozen=True, slots=True)
class CacheFolder:
    """Files by a key, in a folder that need not exist; `suffix` ends their names.

    It keeps at most `n_files` and `n_bytes` of all, and `n_bytes_one` of one.
    """

    path: Path
    suffix: str
    n_files: int
    n_bytes: int
    n_bytes_one: int

    def read(self, key: str) -> bytes | None:
        """The content that was kept under a key (64 hex digits)."""
        path = self._path(key)
        try:
            data = read_bounded(path, self.n_bytes_one)
        except OSError:
            return None
        if len(data) > self.n_bytes_one:
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return data

    def write(self, key: str, content: bytes) -> bool:
        """Keep some content, if that can be; whether it was."""
        if len(content) > self.n_bytes_one:
            return False
        try:
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            with writing(self._path(key), binary=False, force=True, sync=False) as file:
                file.write(content)
        except (OSError, FileRefusedError):
            return False
        return True

    def forget(self) -> None:
        """Remove the files that were used least recently, until the rest is within the bounds."""
        name = re.compile(f"[0-9a-f]{{64}}{re.escape(self.suffix)}")
        ours = []
        with contextlib.suppress(OSError):
            for path in self.path.iterdir():
                if name.fullmatch(path.name):
                    with contextlib.suppress(OSError):  # another run has removed it
                        stat = path.lstat()
                        ours.append((stat.st_mtime_ns, path.name, stat.st_size, path))
        n_bytes = 0
        for count, (_, _, size, path) in enumerate(sorted(ours, reverse=True), start=1):
            n_bytes += size
            if count > self.n_files or n_bytes > self.n_bytes:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _path(self, key: str) -> Path:
        return self.path / f"{key}{self.suffix}"


def of_user(name: str, environment: Mapping[str, str] = os.environ) -> Path | None:
    """What has this name in the user's own cache folder; None where nothing is to be kept."""
    kept = environment.get("ERGON_CACHE", "").lower()
    if kept in ("off", "0", "no") or (kept == PLANS and name != PLANS):
        return None
    base = environment.get("XDG_CACHE_HOME", "")
    if Path(base).is_absolute():  # others are to be ignored, says the specification
        return Path(base) / "ergon" / name
    try:
        return Path.home() / ".cache" / "ergon" / name
    except RuntimeError:  # nobody's
        return None


def of_this_version(key: str) -> str:
    """A key that another version of the engine does not find: it may compute something else."""
    return hashlib.sha256(f"{_version()} {key}".encode()).hexdigest()


@cache
def _version() -> str:
    """What this engine is, to the byte."""
    return hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()
