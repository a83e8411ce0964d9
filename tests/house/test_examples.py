"""The examples run, and give what they say. Those in Rust are run by core-rs/engine/tests."""

import json
import re
import subprocess
import sys
from pathlib import Path

import soundfile

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_scale_is_rendered(tmp_path: Path):
    run("scale.py", tmp_path, "scale.wav")
    sound, rate = soundfile.read(tmp_path / "scale.wav")
    assert len(sound) > 8 * rate
    assert 0.1 < abs(sound).max() < 1.0  # at the fixed level


def test_a_mistake_is_told_with_its_place(tmp_path: Path):
    output = [json.loads(line) for line in run("diagnostics.py", tmp_path).splitlines()]
    (result,) = [one for one in output if one.get("code") == "E301"]
    assert (result["line"], result["suggestion"]) == (5, "knock")


def test_a_session_leaves_its_score(tmp_path: Path):
    assert "'kock' is not a gesture" in run("session.py", tmp_path, str(tmp_path))
    saved = (tmp_path / "saved.yaml").read_text(encoding="utf-8")
    assert re.search(r"play: knock, every: 1, times: 8", saved)
    assert "f: 330Hz" in saved


def test_every_example_is_in_the_table():
    table = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    rust = EXAMPLES.parent / "core-rs/engine/examples"
    for path in [*EXAMPLES.glob("*.py"), *rust.glob("*.rs")]:
        assert path.name in table, path.name
