"""The measured speed of this machine: how many times as long as in the table of costs work takes.

The file is $XDG_CACHE_HOME/ergon/speed.json, or ~/.cache/ergon/speed.json; ERGON_CACHE=off and
ERGON_CACHE=plans store none. The number is valid for the processor on which it was measured: on
another one, or if the file is damaged, there is none. No plan depends on it.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
from collections.abc import Mapping
from pathlib import Path

from ergon.common.private import make_private_folder
from ergon.common.regular import read_bounded
from ergon.common.structured import MalformedTextError, parse_json

from .cache_folder import user_folder
from .safe import FileRefusedError, open_for_writing

_BYTES_MAX = 10_000
_CORRECTION_RANGE = (0.01, 100.0)  # beyond it nothing was measured


def read_correction(environment: Mapping[str, str] = os.environ) -> float | None:
    """The correction stored on this processor; None if there is none."""
    path = _correction_path(environment)
    if path is None:
        return None
    try:
        stored_content = parse_json(read_bounded(path, _BYTES_MAX))
    except (OSError, MalformedTextError):
        return None
    if not isinstance(stored_content, dict) or stored_content.get("processor") != processor_name():
        return None
    correction = stored_content.get("correction")
    is_valid = (
        isinstance(correction, float) and _CORRECTION_RANGE[0] <= correction <= _CORRECTION_RANGE[1]
    )
    return correction if is_valid else None


def store_correction(correction: float, environment: Mapping[str, str] = os.environ) -> bool:
    """Store a correction for this processor; True if it was stored."""
    path = _correction_path(environment)
    if path is None:
        return False
    stored_content = {
        "made by ergon": "doctor",
        "processor": processor_name(),
        "correction": correction,
    }
    with contextlib.suppress(OSError, FileRefusedError):
        make_private_folder(path.parent)
        with open_for_writing(
            path, binary=False, force=True, sync=False, replaceable=False
        ) as file:
            file.write(f"{json.dumps(stored_content)}\n".encode())
        return True
    return False


def processor_name() -> str:
    """The model name of the processor."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _correction_path(environment: Mapping[str, str]) -> Path | None:
    return user_folder("speed.json", environment)
