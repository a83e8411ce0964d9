"""A real browser for tests: headless Chromium without a graphics card."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

import pytest

from ergon.movies import chromium
from ergon.movies.chromium import Browser, BrowserError, Page

__all__ = ["KEY", "Browser", "Page", "running"]

KEY = "0123456789abcdef0123456789abcdef"  # of the addresses of pages


@contextlib.contextmanager
def running(*flags: str) -> Iterator[Browser]:
    """Chromium with software rendering. If it is missing, CI fails; elsewhere the test is skipped
    with a message.
    """
    try:
        program = chromium.find_browser()
    except BrowserError as error:
        if os.environ.get("CI"):
            pytest.fail(str(error))
        pytest.skip(str(error))
    with chromium.launch_browser(program, ("--use-angle=swiftshader", *flags)) as found:
        yield found
