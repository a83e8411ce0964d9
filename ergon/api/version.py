"""The version of the program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def _installed() -> str:
    try:
        return version("ergon-live")
    except PackageNotFoundError:  # run from a source tree that was never installed
        from ergon._core import __version__ as number

        return number


__version__ = _installed()
