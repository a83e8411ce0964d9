"""What a person types to install an extra of ergon: optional libraries of one of its parts."""

from __future__ import annotations

from pathlib import Path


def install(extra: str) -> str:
    """The command that installs an extra: in a clone from that clone, else from the index."""
    # In a clone the package links to this very folder.
    root = next((at for at in Path(__file__).resolve().parents if _is_clone(at)), None)
    if root is None:
        return f"pip install 'ergon-live[{extra}]'"
    return f"pip install -e '{root}[{extra}]'"


def _is_clone(folder: Path) -> bool:
    return (folder / "pyproject.toml").is_file() and (folder / "core-rs").is_dir()
