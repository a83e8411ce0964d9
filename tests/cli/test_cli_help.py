"""`ergon help`, `ergon explain`, `-h`, and the ways to start the program."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import ergon
from ergon.api import version
from ergon.api.version import build, commit
from ergon.cli import app, manual
from ergon.common.commit import commit_of

ROOT = Path(__file__).parents[2]


@pytest.fixture
def answer(capsys: pytest.CaptureFixture[str]):
    def run(*words: str) -> tuple[int, str, str]:
        code = app.run([*words])
        return code, *capsys.readouterr()

    return run


@pytest.mark.parametrize("words", [["render"], ["take", "trim"], ["metrology", "fit"]])
def test_help_of_a_command(answer, words):
    usual = answer(*words, "--help")
    assert usual[0] == 0
    assert usual[1].startswith(f"Usage: ergon {' '.join(words)}")
    assert answer("help", *words) == usual
    assert answer(*words, "-h") == usual


def test_help_of_all_commands_and_pages(answer):
    code, out, _err = answer("help")
    assert code == 0
    for name in ("render", "explain", "rhythm", "tutorial"):
        assert name in out


@pytest.mark.parametrize(
    ("topic", "path"),
    [
        ("rhythm", "rhythm.md"),
        ("tune", None),  # the command comes before the page
        ("howto/tune", "howto/tune.md"),
        ("E204", "errors/E204.md"),
        ("e204", "errors/E204.md"),
        ("start", "README.md"),
    ],
)
def test_help_of_a_page(answer, topic, path):
    code, out, _err = answer("help", topic)
    assert code == 0
    if path is None:
        assert out.startswith("Usage: ergon tune")
    else:
        assert out == (ROOT / "docs" / path).read_text(encoding="utf-8")


# What a person asks for by a word of their own, and the page that answers.
TOPICS = [
    ("tuning", "howto/tune.md"),
    ("how to tune", "howto/tune.md"),
    ("bowing", "howto/bow.md"),
    ("laws", "howto/law.md"),
    ("headphones", "dome.md"),
    ("volume", "howto/soft.md"),
    ("silence", "howto/silent.md"),
    ("keyboard", "midi.md"),
    ("sound card", "sound.md"),
    ("getting started", "tutorial.md"),
    ("windows", "install.md"),
    ("drums", "instruments/skins.md"),
    ("notes", "howto/melody.md"),
    ("film", "view.md"),
    ("undo", "repl.md"),
    ("loudness", "howto/soft.md"),
    ("swing", "rhythm.md"),
    ("jupyter", "notebook.md"),
]


@pytest.mark.parametrize(("topic", "path"), TOPICS, ids=[topic for topic, _ in TOPICS])
def test_help_of_a_topic_opens_a_page(answer, topic, path):
    code, out, _err = answer("help", *topic.split())
    assert code == 0
    head, _, text = out.partition("\n\n")
    assert head.startswith("The page ")
    assert text == (ROOT / "docs" / path).read_text(encoding="utf-8")


def test_help_of_a_topic_names_other_pages(answer):
    _code, out, _err = answer("help", "tuning")
    head, _, _ = out.partition("\n\n")
    assert head.startswith("The page howto/tune. Others about tuning:")
    others = re.findall(r"^  ergon help (\S+) +\S", head, re.MULTILINE)
    assert {"language", "structure"} <= set(others)
    for other in others:
        assert answer("help", other)[0] == 0


def test_help_of_pages_called_as_commands(answer):
    both = [name for name in manual.pages() if name in app.COMMANDS]
    assert "view" in both
    listed = answer("help")[1]
    for name in both:
        _code, out, _err = answer("help", name)
        assert out.startswith(f"Usage: ergon {name}")
        assert out.endswith(f"A page of the manual: ergon help {name}.md\n")
        page = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        assert answer("help", f"{name}.md")[1] == page
        assert f"{name}.md" in listed


def test_help_of_an_unknown_topic_suggests(answer):
    code, _out, err = answer("help", "rythm")
    assert code == 2
    assert "did you mean 'rhythm'?" in err


@pytest.mark.parametrize("topic", ["../pyproject", "/etc/passwd", "\x1b[31m", "a" * 10_000])
def test_help_of_path_outside_manual_is_refused(answer, topic):
    code, out, err = answer("help", topic)
    assert code == 2
    assert "\x1b" not in err
    assert "root:" not in out


@pytest.mark.parametrize("code", ["E204", "w325"])
def test_explain_a_mistake(answer, code):
    status, out, _ = answer("explain", code)
    page = ROOT / f"docs/errors/{code.upper()}.md"
    assert (status, out) == (0, page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("code", ["E999", "rhythm", "start", ""])
def test_explain_unknown_code(answer, code):
    status, _, err = answer("explain", code)
    assert status == 2
    assert "is not the code of a mistake" in err


def test_manual_lists_all_pages():
    for page in manual.pages().values():
        assert page.headings, page.name


def test_python_m_ergon_version():
    command = [sys.executable, "-m", "ergon", "--version"]
    printed = subprocess.run(command, capture_output=True, check=True, text=True, cwd=ROOT).stdout
    assert printed == f"ergon {ergon.__version__} ({build()})\n"
    head = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(head, capture_output=True, check=True, text=True, cwd=ROOT).stdout
    assert f"(commit {commit.strip()}" in printed
    assert f"numba {metadata.version('numba')}" in printed


def test_version_of_wheel_with_commit_record(tmp_path, monkeypatch):
    record = tmp_path / "build.json"
    monkeypatch.setattr(version, "BUILD_RECORD_PATH", record)
    for text in ("", "[]", '{"commit"', "{}"):
        record.write_text(text)
        assert commit() == commit_of(ROOT)
    record.write_text('{"commit": "0123abcd"}')
    assert commit() == "0123abcd"
    assert build().startswith("commit 0123abcd, ")


def test_commit_of_folder_outside_git(tmp_path):
    assert commit_of(tmp_path) == ""
