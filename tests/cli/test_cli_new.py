"""new, fmt, schema, demo and watch."""

import json
import subprocess
import threading
import time
from pathlib import Path

import jsonschema
import pytest
import yaml
from patience import until
from sweep import few

from ergon.cli import app, demo
from ergon.cli.new import TEMPLATES, contents
from ergon.cli.watch import changes
from ergon.exchange.wave import read_info
from ergon.scores.reading.load import load

Capture = pytest.CaptureFixture[str]


pytestmark = pytest.mark.usefixtures("work_folder")


@pytest.mark.parametrize("template", few(TEMPLATES, 1))
def test_new_check_render(template: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    assert app.run(["new", "my-piece", "--template", template]) == 0
    assert "cd my-piece && ergon render score.yaml" in capsys.readouterr().err
    monkeypatch.chdir("my-piece")
    assert app.run(["check", "score.yaml"]) == 0
    assert capsys.readouterr().err == "score.yaml: no mistakes\n"
    assert app.run(["render", "-q", "score.yaml"]) == 0
    info = read_info(Path("score.wav"))
    assert (info.title, info.format.n_channels) == ("My piece", 2)
    assert load("score.yaml").diagnostics == []


@pytest.mark.parametrize("template", TEMPLATES)
def test_new_score_validates_against_its_schema(template: str) -> None:
    files = contents(template, "x")
    schema = json.loads(files["score-1.schema.json"])
    score = files["score.yaml"]
    assert score.startswith("# yaml-language-server: $schema=./score-1.schema.json\n")
    for name in files:
        if name.endswith(".yaml"):
            jsonschema.validate(yaml.safe_load(files[name]), schema)


def test_new_refuses_non_empty_folder(capsys: Capture) -> None:
    Path("piece").mkdir()
    Path("piece/mine.txt").write_text("mine")
    assert app.run(["new", "piece"]) == 2
    assert "not empty" in capsys.readouterr().err
    assert [path.name for path in Path("piece").iterdir()] == ["mine.txt"]
    assert app.run(["new", "no/../:x"]) == 2
    Path("empty").mkdir()
    assert app.run(["new", "-q", "empty"]) == 0


def test_fmt_check_diff_and_rewrite(capsys: Capture) -> None:
    path = Path("a.yaml")
    path.write_text("ergon: 1\nmarks: { A: 1|1,B: 2|1 }   # two\n")
    assert app.run(["fmt", "--check", "a.yaml"]) == 1
    assert app.run(["fmt", "--diff", "a.yaml"]) == 1
    assert "+marks: {A: 1|1, B: 2|1}" in capsys.readouterr().out
    assert app.run(["fmt", "a.yaml"]) == 0
    assert path.read_text() == "ergon: 1\nmarks: {A: 1|1, B: 2|1}   # two\n"
    assert app.run(["fmt", "--check", "--diff", "a.yaml"]) == 0
    path.write_text("a: [1")
    assert app.run(["fmt", "a.yaml"]) == 1
    assert "a.yaml:" in capsys.readouterr().err
    assert app.run(["fmt", "nowhere.yaml"]) == 2


def test_schema_command_output(capsys: Capture) -> None:
    assert app.run(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    jsonschema.Draft7Validator.check_schema(schema)
    assert schema["additionalProperties"] is False
    assert app.run(["schema", "-q", "-o", "s.json"]) == 0
    assert app.run(["schema", "-q", "-o", "s.json"]) == 0
    assert json.loads(Path("s.json").read_text()) == schema
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"ergon": 1, "evry": 2}, schema)


@pytest.fixture
def shipped(work_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A library of one score, so that these tests do not depend on what ships."""
    path = work_folder / "library" / "one-gesture.yaml"
    path.parent.mkdir()
    (path.parent / "instruments").mkdir()
    text = contents("bell", "first sound")
    path.write_text(text["score.yaml"])
    (path.parent / "instruments" / "bell.yaml").write_text(text["instruments/bell.yaml"])
    monkeypatch.setattr(demo, "bundled_scores", lambda: {"one-gesture": path})
    return path


def test_demo_writes_and_plays_score(
    shipped: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    played: list[list[str]] = []

    def play(command: list[str], **_: object) -> subprocess.CompletedProcess[bytes]:
        played.append(command)
        return subprocess.CompletedProcess(command, int("pw-play" in command[0]), b"", b"no daemon")

    monkeypatch.setattr(demo.shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(demo.subprocess, "run", play)
    assert app.run(["demo"]) == 0
    # The first player fails, the second works, the third is not tried.
    assert played == [["/bin/pw-play", "one-gesture.wav"], ["/bin/paplay", "one-gesture.wav"]]
    assert "× real time" in capsys.readouterr().err
    assert read_info(Path("one-gesture.wav")).n_frames > 44_100


def test_demo_without_sound(
    shipped: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr(demo.shutil, "which", lambda name: None)
    assert app.run(["demo", "one-gesture", "-o", "x.wav"]) == 0
    assert "no sound: none of pw-play, paplay, aplay works here" in capsys.readouterr().err
    assert app.run(["demo", "--no-audio", "-q", "-o", "x.wav"]) == 0
    assert capsys.readouterr() == ("", "")
    assert app.run(["demo", "one-gestrue"]) == 2
    assert "did you mean 'one-gesture'?" in capsys.readouterr().err


def test_demo_command_list_option(shipped: Path, capsys: Capture) -> None:
    assert app.run(["demo", "--list"]) == 0
    assert capsys.readouterr().out.split() == ["one-gesture", "First", "sound"]


def test_file_changes_through_atomic_replacement(tmp_path: Path) -> None:
    path, other = tmp_path / "a.yaml", tmp_path / "b.txt"
    path.write_text("1")
    seen: list[str] = []

    def work() -> None:
        for _ in changes({path}):
            seen.append(path.read_text())
            if seen[-1] == "3":
                return

    thread = threading.Thread(target=work, daemon=True)
    thread.start()

    until(lambda: seen, "the first")
    other.write_text("not ours")
    time.sleep(0.3)
    assert len(seen) == 1
    with path.open("r+") as file:  # in place, and never empty
        file.write("2")
    until(lambda: seen[-1] == "2", "a change in place")
    path.rename(tmp_path / "a.yaml~")  # as vim saves
    time.sleep(0.2)
    other.write_text("3")
    other.rename(path)
    until(lambda: seen[-1] == "3", "another file")
    thread.join()
    assert seen == ["1", "2", "3"]
