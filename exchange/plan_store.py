"""A cache of plans in the user's cache folder: a convenience, never needed.

$XDG_CACHE_HOME/ergon/plans, or ~/.cache/ergon/plans; ERGON_CACHE=off keeps none. A file is a plan
file (`ergon plan -o`) with its key and what was told of each row; one that is broken or foreign
counts as none, and a folder that cannot be written is no mistake.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from ergon import _core
from ergon.common.regular import read_bounded

from .plan_file import Choices, NotPlanError, decided, text
from .safe import FileRefusedError, writing

_Heard = tuple[float, float, float]
_Row = tuple[
    float | None, float | None, float | None, _Heard | None, float | None, str | None, bool
]
Told = Sequence[_Row]
Kept = tuple[Choices, str, Told]  # and a hash of what was decided

_FILES_MAX = 256
_BYTES_MAX = 32_000_000  # of all files; one alone may take a quarter
_ONE_MAX = _BYTES_MAX // 4
_WORDS_MAX = 200  # of a sentence in a row
_NAME = re.compile("[0-9a-f]{64}[.]json")


class PlanStore:
    """Plans by the hash of all that they are a function of."""

    def __init__(self, folder: Path) -> None:
        """Use a folder, which need not exist."""
        self._folder = folder

    def get(self, key: str) -> Kept | None:
        """The plan that was kept under a key."""
        key = _of_this_version(key)
        path = self._path(key)
        try:
            data = read_bounded(path, _ONE_MAX)
            if len(data) > _ONE_MAX:
                return None
            content = json.loads(data)
            plan = _plan_of(content, key)
        except (OSError, ValueError, RecursionError):  # NotPlanError is a ValueError
            return None
        with contextlib.suppress(OSError):  # the least recently used go first
            os.utime(path)
        return plan

    def put(self, key: str, plan: Kept) -> None:
        """Keep a plan, if that can be."""
        key = _of_this_version(key)
        choices, digest, rows = plan
        content = text(choices, digest, key=key, told=rows).encode()
        if len(content) > _ONE_MAX:
            return
        with contextlib.suppress(OSError, FileRefusedError):
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with writing(self._path(key), binary=False, force=True, sync=False) as file:
                file.write(content)
            self._forget()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.json"

    def _forget(self) -> None:
        """Remove the files that were used least recently, until the rest is within the bounds."""
        ours = []
        for path in self._folder.iterdir():
            if _NAME.fullmatch(path.name):
                with contextlib.suppress(OSError):  # another run has removed it
                    stat = path.lstat()
                    ours.append((stat.st_mtime_ns, path.name, stat.st_size, path))
        n_bytes = 0
        for count, (_, _, size, path) in enumerate(sorted(ours, reverse=True), start=1):
            n_bytes += size
            if count > _FILES_MAX or n_bytes > _BYTES_MAX:
                path.unlink(missing_ok=True)


def of_user(environment: Mapping[str, str] = os.environ) -> PlanStore | None:
    """The user's own plans; None where they are to be kept nowhere."""
    own = folder(environment)
    return None if own is None else PlanStore(own / "plans")


def folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """ergon's part of the user's cache folder; None where nothing is to be kept."""
    if environment.get("ERGON_CACHE", "").lower() in ("off", "0", "no"):
        return None
    base = environment.get("XDG_CACHE_HOME", "")
    if Path(base).is_absolute():  # others are to be ignored, says the specification
        return Path(base) / "ergon"
    try:
        return Path.home() / ".cache" / "ergon"
    except RuntimeError:  # nobody's
        return None


@cache
def _version() -> str:
    """What this engine is, to the byte: another one may plan otherwise."""
    path = _core.__file__
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _of_this_version(key: str) -> str:
    return hashlib.sha256(f"{_version()} {key}".encode()).hexdigest()


def _plan_of(content: object, key: str) -> Kept:
    choices = decided(content)
    assert isinstance(content, dict)
    digest, rows = content.get("hash"), content.get("told")
    if content.get("key") != key or not isinstance(digest, str) or not isinstance(rows, list):
        raise NotPlanError("this was kept of another plan")
    return choices, digest, [_row_of(row) for row in rows]


def _row_of(row: object) -> _Row:
    if isinstance(row, list) and len(row) == 7:
        db, over, spectral, heard, left_out, because, cut_short = row
        is_words = because is None or (isinstance(because, str) and len(because) <= _WORDS_MAX)
        if (
            all(map(_is_number, (db, over, spectral, left_out)))
            and _is_heard(heard)
            and is_words
            and isinstance(cut_short, bool)
        ):
            return db, over, spectral, heard and tuple(heard), left_out, because, cut_short
    raise NotPlanError("a row is [dB, s, dB, [cents, T60, dB], dB, why, whether it was cut short]")


def _is_heard(value: object) -> bool:
    if not isinstance(value, list):
        return value is None
    return len(value) == 3 and all(one is not None and _is_number(one) for one in value)


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isfinite(value))
