"""A script in a fresh interpreter that is told not to use some vector instructions of the
machine.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

# The names that glibc uses, each with "-".
PLAIN_GLIBC = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX,-AVX512F,-ERMS"


def disabled() -> str:
    """The instruction sets that numpy can be told not to use: dispatched at run time and present
    here.
    """
    core = np._core._multiarray_umath
    return " ".join(f for f in core.__cpu_dispatch__ if core.__cpu_features__.get(f))


def digest(script: str, *args: str, **environment: str) -> str:
    """What a fresh interpreter prints, with these variables set."""
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", script, *args],
        env={**os.environ, "PYTHONPATH": path, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result, sounds = done.stdout.split()
    assert sounds == "True"
    return result
