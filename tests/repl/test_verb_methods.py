"""A type checker knows the verbs of a session: a misspelt one is found before anything plays."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from docs.generators.verb_methods import text
from ergon.repl.language import building

ROOT = Path(__file__).parents[2]
CALLS = """\
from ergon.repl.session.api import SessionProxy


def session(s: SessionProxy) -> None:
    s.plays("ada", "knock", every=1, do="scale 0.8")
    s.tempo(72, now=True)
    s.couple("k1", "k2", K="40N/m", in_=2)
    s("ada plays knock")
    s.define("knock", "0@0 smooth 7@1/8")
    s.plaeys("ada")
    s.tempo(72, noww=True)
    s.hush("ada", "leo").taken.real
    s.hush().tkaen
"""


def test_stub_of_verbs_is_up_to_date():
    """`make docs` writes it."""
    stub = ROOT / "repl" / "session" / "verb_methods.pyi"
    assert stub.read_text(encoding="utf-8") == text()
    assert all(f"def {name}(" in text() for name in building.VERB_BY_FUNCTION)


def test_mypy_finds_misspelt_verbs_and_options(tmp_path: Path):
    file = tmp_path / "calls.py"
    file.write_text(CALLS)
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", str(file)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    output = [line.partition("calls.py:")[2] for line in done.stdout.splitlines()]
    errors = [line for line in output if "error:" in line]
    assert [int(line.partition(":")[0]) for line in errors] == [10, 11, 12, 13], done.stdout
    assert '"SessionProxy" has no attribute "plaeys"' in errors[0]
    assert 'Unexpected keyword argument "noww"' in errors[1]
    assert '"Reply" has no attribute "tkaen"' in errors[3]
