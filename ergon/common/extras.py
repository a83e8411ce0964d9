"""The command that a user types to install an extra of ergon: the optional libraries of one
part.
"""

from __future__ import annotations

from pathlib import Path


def install_command(extra: str) -> str:
    """The command that installs an extra: from the clone that this file lies in, else from the
    index.
    """
    # A clone is installed in place, so this file lies inside the clone.
    root = next((at for at in Path(__file__).resolve().parents if _is_clone(at)), None)
    if root is None:
        return f"pip install 'ergon-live[{extra}]'"
    return f"pip install -e '{root}[{extra}]'"


def _is_clone(folder: Path) -> bool:
    return (folder / "pyproject.toml").is_file() and (folder / "core-rs").is_dir()
