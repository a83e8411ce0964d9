"""An `ergon` command in a process of its own, and its processor time."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

_NO_BYTE_CODE = "PYTHONDONTWRITEBYTECODE"


def ergon(
    arguments: Sequence[str], folder: Path, variables: Mapping[str, str]
) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Run a command in `folder` with these environment variables beside those of this process.

    It may store byte code, as an installed package has it. Returns its processor time [s], start of
    the program included, and its result.
    """
    inherited = {name: text for name, text in os.environ.items() if name != _NO_BYTE_CODE}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    result = subprocess.run(
        [sys.executable, "-m", "ergon.cli", *arguments],
        cwd=folder,
        env={**inherited, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, result
