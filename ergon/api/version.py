"""The version of the program."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def __getattr__(name: str) -> str:
    """`__version__`, read when it is asked for: metadata take milliseconds."""
    if name != "__version__":
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'", name=name)
    try:
        return version("ergon-live")
    except PackageNotFoundError:  # run from a source tree that was never installed
        from ergon._core import __version__ as number

        return number
