"""Which endings sound files have."""

from __future__ import annotations

import stat
from pathlib import Path

WAVE, FLAC = ".wav", ".flac"
SUFFIXES = (WAVE, FLAC)


def wrong_ending(target: str) -> str | None:
    """What is wrong with the ending of the name of a sound file, as a sentence without advice; None
    if nothing is.
    """
    path = Path(target)
    if path.suffix.lower() in SUFFIXES or target == "-" or _is_device(path):
        return None
    end = f"ends in {path.suffix}" if path.suffix else "has no ending"
    return f"{target} {end}, but sound files end in {' or '.join(SUFFIXES)}"


def with_ending(target: str) -> str:
    """The name with the ending of a WAVE file."""
    return str(Path(target).with_suffix(WAVE))


def _is_device(path: Path) -> bool:
    """Whether the name is that of a device or a pipe."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
