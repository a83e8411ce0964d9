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


def test_tuned_bar(tmp_path: Path):
    run("tune.py", tmp_path)
    bar = modes(tmp_path / "tuned.yaml")[0]
    assert bar.frequencies == pytest.approx([440.0, 440.0 * 2.76, 440.0 * 5.4], rel=1e-5)


def test_sweep_of_six_variants(tmp_path: Path):
    table = tmp_path / run("sweep.py", tmp_path).splitlines()[-1]
    with table.open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(line for line in file if not line.startswith("#"))]
    assert [row["status"] for row in rows] == ["ok"] * 6
    assert len([*table.parent.glob("*.wav")]) == 6


def test_folded_piece(tmp_path: Path):
    run("fold.py", tmp_path)
    wide, _ = soundfile.read(tmp_path / "sky.wav")
    ears, _ = soundfile.read(tmp_path / "headphones.wav")
    assert (wide.shape[1], ears.shape[1]) == (8, 2)
    assert 0.05 < abs(ears).max() <= 1.0


def test_frozen_part_in_a_session(tmp_path: Path):
    output = run("freeze.py", tmp_path)
    first, reply, folder = output.splitlines()
    assert first.endswith("of gong")
    assert reply.startswith("ok ")
    assert (tmp_path / folder).is_dir()


def test_line_of_another_program(tmp_path: Path):
    run("osc.py", tmp_path)
    saved = (tmp_path / "rain.yaml").read_text(encoding="utf-8")
    assert "rain: {to: bell.m" in saved


def test_maps_of_a_keyboard(tmp_path: Path):
    output = run("midi_map.py", tmp_path).splitlines()
    assert "note 60..72 vib" in output
    assert "cc 74 tempo 60.0..180.0" in output


def test_imported_model_has_its_pitch(tmp_path: Path):
    output = run("import_model.py", tmp_path)
    # x[n+1] = (2 - K - Z) x[n] - (1 - Z) x[n-1]
    stiffness, damping = 0.01, 0.001
    angle = math.acos((2 - stiffness - damping) / (2 * math.sqrt(1 - damping)))
    assert f"{44100 * angle / (2 * math.pi):.2f} Hz" in output


def test_exceptions_by_kind(tmp_path: Path):
    kinds = [line.split(": ")[1] for line in run("errors.py", tmp_path).splitlines()]
    assert kinds == ["ScoreError", "OptionError", "FileRefusedError"]


def test_examples_fit_on_a_screen():
    lengths = {p.name: len(p.read_text("utf-8").splitlines()) for p in EXAMPLES.glob("*.py")}
    assert {name: count for name, count in lengths.items() if count > 50} == {}


def test_every_example_is_in_the_table():
    table = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    rust = EXAMPLES.parent / "core-rs/engine/examples"
    for path in [*EXAMPLES.glob("*.py"), *rust.glob("*.rs")]:
        assert path.name in table, path.name
