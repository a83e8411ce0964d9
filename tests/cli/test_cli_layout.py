"""`ergon layout`: tables and holes, layouts by their names, and what is no layout."""

import json
import subprocess
from pathlib import Path

from commands import ERGON


def ergon(*words: str, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [*ERGON, "layout", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def records(text: str) -> list[dict]:
    return [json.loads(line) for line in text.splitlines()]


def test_a_dome_that_ships_is_checked_by_its_name(tmp_path: Path):
    done = ergon("check", "dome24", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    *ways, whole = records(done.stdout)
    assert [way["by"] for way in ways] == ["nearest", "VBAP", "AllRAD 3", "AllRAD 5"]
    assert abs(ways[0]["off_mean_deg"] - 13.1) < 0.1
    assert (whole["loudspeakers"], whole["symmetric"], whole["holes"]) == (24, True, [])
    assert not whole["open_above"]


def test_holes_are_named(tmp_path: Path):
    (tmp_path / "odd.yaml").write_text("ergon: 1\nspeakers: [{az: 0}, {az: 100}, {az: -120}]\n")
    done = ergon("check", "odd.yaml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "the sides do not mirror each other" in done.stdout
    assert "a hole of 140° between 2 (azimuth 100°" in done.stdout
    assert "a hole overhead" in done.stdout


def test_two_loudspeakers_surround_nobody(tmp_path: Path):
    done = ergon("check", "stereo", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "VBAP" not in done.stdout
    assert "do not surround" in done.stdout


def test_what_is_no_layout_is_told(tmp_path: Path):
    done = ergon("check", "dome25", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean dome24?" in done.stderr
    (tmp_path / "bad.yaml").write_text("ergon: 1\nspeakers: [{az: 10m}, {azz: 1}]\n")
    done = ergon("check", "bad.yaml", folder=tmp_path)
    assert (done.returncode, done.stdout) == (1, "")
    assert "bad.yaml:2:" in done.stderr
    assert "E203" in done.stderr
    assert "'azz'" in done.stderr
