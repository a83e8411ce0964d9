"""Results of the planner's trials of islands, in the user's cache folder.

A file is JSON: {"ergon_trial": 2, "key": …, "hash": …, "numbers": […], "counts": [[…] …],
"reason": …}, where the hash is that of the last three fields; a damaged or foreign file counts
as missing.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ergon._core import TrialRecord
from ergon.common.structured import parse_json

from . import cache_folder
from .cache_folder import CacheFolder, versioned_key

_VERSION = 2  # 1: numbers of a body without its kind
_FILES_MAX = 4096
_BYTES_MAX = 32_000_000  # all files together
_FILE_BYTES_MAX = 8_000_000
_COUNT_MAX = 2**32 - 1
_REASON_CHARACTERS_MAX = 200  # longest stored reason


class PlanStore:
    """Records of trials, by the hash of everything that they depend on."""

    def __init__(self, folder: Path) -> None:
        """Use a folder, which need not exist."""
        self._folder = CacheFolder(folder, ".json", _FILES_MAX, _BYTES_MAX, _FILE_BYTES_MAX)

    def get(self, key: str) -> TrialRecord | None:
        """The record stored under a key; None if there is none."""
        key = versioned_key(key)
        record_data = self._folder.read(key)
        if record_data is None:
            return None
        try:
            return _record_of(parse_json(bytes(record_data)), key)
        except ValueError:
            return None

    def put(self, key: str, record: TrialRecord) -> None:
        """Store a record, if possible."""
        key = versioned_key(key)
        header = {"ergon_trial": _VERSION, "key": key, "hash": _record_hash(record)}
        content = {**header, **record._asdict()}
        self._folder.write(key, json.dumps(content, separators=(",", ":")).encode())

    def forget(self) -> None:
        """Remove the records that were used least recently, until the rest is within the bounds."""
        self._folder.remove_oldest()


def user_store(environment: Mapping[str, str] = os.environ) -> PlanStore | None:
    """The user's own store of records; None if nothing is to be kept."""
    folder = cache_folder.user_folder("plans", environment)
    return None if folder is None else PlanStore(folder)


def _record_of(record_content: object, record_key: str) -> TrialRecord | None:
    if not isinstance(record_content, dict) or record_content.get("ergon_trial") != _VERSION:
        return None
    fields: dict[str, Any] = {name: record_content.get(name) for name in TrialRecord._fields}
    trial_record = TrialRecord(**fields)
    record_reason = trial_record.reason
    is_good = (
        record_content.get("key") == record_key
        and record_content.get("hash") == _record_hash(trial_record)
        and _all_are(trial_record.numbers, _is_number)
        and _all_are(trial_record.counts, _is_row)
        and (
            record_reason is None
            or (isinstance(record_reason, str) and len(record_reason) <= _REASON_CHARACTERS_MAX)
        )
    )
    return trial_record if is_good else None


def _record_hash(record: TrialRecord) -> str:
    """Hash of a record, to detect numbers that the disk has changed."""
    return hashlib.sha256(json.dumps(list(record)).encode()).hexdigest()


def _all_are(values: object, is_good: Callable[[object], bool]) -> bool:
    return isinstance(values, list) and all(map(is_good, values))


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, float) and math.isfinite(value))


def _is_row(value: object) -> bool:
    return _all_are(value, _is_count)


def _is_count(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _COUNT_MAX
