"""The command as a process of its own: signals, pipes, no terminal."""

import os
import signal
import subprocess
from pathlib import Path

import pytest
from commands import ERGON
from one_bell import SCORE
from patience import PATIENCE, until
from sweep import few


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bell.yaml").write_text(SCORE)
    (tmp_path / "long.yaml").write_text(SCORE.replace("tail: 1s", "tail: 36000s"))
    return tmp_path


@pytest.mark.parametrize("threads", few(["1", "2"], 1))
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_during_render_leaves_no_files(
    folder: Path, number: signal.Signals, threads: str
) -> None:
    command = [*ERGON, "render", "long.yaml", "--stems", "stems", "--threads", threads]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE) as process:
        until(lambda: list(folder.glob(".long.wav.*.part")), "a render")
        process.send_signal(number)
        _, output = process.communicate(timeout=PATIENCE)
        assert process.returncode == 128 + number, output
        assert b"Traceback" not in output
    files = [path.name for path in folder.rglob("*") if path.is_file()]
    assert sorted(files) == ["bell.yaml", "long.yaml"]


def test_render_through_stdout_pipe(folder: Path) -> None:
    complete = subprocess.run(
        [*ERGON, "render", "-q", "bell.yaml", "-o", "-"],
        cwd=folder,
        capture_output=True,
        check=True,
    )
    assert complete.stderr == b""
    with subprocess.Popen(
        [*ERGON, "render", "bell.yaml", "-o", "-", "--bits", "float"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.read(4) == b"RIFF"
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()
        assert process.wait(timeout=PATIENCE) == 0
    again = subprocess.run(
        [*ERGON, "render", "-q", "-", "-o", "x.wav"],
        cwd=folder,
        input=SCORE.encode(),
        check=True,
    )
    assert again.returncode == 0
    assert (folder / "x.wav").read_bytes() == complete.stdout


def test_output_without_terminal_has_no_colour_or_bar(folder: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    done = subprocess.run(
        [*ERGON, "render", "bell.yaml"],
        cwd=folder,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        env=environment,
        check=True,
    )
    assert done.stdout == ""
    assert "\x1b" not in done.stderr
    assert len(done.stderr.splitlines()) == 1
