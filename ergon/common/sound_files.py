"""Which endings sound files have."""

from __future__ import annotations

import re
import stat
from pathlib import Path

from ergon.common.regular import open_regular

_HEAD_BYTES = 16  # enough to recognise a format

WAVE, FLAC = ".wav", ".flac"
SUFFIXES = (WAVE, FLAC)  # of files that are written
_READ_SUFFIXES = (*SUFFIXES, ".wave", ".rf64", ".bwf", ".aif", ".aiff", ".aifc")
# First bytes of the formats of sound that are read.
_KINDS = (
    (re.compile(rb"(?:RIFF|RIFX|RF64|BW64).{4}WAVE", re.DOTALL), "wave"),
    (re.compile(rb"fLaC"), "flac"),
    (re.compile(rb"FORM.{4}AIF[FC]", re.DOTALL), "aiff"),
)


def kind_of(head: bytes) -> str | None:
    """wave, flac or aiff, by the first bytes of a file; None for others."""
    return next((kind for pattern, kind in _KINDS if pattern.match(head)), None)


def is_sound(path: Path) -> bool:
    """Whether a file is read as sound: by the ending of its name, or by its first bytes."""
    if path.suffix.lower() in _READ_SUFFIXES:
        return True
    try:
        return kind_of(first_bytes(path)) is not None
    except OSError:
        return False


def first_bytes(path: Path) -> bytes:
    """The first bytes of a regular file, enough to recognise its format. Raises OSError."""
    with open_regular(path) as file:
        return file.read(_HEAD_BYTES)


def find_ending_mistake(target: str) -> str | None:
    """What is wrong with the ending of the name of a sound file, as a sentence without advice; None
    if nothing is.
    """
    path = Path(target)
    if path.suffix.lower() in SUFFIXES or target == "-" or _is_device(path):
        return None
    ending_clause = f"ends in {path.suffix}" if path.suffix else "has no ending"
    return f"{target} {ending_clause}, but sound files end in {' or '.join(SUFFIXES)}"


def with_wave_suffix(target: str) -> str:
    """The name with the ending of a WAVE file."""
    return str(Path(target).with_suffix(WAVE))


def _is_device(path: Path) -> bool:
    """Whether the name is that of a device or a pipe."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISCHR(mode) or stat.S_ISFIFO(mode)
