"""Standard streams that are closed or narrow, and links that lead back to themselves."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest
from commands import ERGON
from one_bell import SCORE
from patience import PATIENCE
from sweep import few

FAULT_WORDS = ("Traceback", "internal error", "Exception ignored")
REPL = "repl score.yaml --audio null --gain 0dB --plain"
ASCII = (
    {"PYTHONIOENCODING": "ascii"},
    {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
)


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "score.yaml").write_text(SCORE.replace("One bell", "Une cloche fêlée"))
    for name in ("loop.yaml", "loop.jsonl", "loop.wav", "round"):
        (tmp_path / name).symlink_to(name)
    return tmp_path


def ergon(folder: Path, line: str, closed: tuple[int, ...] = (), **environment: str):
    def close() -> None:
        for number in closed:
            os.close(number)

    done = subprocess.run(
        [*ERGON, *line.split()],
        cwd=folder,
        env={**os.environ, **environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=PATIENCE,
        preexec_fn=close,
    )
    output = done.stderr.decode()
    assert not [word for word in FAULT_WORDS if word in output], output
    return done


@pytest.mark.parametrize("closed", [(1,), (0, 1, 2), pytest.param((0, 1), marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("line", "code"),
    few([("info score.yaml", 0), ("check nothing.yaml", 1), (REPL, 0), ("--help", 0)], 1),
)
def test_commands_with_closed_streams_exit_codes(
    here: Path, closed: tuple[int, ...], line: str, code: int
) -> None:
    assert ergon(here, line, closed).returncode == code


def test_render_with_closed_standard_streams(here: Path) -> None:
    open_ = ergon(here, "render score.yaml -o a.wav --json")
    assert open_.returncode == 0
    assert ergon(here, "render score.yaml -o b.wav --json", (0, 1, 2)).returncode == 0
    assert (here / "a.wav").read_bytes() == (here / "b.wav").read_bytes()


@pytest.mark.parametrize("environment", few(ASCII, ASCII[1:]))
def test_non_ascii_text_is_escaped_in_an_ascii_locale(
    here: Path, environment: dict[str, str]
) -> None:
    assert b"f\\xeal\\xe9e" in ergon(here, "info score.yaml", **environment).stdout
    assert ergon(here, "plan score.yaml", **environment).returncode == 0
    printed = ergon(here, "info score.yaml --json", **environment).stdout
    output = [json.loads(line) for line in printed.splitlines()]
    assert any("fêlée" in str(one) for one in output)
    (here / "bad.yaml").write_text(SCORE.replace("knock, every", "knöck, every"))
    bad = ergon(here, "check bad.yaml --json", **environment)
    assert bad.returncode == 1
    assert "knöck" in json.loads(bad.stdout.splitlines()[0])["message"]


@pytest.mark.parametrize(
    ("line", "code"),
    few(
        [
            ("check loop.yaml", 1),
            ("check round/score.yaml", 1),
            ("check uses.yaml", 1),
            ("check plays.yaml", 1),
            ("render score.yaml -o loop.wav", 2),
            ("render score.yaml -o round/x.wav", 2),
            ("render loop.jsonl -o x.wav", 2),
            ("repl --resume loop.jsonl --audio null", 2),
            ("repl score.yaml --audio null --journal round/session.jsonl", 2),
            ("schema -o loop.yaml", 2),
        ],
        4,
    ),
)
def test_commands_with_symlink_loops(here: Path, line: str, code: int) -> None:
    (here / "uses.yaml").write_text(SCORE.replace("keys:", "use: loop.yaml\nkeys:"))
    takes = "takes: {t: {file: round/x.take}}\ngestures:"
    (here / "plays.yaml").write_text(SCORE.replace("gestures:", takes))
    before = sorted(here.iterdir())
    done = ergon(here, line)
    assert done.returncode == code
    assert done.stderr.strip()
    assert sorted(here.iterdir()) == before
