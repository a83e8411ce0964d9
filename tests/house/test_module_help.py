"""`python -m MODULE --help` explains what a program does, and does nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GENERATORS = [
    f"docs.generators.{path.stem}"
    for path in sorted((ROOT / "docs/generators").glob("*.py"))
    if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
]
MODULES = [
    *GENERATORS,
    "accuracy",
    "benches",
    "ergon.repl.language.help",
    "ergon.workshop.lab.bundled",
]


def run(module: str, word: str, folder: Path) -> subprocess.CompletedProcess[str]:
    paths = os.pathsep.join((str(ROOT), str(ROOT / "tests/support")))
    command = [sys.executable, "-m", module, word]
    environment = {**os.environ, "PYTHONPATH": paths}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60
    )


@pytest.mark.parametrize("module", MODULES)
def test_help_of_a_module(module: str, tmp_path: Path):
    done = run(module, "--help", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: python -m {module} [-h]")
    assert len(done.stdout.splitlines()) > 4  # it says what it does
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("module", ["accuracy", "docs.generators.gallery", "docs.generators.wrap"])
def test_module_with_unknown_option(module: str, tmp_path: Path):
    done = run(module, "--pgae", tmp_path)
    assert done.returncode == 2
    assert "usage: python -m" in done.stderr
    assert list(tmp_path.iterdir()) == []
