"""Loops compiled by numba once for all processes of a run of the tests."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba as nb

FOLDER = Path(__file__).parent
# numba looks for changes in the file of a function alone, not in what the function calls: so each
# state of all files has a folder.
_SOURCES = b"\0".join(path.read_bytes() for path in sorted(FOLDER.glob("*.py")))
_STORE = FOLDER / "__pycache__" / hashlib.sha256(_SOURCES).hexdigest()[:16]


def compiled(function: Callable[..., Any]) -> Any:
    """`function` by numba; another process of the same sources loads what this one compiled."""
    config: Any = nb.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_STORE)
    try:
        return nb.njit(cache=True)(function)
    finally:
        config.CACHE_DIR = before
