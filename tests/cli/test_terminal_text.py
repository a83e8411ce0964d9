"""Text of scores, takes and files reaches a terminal with nothing in it that steers one."""

import io
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import ERGON
from hypothesis import given
from hypothesis import strategies as st

from ergon.cli import app
from ergon.cli.console import Console
from ergon.common.terminal import clean, json_text, printable
from ergon.exchange.wave import WaveWriter
from ergon.exchange.wave_header import Stamp, WaveFormat

# A title that is set, a screen that is cleared, C1, a turned line, a zero-width space, a tag.
EVIL = "a\x1b]0;b\x07\x1b[2J\x9b31m\x7f\u202ec\u2066\u200b\U000e0041"
STEERING = set("\x1b\x07\x9b\x7f\r\b\u202e\u2066\u200b\U000e0041")
TEXT = """ergon: 1
title: "a\\e]0;b\\a\\e[2J\\x9b31m\\x7f\\u202ec\\u2066\\u200b\\U000e0041"
instruments: {bell: {modules: {m: {CEL: {M: 2g, f: 220Hz, t60: 1s}}}, out: {SOX: m}}}
strikes: {r: {to: bell.m, at: 0, every: 1, times: 2, impulse: 1uNs}}
render: {tail: 10ms}
"""


@pytest.fixture
def evil(tmp_path, monkeypatch):
    """A folder with a score whose title and whose name steer a terminal."""
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(TEXT, encoding="utf-8")
    Path("\x1b[2Js\u202e.yaml").write_text(TEXT, encoding="utf-8")
    stamp = Stamp(EVIL, "", "")
    with Path("x.wav").open("wb") as file:
        writer = WaveWriter(file, WaveFormat(1000, 1, "float"), 100, stamp)
        writer.write(np.zeros((100, 1), np.float32))
        writer.close()
    return tmp_path


def printed(capsys, *arguments: str) -> str:
    app.run(list(arguments))
    out, err = capsys.readouterr()
    return str(out + err)


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "s.yaml"],
        ["info", "x.wav"],
        ["info", "\x1b[2Js\u202e.yaml"],
        ["check", "\x1b[2Js\u202e.yaml"],
        ["check", "\x1b[2Jnot there\u202e.yaml"],
        ["plan", "\x1b[2Js\u202e.yaml"],
        ["render", "\x1b[2Js\u202e.yaml", "-o", "\x1b[2Jx.wav"],
        ["render", "s.yaml", "--\x1b[2J"],
        ["plot", "x.wav"],
        ["fmt", "\x1b[2Jno\u202e.yaml"],
        ["take", "info", "\x1b[2J\u202e.csv"],
        ["take", "list", "\x1b[2J\u202e"],
    ],
    ids=range(12),
)
def test_messages_without_terminal_control_characters(evil, capsys, arguments):
    for form in ([], ["--json"]):
        output = printed(capsys, *arguments, *form)
        assert output or form  # a score without mistakes is no record
        assert not STEERING & set(output)
        if form and all(line.startswith("{") for line in output.splitlines()):
            for line in output.splitlines():
                json.loads(line)


def test_info_json_with_unescaped_title(evil, capsys):
    app.run(["info", "s.yaml", "--json"])
    assert json.loads(capsys.readouterr().out)["title"] == EVIL


@given(st.text())
def test_clean_text_preserves_length(text):
    shown = clean(text)
    assert len(shown) == len(text)
    assert all(a == b or b == "?" for a, b in zip(text, shown, strict=True))
    assert not STEERING & set(shown.replace("\r\n", ""))
    shown.encode()
    assert clean("é漢🎻 ä\t\u200d\r\n") == "é漢🎻 ä\t\u200d\r\n"
    assert printable(text).isprintable()
    output = json_text({"a": text})
    assert json.loads(output) == {"a": text}
    assert not STEERING & set(output)
    output.encode()


def test_progress_bar_with_brackets_and_escapes_in_name(monkeypatch):
    """Rich reads marks in brackets, and a name may hold one that closes nothing."""
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with Console().progress("rendering [/red]\x1b]0;b\x07", 100, 100.0) as progress:
        progress.update(100)
    assert "[/red]?]0;b?" in screen.getvalue()


@pytest.mark.parametrize("arguments", [["compile", "s.yaml"], ["fmt", "-"]])
def test_data_cleaned_on_terminal_and_raw_in_pipe(evil, arguments):
    source = f"# {EVIL[1:]}\n{TEXT}" if arguments[0] == "fmt" else TEXT
    source = source.replace("\x1b", "").replace("\x07", "").replace("\x7f", "").replace("\x9b", "")
    Path("s.yaml").write_text(source.replace("a\\e", "a"), encoding="utf-8")
    command = [*ERGON, *arguments]

    def output(stdout):
        with Path("s.yaml").open("rb") as text:
            return subprocess.run(
                command, stdin=text, stdout=stdout, stderr=subprocess.PIPE, check=True
            ).stdout

    raw = output(subprocess.PIPE).decode()
    assert "\u202e" in raw
    ours, theirs = pty.openpty()
    try:
        output(theirs)
        os.close(theirs)
        seen = b""
        while b"\n" not in seen or len(seen) < len(raw.encode()) // 2:
            seen += os.read(ours, 65536)
    finally:
        os.close(ours)
    assert "\u202e" not in seen.decode(errors="replace")
    assert seen.decode(errors="replace").startswith(clean(raw)[:20].split("\n")[0])
