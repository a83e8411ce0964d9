"""The version of the program, and what this copy of it was built from."""

from __future__ import annotations

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from ergon.common.commit import commit_of

# Written before a wheel is built (docs/generators/build_record.py), and absent from a checkout.
BUILD_RECORD_PATH = Path(__file__).with_name("build.json")


def _installed_version() -> str:
    try:
        return version("ergon-live")
    except PackageNotFoundError:  # run from a source tree that was never installed
        from ergon._core import __version__ as number

        return number


def commit() -> str:
    """The commit that this copy was built from, in eight digits, with a `+` where files differ
    from it; empty if nothing says which.
    """
    try:
        recorded = json.loads(BUILD_RECORD_PATH.read_text(encoding="utf-8"))
        return str(recorded["commit"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    root = Path(__file__).resolve().parents[2]
    # Only a clone of ergon is asked: an installed package may lie in the repository of somebody.
    return commit_of(root) if (root / "core-rs").is_dir() else ""


def build() -> str:
    """What `ergon --version` says after the number: the commit, the core if it is another version,
    machine, Python and compiler of laws.
    """
    from ergon import _core
    from ergon.common.compiler import feature

    build_words = [f"commit {name}"] if (name := commit()) else []
    if _core.__version__ != __version__:
        build_words.append(f"core {_core.__version__}")
    build_words.append(f"{platform.system()} {platform.machine()}")
    build_words.append(f"{platform.python_implementation()} {platform.python_version()}")
    return ", ".join([*build_words, feature()])


__version__ = _installed_version()
