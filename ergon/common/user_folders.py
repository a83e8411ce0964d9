"""The user's own folders, by the XDG Base Directory Specification."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def config_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """What a user has written down: the list of devices. $XDG_CONFIG_HOME/ergon, or
    ~/.config/ergon; None for a user without a home folder.
    """
    return _user_folder("XDG_CONFIG_HOME", ".config", environment)


def state_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """What a user would miss, but not much: typed lines, a register. $XDG_STATE_HOME/ergon, or
    ~/.local/state/ergon; None for a user without a home folder.
    """
    return _user_folder("XDG_STATE_HOME", ".local/state", environment)


def cache_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """What can be computed again. $XDG_CACHE_HOME/ergon, or ~/.cache/ergon; None for a user without
    a home folder.
    """
    return _user_folder("XDG_CACHE_HOME", ".cache", environment)


def _user_folder(variable: str, below_home: str, environment: Mapping[str, str]) -> Path | None:
    base = environment.get(variable, "")
    if Path(base).is_absolute():  # the specification says to ignore relative paths
        return Path(base) / "ergon"
    try:
        return Path.home() / below_home / "ergon"
    except RuntimeError:
        return None
