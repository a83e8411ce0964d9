"""The command that a user types to install an extra of ergon: the optional libraries of one
part.
"""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path


def install_command(extra_name: str) -> str:
    """The command that installs an extra: of the clone that this file lies in, else by the names
    of its libraries, for no index has ergon itself.
    """
    # A clone is installed in place, so this file lies inside the clone.
    root = next((folder for folder in Path(__file__).resolve().parents if _is_clone(folder)), None)
    if root is None:
        return " ".join(["pip install", *(f"'{name}'" for name in _libraries(extra_name))])
    return f"pip install -e '{root}[{extra_name}]'"


def _libraries(extra_name: str) -> list[str]:
    """The requirements of an extra, as the installed package lists them."""
    try:
        listed = requires("ergon-live") or []
    except PackageNotFoundError:  # unpacked, and never installed
        listed = []
    rows = (line.partition(";") for line in listed)
    requirement_names = [
        name.strip() for name, _, marker in rows if re.search(rf"extra == .{extra_name}\b", marker)
    ]
    return requirement_names or [f"ergon-live[{extra_name}]"]


def _is_clone(folder: Path) -> bool:
    return (folder / "pyproject.toml").is_file() and (folder / "core-rs").is_dir()
