"""The commit of a clone, asked of git. It needs nothing of the compiled core."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit_of(root: Path) -> str:
    """The commit of a clone, in eight digits, with a `+` where files differ from it; empty where
    git or its data are missing.
    """
    command = ["git", "-C", str(root), "describe", "--always", "--exclude=*", "--abbrev=8"]
    try:
        git_process = subprocess.run(
            [*command, "--dirty=+"], capture_output=True, text=True, check=True, timeout=5
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return git_process.stdout.strip()
