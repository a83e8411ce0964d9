"""Scores that ship are opened by their names."""

from pathlib import Path

import pytest

from ergon.cli import app
from ergon.exchange.wave import read_info

SCORE = "ergon: 1\ninstruments: {b: {CEL: {M: 1g, f: 300Hz, t60: 50ms}, out: {SOX: b}}}\n"
Capture = pytest.CaptureFixture[str]

pytestmark = pytest.mark.usefixtures("work_folder")


@pytest.mark.parametrize("command", ["check", "plan", "stats"])
def test_score_path_with_bundled_name(command: str):
    assert app.run([command, "one-gesture"]) == 0


def test_render_target_of_bundled_score():
    assert app.run(["render", "one-gesture", "--until", "0.1s"]) == 0
    assert Path("one-gesture.wav").is_file()


def test_score_path_with_file_of_bundled_name():
    Path("duet").write_text(SCORE)
    assert app.run(["render", "duet", "-o", "a.wav", "--until", "0.1s"]) == 0
    assert read_info(Path("a.wav")).format.n_channels == 1


def test_score_path_with_misspelt_name(capsys: Capture):
    assert app.run(["check", "deut"]) == 2
    assert "there is no file deut; did you mean duet, which ships?" in capsys.readouterr().err
