"""A second user of this machine: runs code that tries what a program of theirs could."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest
from patience import PATIENCE

USER = 54321  # nobody's number: the least of rights
needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can be a second user too"
)
# The modules are imported first, for the second user may be kept out of their folder.
_BECOME = f"""
os.setgroups([])
os.setgid({USER})
os.setuid({USER})
os.chdir("/")
"""


def as_second_user(code: str, *words: object, imports: str = "json", before: str = "") -> Any:
    """What code of a second user prints, as JSON; `sys.argv[1:]` are the words, `imports` the
    modules that it needs, and `before` what runs before it becomes the second user.
    """
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import encodings.idna, os, sys, {imports}\n{before}\n{_BECOME}\n{code}",
            *map(str, words),
        ],
        stdout=subprocess.PIPE,
        check=True,
        text=True,
        timeout=PATIENCE,
    )
    return json.loads(done.stdout)
