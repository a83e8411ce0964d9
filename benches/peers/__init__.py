"""Other programs on the same work; a row says if one is missing."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable


class Missing(Exception):
    """A peer that is not installed or fails; the text says which and why."""


def program_path(program: str, package: str) -> str:
    """Path of a program; raises Missing, with the Debian package that has it."""
    path = shutil.which(program)
    if path is None:
        raise Missing(f"`{program}` is not here (Debian: {package})")
    return path


def command(line: list[str], limit: float = 600.0) -> str:
    """Run a command to its end and return its output; raises Missing if it fails."""
    try:
        done = subprocess.run(line, capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        raise Missing(f"`{line[0]}` took longer than {limit:g} s") from None
    output = done.stdout + done.stderr
    if done.returncode != 0:
        raise Missing(f"`{line[0]}` failed: {' '.join(output.split())[-200:]}")
    return output


def by_difference(run: Callable[[float], float], short: float, long: float) -> Callable[[], float]:
    """The cost of `long - short` seconds of sound, so that starting and loading do not count."""
    return lambda: run(long) - run(short)
