"""The session of docs/concert.md in a real terminal: hands, MIDI, a lost device, `kill -9`, resume.

Time is that of two boards in lockstep, which a test lets pass up to each line's bar.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import TextIO

import numpy as np
import pytest
import soundfile
from commands import ERGON
from terminals import ENTER, Terminal

from tests.repl.test_repl_concert import BLOCK, after, bar_of, exchanges, shown

PAGE = Path(__file__).parents[2] / "docs" / "concert.md"
SESSION = Path(__file__).parents[1] / "support" / "paced_repl.py"
KNOB, KEY = "b01560", "903c50"
DONE_BY_PIPE = {
    "# knob 21 is turned, and C4 is played": (f"midi {KNOB}", f"midi {KEY}"),
    "# zoe's device is unplugged": ("lose",),
    "# zoe's device is plugged in again": ("find",),
}


def begun(folder: Path, command: str, listened: str) -> Terminal:
    """The session of a block of the page, on devices and a port of its own."""
    words = re.sub(r" --(live|midi) \S+", "", command).split()
    single = [*words[1:], "--audio", f"file:{listened}", "--midi", "keyboard", "--unchecked"]
    pipe = folder / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    program = [sys.executable, str(SESSION), str(pipe), *single]
    return Terminal(program, rows=60, columns=140, cwd=folder, HOME=str(folder))


def happens(folder: Path, terminal: Terminal, what: str, pipe: TextIO) -> None:
    """What the page says happens beside the prompt."""
    if what == "# kill -9":
        terminal.child.kill(signal.SIGKILL)
        terminal.child.wait()
    elif "editor" in what:
        score = folder / "duo.yaml"
        text = score.read_text(encoding="utf-8")
        assert "smooth 6mm@60ms" in text
        score.write_text(text.replace("smooth 6mm@60ms", "smooth 4mm@60ms"), encoding="utf-8")
    else:
        for line in DONE_BY_PIPE[what]:
            print(line, file=pipe, flush=True)


def typed(folder: Path, terminal: Terminal, text: str) -> None:
    """Type every line of a block at its bar, and see what is answered."""
    with (folder / "pipe").open("w", encoding="ascii") as pipe:
        for bar, line, answers in exchanges(text):
            print(f"bar {bar}", file=pipe, flush=True)
            terminal.until(lambda bar=bar: bar_of(terminal) >= bar, f"bar {bar}")
            if line.startswith("#"):
                happens(folder, terminal, line, pipe)
                continue
            terminal.type(line + ENTER)
            for answer in answers:
                wanted = shown(answer)
                terminal.until(
                    lambda wanted=wanted, line=line: wanted.search(after(terminal, line)),
                    f"{answer!r} after {line!r}",
                )


def rendered(folder: Path, journal: str) -> tuple[np.ndarray, str]:
    """What a journal renders to, and what was said of it."""
    command = [*ERGON, "render", journal, "-o", "again.wav", "--bits", "float", "-f"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    frames, _ = soundfile.read(folder / "again.wav", dtype="float32", always_2d=True)
    return frames, done.stderr


def captured(path: Path) -> np.ndarray:
    """The frames of a file that may have no end: its header may say less than it holds."""
    data = path.read_bytes()
    data = data[data.index(b"data") + 8 :]
    return np.frombuffer(data[: len(data) // 8 * 8], "<f4").reshape(-1, 2)


@pytest.mark.slow
def test_concert_with_hands_renders_from_journals(tmp_path: Path):
    page = PAGE.read_text(encoding="utf-8")
    score = re.search(r"<!-- file: duo.yaml -->\n```yaml\n(.*?)```", page, re.DOTALL)
    first, second = BLOCK.finditer(page)
    assert score is not None
    (tmp_path / "duo.yaml").write_text(score[1], encoding="utf-8")

    with begun(tmp_path, first["command"], "heard.wav") as terminal:
        terminal.sees("1|1 >")
        typed(tmp_path, terminal, first["text"])
    again, message = rendered(tmp_path, "session.jsonl")
    assert "session.jsonl has no end" in message
    assert "was never finished" in message
    (part,) = tmp_path.glob(".heard.wav.*.part")  # no header says how long it is
    listened = captured(part)
    n = min(len(listened), len(again))
    # On a busy machine a killed session may have written less of its hands than of its sound.
    if cut := re.search(r"recording of hands ends at ([\d.]+) s", message):
        n = min(n, int((float(cut[1]) - 0.05) * 44_100))
    assert n > 10 * 6.5 / 4 * 44_100  # ten bars of 1.67 s, but for what was not written yet
    assert np.array_equal(listened[:n], again[:n])
    assert np.abs(listened).max(axis=0).min() > 1e-3

    with begun(tmp_path, second["command"], "heard-2.wav") as terminal:
        terminal.sees("11|1 >")
        typed(tmp_path, terminal, second["text"])
        assert terminal.ends() == 0
    again, message = rendered(tmp_path, "session-2.jsonl")
    assert "warning" not in message
    listened, _ = soundfile.read(tmp_path / "heard-2.wav", dtype="float32", always_2d=True)
    n = min(len(listened), len(again)) - 4 * 1024  # the last frames fall silent, for it ends
    assert n > 10 * 6.5 / 4 * 44_100
    assert np.array_equal(listened[:n], again[:n])
    text = (tmp_path / "evening.yaml").read_text(encoding="utf-8")
    assert "smooth 4mm@60ms" in text
    assert "# edited on stage" in text
    assert subprocess.run([*ERGON, "check", tmp_path / "evening.yaml"], check=False).returncode == 0
