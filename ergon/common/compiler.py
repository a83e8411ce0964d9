"""numba, the compiler of laws, where this machine has it.

This is the only place that imports it. What it compiles gives the bits of the core's own steps, so
a machine without it computes the same sounds, and only takes longer.
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any


@cache
def load_numba() -> tuple[Any, str]:
    """The module, or None with the reason for which it cannot be imported.

    Call it only where something is compiled: loading takes longer than most scores are computed.
    """
    if not is_installed():
        return None, "numba is not installed"
    try:
        import numba
    except (ImportError, OSError) as error:  # made for another numpy; a library that is missing
        return None, f"numba is installed, and cannot be loaded: {error}"
    return numba, ""


def is_installed() -> bool:
    """Whether numba is there, without loading it."""
    return find_spec("numba") is not None


def feature() -> str:
    """What `ergon --version` says: `numba 0.68.1` or `no numba`; loads nothing."""
    try:
        return f"numba {version('numba')}" if is_installed() else "no numba"
    except PackageNotFoundError:  # a folder on the path that no installer wrote
        return "numba"
