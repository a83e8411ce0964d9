"""The folder where ergon keeps what a user would miss, but not much: typed lines, a register."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def state_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """$XDG_STATE_HOME/ergon, or ~/.local/state/ergon; None for a user without a home folder."""
    base = environment.get("XDG_STATE_HOME", "")
    if Path(base).is_absolute():  # the specification says to ignore relative paths
        return Path(base) / "ergon"
    try:
        return Path.home() / ".local" / "state" / "ergon"
    except RuntimeError:
        return None
