"""The command line for tests: how it is begun as a process, and the JSON lines that it printed."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

ERGON = [sys.executable, "-m", "ergon.cli"]
PATIENT = [sys.executable, str(Path(__file__).with_name("patient_ergon.py"))]  # lines have no limit


def records(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """What was printed on stdout since the last look, a record a line."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]
