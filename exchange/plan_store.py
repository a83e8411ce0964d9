"""Plans that are kept in the user's cache folder.

A file is a plan file (`ergon plan -o`) with its key and what was told of each row; one that is
broken or foreign counts as none.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from . import cache_folder
from .cache_folder import CacheFolder, of_this_version
from .plan_file import Choices, NotPlanError, decided, text

_Heard = tuple[float, float, float]
_Row = tuple[
    float | None, float | None, float | None, _Heard | None, float | None, str | None, bool
]
Told = Sequence[_Row]
Kept = tuple[Choices, str, Told]  # and a hash of what was decided

_FILES_MAX = 256
_BYTES_MAX = 32_000_000  # of all files
_BYTES_MAX_ONE = 8_000_000
_WORDS_MAX = 200  # of a sentence in a row


class PlanStore:
    """Plans by the hash of all that they are a function of."""

    def __init__(self, folder: Path) -> None:
        """Use a folder, which need not exist."""
        self._folder = CacheFolder(folder, ".json", _FILES_MAX, _BYTES_MAX, _BYTES_MAX_ONE)

    def get(self, key: str) -> Kept | None:
        """The plan that was kept under a key."""
        key = of_this_version(key)
        data = self._folder.read(key)
        if data is None:
            return None
        try:
            return _plan_of(json.loads(data), key)
        except (ValueError, RecursionError):  # NotPlanError is a ValueError
            return None

    def put(self, key: str, plan: Kept) -> None:
        """Keep a plan, if that can be."""
        key = of_this_version(key)
        choices, digest, rows = plan
        if self._folder.write(key, text(choices, digest, key=key, told=rows).encode()):
            self._folder.forget()


def of_user(environment: Mapping[str, str] = os.environ) -> PlanStore | None:
    """The user's own plans; None where they are to be kept nowhere."""
    folder = cache_folder.of_user("plans", environment)
    return None if folder is None else PlanStore(folder)


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
