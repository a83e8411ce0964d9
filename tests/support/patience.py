"""Waiting for a condition: no test depends on how soon it holds, because the machine may be
busy.
"""

import time
from collections.abc import Callable

PATIENCE = 300.0  # [s] after which a test gives up


def until(true: Callable[[], object], what: str, limit: float = PATIENCE) -> None:
    """Wait until something holds; fail with its name after a limit [s]."""
    end = time.monotonic() + limit
    while not true():
        assert time.monotonic() < end, f"{what} within {limit} s"
        time.sleep(0.01)
