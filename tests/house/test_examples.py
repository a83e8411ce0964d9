"""The examples run, and give what they say. Those in Rust are run by core-rs/engine/tests."""

import csv
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile

from ergon import modes

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(name: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_scale_example_renders_sound(tmp_path: Path):
    run("scale.py", tmp_path, "scale.wav")
    sound, rate = soundfile.read(tmp_path / "scale.wav")
    assert len(sound) > 8 * rate
    assert 0.1 < abs(sound).max() < 1.0  # at the fixed level


def test_diagnostics_example_prints_place_and_suggestion(tmp_path: Path):
    output = [json.loads(line) for line in run("diagnostics.py", tmp_path).splitlines()]
    (result,) = [one for one in output if one.get("code") == "E301"]
    assert (result["line"], result["suggestion"]) == (5, "knock")


def test_session_example_saves_score(tmp_path: Path):
    assert "'kock' is not a gesture" in run("session.py", tmp_path, str(tmp_path))
    saved = (tmp_path / "saved.yaml").read_text(encoding="utf-8")
    assert re.search(r"play: knock, every: 1, times: 8", saved)
    assert "f: 330Hz" in saved


def test_tune_example_reaches_targets(tmp_path: Path):
    run("tune.py", tmp_path)
    bar = modes(tmp_path / "tuned.yaml")[0]
    assert bar.frequencies == pytest.approx([440.0, 440.0 * 2.76, 440.0 * 5.4], rel=1e-5)


def test_sweep_example_of_six_variants(tmp_path: Path):
    table = tmp_path / run("sweep.py", tmp_path).splitlines()[-1]
    with table.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(line for line in file if not line.startswith("#"))]
    assert [row["status"] for row in rows] == ["ok"] * 6
    assert len([*table.parent.glob("*.wav")]) == 6


def test_fold_example_output_channels(tmp_path: Path):
    run("fold.py", tmp_path)
    wide, _ = soundfile.read(tmp_path / "sky.wav")
    ears, _ = soundfile.read(tmp_path / "headphones.wav")
    assert (wide.shape[1], ears.shape[1]) == (8, 2)
    assert 0.05 < abs(ears).max() <= 1.0


def test_freeze_example_in_session(tmp_path: Path):
    output = run("freeze.py", tmp_path)
    first, reply, folder = output.splitlines()
    assert first.endswith("of gong")
    assert reply.startswith("ok ")
    assert (tmp_path / folder).is_dir()


def test_osc_example_adds_line(tmp_path: Path):
    run("osc.py", tmp_path)
    saved = (tmp_path / "rain.yaml").read_text(encoding="utf-8")
    assert "rain: {to: bell.m" in saved


def test_midi_map_example_output(tmp_path: Path):
    output = run("midi_map.py", tmp_path).splitlines()
    assert "note 60..72 vib" in output
    assert "cc 74 tempo 60.0..180.0" in output


def test_import_model_example_pitch(tmp_path: Path):
    output = run("import_model.py", tmp_path)
    # x[n+1] = (2 - K - Z) x[n] - (1 - Z) x[n-1]
    stiffness, damping = 0.01, 0.001
    angle = math.acos((2 - stiffness - damping) / (2 * math.sqrt(1 - damping)))
    assert f"{44100 * angle / (2 * math.pi):.2f} Hz" in output


def test_errors_example_exception_kinds(tmp_path: Path):
    kinds = [line.split(": ")[1] for line in run("errors.py", tmp_path).splitlines()]
    assert kinds == ["ScoreError", "OptionError", "FileRefusedError"]


def test_example_lengths_of_at_most_50_lines():
    lengths = {p.name: len(p.read_text("utf-8").splitlines()) for p in EXAMPLES.glob("*.py")}
    assert {name: count for name, count in lengths.items() if count > 50} == {}


def test_examples_listed_in_readme_table():
    table = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    rust = EXAMPLES.parent / "core-rs/engine/examples"
    for path in [*EXAMPLES.glob("*.py"), *rust.glob("*.rs")]:
        assert path.name in table, path.name
