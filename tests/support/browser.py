"""A real browser for tests: headless Chromium without a graphics card."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from needed import program

from ergon.workshop.movies import chromium
from ergon.workshop.movies.chromium import Browser, Page

__all__ = ["KEY", "Browser", "Page", "running"]

KEY = "0123456789abcdef0123456789abcdef"  # of the addresses of pages


@contextlib.contextmanager
def running(*flags: str) -> Iterator[Browser]:
    """Chromium with software rendering."""
    with chromium.launch_browser(
        program("chromium"), ("--use-angle=swiftshader", *flags)
    ) as raised:
        yield raised
