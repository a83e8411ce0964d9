"""Speeds and delays of named scenes, measured beside references: `python -m benches`."""

import sys
from pathlib import Path

# Simulated devices and terminals are shared with the tests.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
