"""Fuzz: `PYTHONPATH=tests/support:. python -m tests.fuzz [TARGET [COUNT [FIRST]]]`."""

import resource
import sys
import tempfile
from pathlib import Path

from tests.fuzz.harness import fuzz
from tests.fuzz.targets import BY_NAME, TARGETS

_MEMORY = 8 << 30  # bytes: what a case would take beyond it is a MemoryError, which is a fault


def main() -> None:
    """Run what the command line asks for, and tell it as it ends."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    name, *numbers = [*sys.argv[1:], ""][: max(1, len(sys.argv) - 1)]
    for target in [BY_NAME[name]] if name else TARGETS:
        count = int(numbers[0]) if numbers else target.short
        first = int(numbers[1]) if len(numbers) > 1 else 0
        with tempfile.TemporaryDirectory() as folder:
            print(f"{target.name}: {fuzz(target, count, Path(folder), first)}", flush=True)


main()
