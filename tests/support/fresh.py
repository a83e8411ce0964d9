"""A script in a fresh interpreter, told to leave vector instructions of the machine alone."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

# What glibc calls them, one "-" each.
PLAIN_GLIBC = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX,-AVX512F,-ERMS"


def disabled() -> str:
    """The instruction sets numpy may be told to leave: dispatched at run time and present here."""
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
    found, sounds = done.stdout.split()
    assert sounds == "True"
    return found
