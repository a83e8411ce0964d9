"""Tests make their plans themselves; those of plans that are kept say where."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ["ERGON_CACHE"] = "off"


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A folder whose name is short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="ergon-") as name:
        yield Path(name)
